"""A branch is refused for whatever it misses of what is asked, wherever on it and however little."""

from dataclasses import replace

import numpy as np
import pytest
from tests.whole_arm.arm_scenes import FLANGE_T_CAMERA

from omniservo.robots import CAMERA_HOUSING, ArmBodies, JointPath, Solid, Tube, load_arm
from omniservo.whole_arm import ArmSetting
from omniservo.whole_arm.judged_branch import judged_branch

STAND = np.radians([0.0, 20.0, 110.0, 0.0, 50.0, 0.0])
AHEAD = np.array([[0.0, 0.0, 0.5]])
BALL = Solid.sphere("ball", [0.9, 0.2, 0.6], 0.05)


@pytest.fixture(scope="module")
def setting():
    arm = load_arm("rx60")
    base_T_initial = arm.base_T_flange(STAND) * FLANGE_T_CAMERA
    return ArmSetting(arm, base_T_initial, FLANGE_T_CAMERA, mounted=CAMERA_HOUSING, limit_reserve=0.0)


def branch_of(positions, velocities, singular_values=1.0):
    positions, k = np.asarray(positions), len(positions)
    rest = np.zeros_like(positions)
    values = np.full(k, singular_values)
    return JointPath(np.linspace(0.0, 1.0, k), positions, np.asarray(velocities), rest, values, rest, (), 1.0)


def standing(singular_values=1.0):
    return branch_of([STAND] * 4, np.zeros((4, 6)), singular_values)


def judged(setting, branch=None, points=None):
    return judged_branch(setting, setting.bodies(()), branch or standing(), points)


@pytest.mark.parametrize("end", ["low", "high"])
@pytest.mark.parametrize("piece", range(3))
@pytest.mark.parametrize("joint", range(6))
def test_a_joint_that_comes_too_near_to_an_end_of_its_range_between_samples_is_named(
    setting, joint, piece, end
):
    """It swings out and back within one piece, and is where it was at every sample."""
    low, high = setting.arm.joint_range[joint]
    away, swing = 1.0 if end == "high" else -1.0, np.zeros((4, 6))
    swing[piece, joint], swing[piece + 1, joint] = 0.6 * away, -0.6 * away
    branch = branch_of([STAND] * 4, swing)
    q = branch(np.linspace(piece / 3.0, (piece + 1) / 3.0, 2001))[:, joint]
    room = high - q.max() if end == "high" else q.min() - low
    moved = branch_of(np.array([STAND] * 4) + (room - 0.05) * away * np.eye(6)[joint], swing)
    asked = replace(setting, limit_reserve=0.05 + 1e-6)
    found = judged(asked, moved)
    assert found.reason.startswith(f"{setting.arm.joint_names[joint]} comes 0.0")
    assert found.w == pytest.approx((piece + 0.5) / 3.0, abs=0.05)
    assert "range" not in judged(replace(setting, limit_reserve=0.049), moved).reason


@pytest.mark.parametrize("place", range(4))
def test_a_sample_that_is_more_singular_than_asked_is_named(setting, place):
    values, asked = np.ones(4), replace(setting, singular_value=0.1)
    for value, words in ((0.1 - 1e-9, "close to singular"), (0.1, "")):
        values[place] = value
        assert words in judged(asked, standing(values)).reason
    assert judged(asked, standing(values)).reason == ""


def gaps_of(setting):
    """The least of the gaps to what stands around, and of those between parts of the arm [m]."""
    bodies, found = setting.bodies(()), {True: [], False: []}
    bodies.place(STAND)
    for pair in range(len(bodies.pairs)):
        found[bodies.is_around(pair)].append(bodies.measure(pair))
    return min(found[True]), min(found[False])


@pytest.mark.parametrize("around", [True, False])
def test_a_clearance_that_is_missed_or_not_settled_is_told(setting, around):
    setting = replace(setting, surroundings=(BALL,), self_clearance=0.0)
    gap = gaps_of(setting)[0 if around else 1]
    for left in (1e-6, 3e-9, -1e-6):
        asked = {"clearance" if around else "self_clearance": gap - left}
        found = judged(replace(setting, **asked))
        assert (found.reason == "") == (left == 1e-6)
        assert found.reason.startswith("undecided: ") or around or left != 3e-9


def test_where_obstacles_are_the_cameras_alone_surroundings_are_kept_off_as_parts_of_the_arm_are(setting):
    asked = replace(setting, clearance=None, self_clearance=0.03)
    assert asked.clearance_around == 0.03
    assert replace(asked, clearance=0.01).clearance_around == 0.01


def test_everything_that_is_mounted_is_judged(setting):
    assert len(setting.bodies(()).shapes_of("camera")) == len(CAMERA_HOUSING)


def tube_of(setting, position=0.0, joints=0.0, **links):
    parts = ArmBodies(setting.arm, mounted=setting.mounted, surroundings=setting.surroundings).tube_parts
    return Tube(np.asarray(joints) * np.ones(6), dict.fromkeys(parts, 0.0) | links, position, 1.0, 0.02, 0.01)


def test_lines_of_sight_are_kept_free_by_what_links_and_camera_stray(setting):
    """A ball leaves 20 mm of the line half way; the forearm is nearer to it than 0.3 m."""
    camera = setting.base_T_initial
    points, middle = camera.apply(AHEAD), camera.apply([0.0, 0.03, 0.25])
    setting = replace(setting, surroundings=(Solid.sphere("ball", middle, 0.01),))
    for tube, words in (
        (None, ""),
        (tube_of(setting, position=0.03), ""),
        (tube_of(setting, position=0.05), "a point is hidden: ball comes within"),
        (tube_of(setting, forearm=0.3), "forearm"),
    ):
        found = judged(replace(setting, tube=tube, clearance=None, self_clearance=0.0), points=points)
        assert (found.reason == "") == (words == "")
        assert words in found.reason
    assert judged(replace(setting, tube=tube_of(setting, position=0.05))).reason == ""


def test_joints_keep_what_they_stray_to_the_ends_of_their_ranges(setting):
    for joint in range(6):
        strays = tube_of(setting, joints=0.06 * np.eye(6)[joint])
        assert replace(setting, tube=strays).limit_reserve == pytest.approx(0.06)
    assert replace(setting, tube=strays, limit_reserve=0.1).limit_reserve == 0.1
