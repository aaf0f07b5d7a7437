"""The arm against an independent Denavit–Hartenberg product, finite differences and its own limits."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.errors import InputError, JointLimit
from omniservo.robots import Arm, load_arm

# Modified (Craig) DH table of the standard RX60: alpha [deg], a [m], d [m], theta offset [deg].
# Lengths: maker's manual D28045004E, 02/2008, pages 26-28: 341, 290, 49, 310, 65 mm. The elbow lies on -y
# at q = 0: the manual gives the size of the offset, the scenes its side.
DH = [
    (0, 0, 0.341, 0),
    (-90, 0, 0, -90),
    (0, 0.290, -0.049, 90),
    (90, 0, 0.310, 0),
    (-90, 0, 0, 0),
    (90, 0, 0.065, 0),
]
FLANGE_T_CAMERA = RigidTransform.from_components([0, 0, 0.0905], Rotation.from_euler("z", 90, degrees=True))
BASE_IN_WORLD = np.array([0, 0, -0.341])


@pytest.fixture(scope="module")
def arm():
    return Arm.rx60()


def dh_product(q):
    pose = np.eye(4)
    for (alpha, a, d, offset), angle in zip(DH, q, strict=True):
        step = np.eye(4)
        step[:3, :3] = (
            Rotation.from_euler("x", alpha, degrees=True)
            * Rotation.from_rotvec([0, 0, np.deg2rad(offset) + angle])
        ).as_matrix()
        step[:3, 3] = [a, *(Rotation.from_euler("x", alpha, degrees=True).apply([0, 0, d])[1:])]
        pose = pose @ step
    return pose


def random_joints(arm, count, seed):
    low, high = arm.joint_range.T
    return np.random.default_rng(seed).uniform(low, high, (count, 6))


def test_forward_kinematics_equal_the_makers_dh_table(arm):
    for q in random_joints(arm, 200, 1):
        np.testing.assert_allclose(arm.base_T_flange(q).as_matrix(), dh_product(q), atol=1e-12)


def test_stretched_arm_is_as_high_as_the_manual_says(arm):
    np.testing.assert_allclose(arm.base_T_flange(np.zeros(6)).translation, [0, -0.049, 1.006], atol=1e-12)


def test_limits_and_speeds_are_the_manuals(arm):
    limits = [[-160, 160], [-127.5, 127.5], [-134.5, 134.5], [-270, 270], [-109.5, 120.5], [-270, 270]]
    np.testing.assert_allclose(np.rad2deg(arm.joint_range), limits)
    np.testing.assert_allclose(np.rad2deg(arm.joint_speed), [287, 287, 319, 410, 320, 700])
    assert (arm.joint_acceleration > 0).all()
    assert arm.joint_names == ("j1", "j2", "j3", "j4", "j5", "j6")


@pytest.mark.parametrize(
    ("joints", "position"),
    [
        ([-0.7, 43.2, -64.6, 0.8, 111.4, 0.3], [0.2405, -0.0500, 0.5000]),
        ([31.0, 71.7, -66.6, -31.1, 85.6, 2.6], [0.4403, 0.1139, 0.4000]),
    ],
)
def test_joints_of_the_papers_scenes_put_the_camera_where_they_say(arm, joints, position):
    base_T_camera = arm.base_T_flange(np.deg2rad(joints)) * FLANGE_T_CAMERA
    np.testing.assert_allclose(base_T_camera.translation + BASE_IN_WORLD, position, atol=1e-3)
    initial = Rotation.from_matrix([[0, 0, 1], [1, 0, 0], [0, 1, 0]])
    assert (base_T_camera.rotation * initial.inv()).magnitude() < np.deg2rad(0.5)


@pytest.mark.parametrize(
    "joints",
    [[0, 43, -64, 10, 0, 20], [0, 20, 0, 0, 60, 0], [5, 30, 60, 20, 0.5, 0]],
    ids=["wrist straight", "elbow straight", "wrist nearly straight"],
)
def test_singular_arm_refuses_to_move(arm, joints):
    with pytest.raises(JointLimit, match="singular"):
        arm.joint_velocities(np.deg2rad(joints), [0, 0, 0.1, 0, 0, 0], FLANGE_T_CAMERA)


def test_every_inverse_branch_reaches_the_pose_within_limits(arm):
    for q in random_joints(arm, 200, 4):
        goal = arm.base_T_flange(q)
        branches = arm.inverse(goal)
        assert np.abs(branches - q).max(axis=1).min() < 1e-7
        for branch in branches:
            assert arm.within_limits(branch)
            np.testing.assert_allclose(arm.base_T_flange(branch).as_matrix(), goal.as_matrix(), atol=1e-9)


@pytest.mark.parametrize("name", ["rx60", "panda"])
@pytest.mark.parametrize(
    "pose",
    [
        np.eye(4),
        RigidTransform.from_translation(np.eye(3)),
        RigidTransform.from_translation([np.nan, 0.0, 0.4]),
    ],
)
def test_what_is_not_one_finite_pose_has_no_inverse(name, pose):
    arm = load_arm(name)
    for inverse in (arm.inverse, arm.branches, lambda pose: arm.inverse_near(pose, np.zeros(arm.dof))):
        with pytest.raises(InputError, match="^base_T_flange: "):
            inverse(pose)


def test_inverse_branches_are_distinct_and_sorted(arm):
    branches = arm.inverse(arm.base_T_flange(np.deg2rad([31.0, 71.7, -66.6, -31.1, 85.6, 2.6])))
    assert len(branches) > 4
    assert sorted(map(tuple, branches)) == [tuple(b) for b in branches]
    gaps = np.abs(branches[:, None] - branches[None]).max(axis=-1) + np.eye(len(branches))
    assert gaps.min() > 1e-3


def test_nearest_branch_is_the_one_the_arm_stands_in(arm):
    for q in random_joints(arm, 100, 5):
        np.testing.assert_allclose(arm.inverse_near(arm.base_T_flange(q), q + 1e-3), q, atol=1e-7)


def test_straight_wrist_keeps_joint_four_where_it_is(arm):
    q = np.deg2rad([10, 30, 40, 77, 0, -20])
    np.testing.assert_allclose(arm.inverse_near(arm.base_T_flange(q), q), q, atol=1e-7)


def test_pose_out_of_reach_is_named(arm):
    with pytest.raises(InputError, match="out of the arm's reach"):
        arm.inverse(RigidTransform.from_translation([1.2, 0, 0.3]))
    with pytest.raises(InputError, match="out of the arm's reach"):
        arm.inverse(
            RigidTransform.from_translation([0.01, 0.01, 0.9])
        )  # closer to axis 1 than the elbow's offset


def test_pose_that_only_forbidden_joints_reach_is_named(arm):
    folded_back = np.deg2rad([0, 0, 140, 0, 30, 0])  # the elbow would have to bend beyond 134.5 degrees
    with pytest.raises(InputError, match="every branch leaves a joint's range"):
        arm.inverse(arm.base_T_flange(folded_back))


def test_reserve_narrows_the_range(arm):
    q = np.deg2rad([0, 0, 0, 0, 120, 0])
    assert arm.within_limits(q)
    assert not arm.within_limits(q, reserve=np.deg2rad(1.0))


@pytest.mark.parametrize("shape", [(), (5,), (5, 1), (2, 7)])
def test_room_to_the_limits_is_that_of_as_many_joints_as_the_arm_has(arm, shape):
    assert arm.limit_margins(np.zeros((4, 0, 6))).shape == (4, 0, 6)
    with pytest.raises(InputError, match="q"):
        arm.limit_margins(np.zeros(shape))


def test_every_branch_at_the_end_of_a_range_is_found(arm):
    random = np.random.default_rng(0)
    for joint, end in np.ndindex(6, 2):
        for q in random.uniform(*(0.95 * arm.joint_range.T), (5, 6)):
            q[joint] = arm.joint_range[joint, end]
            found = arm.inverse(arm.base_T_flange(q))
            assert np.abs(found - q).max(axis=1).min() < 1e-6
            assert arm.limit_margins(found).min() >= 0.0


def test_a_straight_elbow_is_one_branch_and_not_two(arm):
    found = arm.inverse(arm.base_T_flange([0.1, 0.2, 0.0, 0.4, 0.5, 0.6]))
    assert len(np.unique(found.round(6), axis=0)) == len(found)


def stacked(tmp_path, lengths, q4="-3 3"):
    """An arm with axes z y y z y z, from the base: height, upper arm, forearm [m]."""
    axes, ranges = "zyyzyz", ["-3 3"] * 3 + [q4] + ["-3 3"] * 2
    places = [0.0, *lengths[:2], 0.0, lengths[2], 0.0]
    vector = {"z": "0 0 1", "y": "0 1 0"}
    bodies = "".join(
        f'<body pos="0 0 {z}"><joint axis="{vector[a]}" range="{r}"/><geom size="0.01"/>'
        for z, a, r in zip(places, axes, ranges, strict=True)
    )
    path = tmp_path / "stacked.xml"
    path.write_text(
        '<mujoco><compiler angle="radian" autolimits="true"/><worldbody>'
        f'{bodies}<site name="flange" pos="0 0 0.1"/>{"</body>" * 6}</worldbody></mujoco>'
    )
    return Arm(path)


@pytest.mark.parametrize("lengths", [(0.3, 0.0, 0.3), (0.3, 0.3, 0.0)])
def test_an_arm_without_an_upper_arm_or_forearm_is_searched(tmp_path, lengths):
    arm = stacked(tmp_path, lengths)
    pose = arm.base_T_flange([0.2, 0.3, 0.4, 0.5, 0.6, 0.7])
    assert not arm.has_closed_form
    for q in arm.inverse(pose)[:3]:
        np.testing.assert_allclose(arm.base_T_flange(q).as_matrix(), pose.as_matrix(), atol=1e-9)


def test_where_axes_4_and_6_are_one_a_representative_is_taken_from_the_range(tmp_path):
    arm = stacked(tmp_path, (0.3, 0.3, 0.3), "0.5 2")
    q = np.array([0.1, 0.2, 0.3, 1.0, 0.0, 0.6])
    assert np.abs(arm.inverse(arm.base_T_flange(q)) - [0.1, 0.2, 0.3, 0.5, 0.0, 1.1]).max(axis=1).min() < 1e-9
    assert arm.inverse_near(arm.base_T_flange(q), q) == pytest.approx(q, abs=1e-9)
