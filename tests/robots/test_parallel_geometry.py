"""Three parallel axes: every branch of the arms of Universal Robots in closed form."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation
from urdf_arms import urdf

from omniservo.errors import InputError
from omniservo.robots import Arm, load_arm
from omniservo.robots.kinematics.numeric_inverse import solutions

# The maker's lengths of the UR10e (table of Denavit-Hartenberg parameters), with joints as
# ROS's files place them: turns rounded to nine digits, base turned by half a turn, the last frame turned.
HALF = 1.570796327
UR10E = (
    ("shoulder_pan", (0, 0, 0.1807), (0, 0, 3.141592653589793), (0, 0, 1), -6.2, 6.2, 2.0, 330),
    ("shoulder_lift", (0, 0, 0), (HALF, 0, 0), (0, 0, 1), -6.2, 6.2, 2.0, 330),
    ("elbow", (-0.6127, 0, 0), (0, 0, 0), (0, 0, 1), -3.1, 3.1, 3.1, 150),
    ("wrist_1", (-0.57155, 0, 0.17415), (0, 0, 0), (0, 0, 1), -6.2, 6.2, 3.1, 56),
    ("wrist_2", (0, -0.11985, -2.458e-11), (HALF, 0, 0), (0, 0, 1), -6.2, 6.2, 3.1, 56),
    (
        "wrist_3",
        (0, 0.11655, -2.39e-11),
        (HALF, 3.141592653589793, 3.141592653589793),
        (0, 0, 1),
        -6.2,
        6.2,
        3.1,
        56,
    ),
)

# Links stand upon each other without any offset: the wrist can be brought over the first axis.
STACKED = tuple(
    (name, (0, 0, 0.2), (0, 0, 0), axis, -3.0, 3.0, 2.0, 100)
    for name, axis in zip("abcdef", np.eye(3, dtype=int)[[2, 1, 1, 1, 2, 1]].tolist(), strict=True)
)


def test_a_wrist_over_the_first_axis_is_reached_though_any_turn_of_it_does(tmp_path):
    path = tmp_path / "stacked.urdf"
    path.write_text(urdf(STACKED))
    arm = Arm(path)
    pose = arm.base_T_flange([0.4, 0.5, -1.0, 0.5, 0.3, 0.2])
    found = arm.inverse(pose)
    assert arm.has_closed_form
    assert len(found) >= 2
    for q in found:
        assert q[0] == 0.0
        np.testing.assert_allclose(arm.base_T_flange(q).as_matrix(), pose.as_matrix(), atol=1e-12)


@pytest.fixture(scope="module", params=["shipped ur5e", "urdf of a ur10e"])
def parallel(request, tmp_path_factory):
    if request.param == "shipped ur5e":
        return load_arm("ur5e")
    path = tmp_path_factory.mktemp("ur") / "ur10e.urdf"
    path.write_text(urdf(UR10E))
    return Arm(path)


def test_the_form_is_recognised_by_the_axes_alone(parallel, load):
    assert parallel.has_closed_form
    assert load("rx60").has_closed_form
    assert not load("panda").has_closed_form
    assert not load("urdf of six").has_closed_form


def test_every_branch_reaches_the_pose_and_the_posture_is_among_them(parallel):
    counts = set()
    for q in np.random.default_rng(0).uniform(-np.pi, np.pi, (200, 6)):
        goal = parallel.base_T_flange(q)
        found = parallel.branches(goal)
        counts.add(len(found))
        assert np.abs(np.sin(0.5 * (found - q))).max(axis=1).min() < 1e-6
        for branch in found:
            exact = 1e-9 if parallel.name == "ur5e" else 1e-8  # its file rounds a quarter turn to nine digits
            np.testing.assert_allclose(
                parallel.base_T_flange(branch).as_matrix(), goal.as_matrix(), atol=exact
            )
        gaps = np.abs(np.sin(0.5 * (found[:, None] - found[None]))).max(axis=-1) + np.eye(len(found))
        assert gaps.min() > 1e-6
    assert 8 in counts
    assert max(counts) == 8


def test_every_branch_that_the_numeric_search_finds_is_among_them(parallel):
    searched = 0
    for q in np.random.default_rng(1).uniform(-2.5, 2.5, (4, 6)):
        pose = parallel.base_T_flange(q)
        goal, found = pose.as_matrix(), parallel.branches(pose)
        within = np.tile([-np.pi, np.pi], (6, 1))
        for posture in solutions(parallel.chain._replace(ranges=within), goal):
            searched += 1
            assert np.abs(np.sin(0.5 * (found - posture))).max(axis=1).min() < 1e-6
    assert searched > 15


def test_full_turns_count_where_the_ranges_allow_them(parallel):
    q = np.array([0.3, -1.4, 1.6, -0.4, 1.1, 0.2])
    found = parallel.inverse(parallel.base_T_flange(q))
    elbow_turns = 2 if parallel.name == "ur5e" else 1
    assert len(found) == 8 * 2**5 * elbow_turns
    assert np.abs(found - (q - [0, 0, 0, 0, 2 * np.pi, 0])).max(axis=1).min() < 1e-6
    for joints in found:
        assert parallel.within_limits(joints)


def test_joint_six_stays_where_axes_four_and_six_are_parallel(parallel):
    q = np.array([0.3, -1.4, 1.6, -0.4, 0.0, 0.7])
    near = parallel.inverse_near(parallel.base_T_flange(q), q + 1e-9)
    np.testing.assert_allclose(near, q, atol=1e-6)


def test_pose_out_of_reach_is_named(parallel):
    for place in (
        [2.5, 0, 0.3],
        [0.01, 0.01, 0.9],
    ):  # too far; closer to axis 1 than the arm stands beside it
        with pytest.raises(InputError, match="out of the arm's reach"):
            parallel.branches(RigidTransform.from_components(place, Rotation.from_euler("x", 0.1)))


def test_an_offset_that_skews_the_wrist_is_left_to_the_search(tmp_path):
    """Calibrated arms are a little off: their formula would be wrong by as much."""
    rows = list(UR10E)
    name, xyz, _, *rest = rows[4]
    rows[4] = (name, xyz, (HALF + 1e-4, 0, 0), *rest)
    path = tmp_path / "calibrated.urdf"
    path.write_text(urdf(rows))
    assert not Arm(path).has_closed_form
