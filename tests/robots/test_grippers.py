"""An arm's file with a gripper: which joints are the arm's, and where the others are held still."""

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform
from urdf_arms import SEVEN, SIX, fingers, urdf

from omniservo.errors import InputError
from omniservo.robots import Arm, ArmBodies, MountedCamera
from omniservo.robots.collision.own_sight import own_sight_in

NAMES = tuple(row[0] for row in SIX)

MJCF_HAND = """<body name="hand" pos="0 0 0.05"><geom type="box" size="0.02 0.05 0.02"/>
  <body name="left"><joint name="l" type="slide" range="0 0.04"/><geom size="0.01"/></body>
  <body name="right"><joint name="r" type="slide" range="0 0.04"/><geom size="0.01"/></body>
</body>"""
MJCF_COUPLING = """<tendon><fixed name="t"><joint joint="l" coef="1"/></fixed></tendon>
<equality><joint joint1="l" joint2="r"/></equality>
<actuator><position joint="j0" kp="100" kv="10"/><position tendon="t" kp="100"/></actuator>"""


def read(folder, text, flange=None, name="arm.urdf"):
    path = folder / name
    path.write_text(text)
    return Arm(path, flange=flange)


def body_in_flange(arm, body, q):
    """Where a body is, in the frame of the arm's flange [m]."""
    model = arm.spec().compile()
    data = mujoco.MjData(model)
    data.qpos[:] = q
    mujoco.mj_kinematics(model, data)
    return arm.base_T_flange(q).inv().apply(data.body(body).xpos)


def mjcf_with_hand():
    row = "".join(
        f'<body pos="0 0 0.1"><joint name="j{k}" axis="0 {k % 2} {1 - k % 2}" range="-120 120"/>'
        '<geom type="capsule" size="0.03 0.03"/>'
        for k in range(6)
    )
    speeds = f'<custom><numeric name="joint_speed_deg_s" data="{"90 " * 6}"/></custom>'
    tree = f"<worldbody>{row}{MJCF_HAND}{'</body>' * 6}</worldbody>"
    return f'<mujoco model="straight">{speeds}{tree}{MJCF_COUPLING}</mujoco>'


def test_fingers_are_no_joints_of_the_arm_and_stay_with_its_hand(tmp_path):
    alone = read(tmp_path, urdf())
    arm = read(tmp_path, urdf(extra=fingers()))
    assert arm.joint_names == NAMES
    assert {"left", "right"} <= {link.name for link in arm.links if link.shapes}
    assert {"left", "right"} <= set(ArmBodies(arm).links)
    assert any(
        "held still with what they carry: slide_a at 0 mm, slide_b at 0 mm" in notice
        for notice in arm.notices
    )
    for q in np.random.default_rng(0).uniform(*arm.joint_range.T, (20, 6)):
        there = alone.base_T_flange(q).as_matrix()
        np.testing.assert_allclose(arm.base_T_flange(q).as_matrix(), there, atol=1e-12)


def test_fingers_are_held_at_the_zero_of_their_range_or_its_nearer_end(tmp_path):
    mimic = '<mimic joint="slide_a" multiplier="0.5" offset="0.003"/>'
    arm = read(tmp_path, urdf(extra=fingers(lower=0.02, mimic=mimic)))
    assert any("slide_a at 20 mm, slide_b at 13 mm" in notice for notice in arm.notices)
    q = 0.2 * np.arange(6)
    np.testing.assert_allclose(body_in_flange(arm, "left", q), [0.04, 0, 0.1], atol=1e-9)
    np.testing.assert_allclose(body_in_flange(arm, "right", q), [-0.033, 0, 0.1], atol=1e-9)


def test_fingers_hide_points_where_they_are_held_and_go_with_the_camera(tmp_path):
    """The camera sits beside the gripper; one line goes through the left finger, the second beside."""
    beside = MountedCamera(RigidTransform.from_translation([0.06, 0.0, 0.0]))
    behind, ahead = [-0.02, 0.0, 0.2], [0.10, 0.0, 0.3]
    for lower, link in ((0.0, "left"), (0.03, "")):
        arm = read(tmp_path, urdf(extra=fingers(lower=lower)), flange="tool0")
        for q in np.random.default_rng(0).uniform(-1.0, 1.0, (5, 6)):
            base_T_flange = arm.base_T_flange(q)
            points = base_T_flange.apply([behind, ahead])
            hides = own_sight_in(arm, q, beside, points[:1])
            assert (hides.link, hides.status) == (link, "hidden" if link else "free")
            strays = own_sight_in(arm, q, beside, points[1:], kept={"left": 0.05}, camera_strays=0.03)
            assert strays.status == "free"


def test_without_a_name_for_the_flange_it_is_the_last_link_before_the_fingers(tmp_path):
    text = urdf(extra=fingers()).replace("tool0", "palm")
    arm = read(tmp_path, text)
    assert (arm.flange, arm.dof) == ("palm", 6)
    assert any("taken to sit on 'palm'; another link can be named" in notice for notice in arm.notices)
    assert not any("taken to sit" in notice for notice in read(tmp_path, text, flange="palm").notices)


@pytest.mark.parametrize(
    ("names", "mimic"),
    [(("gripper", "Left_Finger"), ""), (("drive", "copy"), '<mimic joint="drive"/>'), (("a", "b"), "")],
    ids=["by name", "driven together", "beside each other"],
)
def test_joints_of_a_gripper_that_turn_are_not_the_arms(tmp_path, names, mimic):
    text = urdf(extra=fingers(kind="revolute", names=names, mimic=mimic)).replace("tool0", "palm")
    arm = read(tmp_path, text)
    assert (arm.joint_names, arm.flange) == (NAMES, "palm")
    assert any(f"{names[0]} at 0 deg, {names[1]} at 0 deg" in notice for notice in arm.notices)


def test_a_flange_before_the_last_joint_holds_what_is_behind_it(tmp_path):
    seven, six = read(tmp_path, urdf(SEVEN)), read(tmp_path, urdf(SEVEN), flange="pitch_link")
    assert (seven.dof, six.dof) == (7, 6)
    assert any("turn at 0 deg" in notice for notice in six.notices)
    assert "turn_link" in ArmBodies(six).links


def test_a_finger_can_carry_the_camera_only_where_it_turns_by_itself(tmp_path):
    text = urdf(extra=fingers())
    for flange, why in (("left", "is of type 'prismatic'"), ("right", "is of type 'prismatic'")):
        with pytest.raises(
            InputError, match=rf"{why} and carries the flange '{flange}'; .* turn_link, tool0"
        ):
            read(tmp_path, text, flange=flange)
    text = urdf(extra=fingers(kind="revolute", names=("thumb", "other"), mimic=""))
    assert read(tmp_path, text, flange="left").joint_names == (*NAMES, "thumb")
    text = urdf(extra=fingers(kind="revolute", names=("thumb", "copy"), mimic='<mimic joint="thumb"/>'))
    with pytest.raises(InputError, match=r"joint 'copy': follows another \(<mimic>\) and carries the flange"):
        read(tmp_path, text, flange="right")


def test_what_copies_a_joint_of_the_arm_cannot_be_held_still(tmp_path):
    with pytest.raises(
        InputError, match="joint 'slide_b': a <mimic> joint follows 'turn', a joint of the arm"
    ):
        read(tmp_path, urdf(extra=fingers(mimic='<mimic joint="turn"/>')), flange="tool0")


def test_continuous_joints_turn_once_to_each_side(tmp_path):
    text = urdf().replace('"pan" type="revolute"', '"pan" type="continuous"')
    arm = read(tmp_path, text)
    np.testing.assert_allclose(arm.joint_range[0], [-2 * np.pi, 2 * np.pi])
    np.testing.assert_allclose(arm.joint_range[1:], [row[4:6] for row in SIX[1:]])
    assert any("continuous joints, taken as -360 … 360 deg: pan" in notice for notice in arm.notices)


def test_an_mjcf_hand_with_coupled_fingers_is_held_too(tmp_path):
    arm = read(tmp_path, mjcf_with_hand(), name="arm.xml")
    assert (arm.dof, arm.flange) == (6, "hand")
    assert any("held still with what they carry: l, r" in notice for notice in arm.notices)
    assert {"hand", "left", "right"} <= set(ArmBodies(arm).links)
    assert arm.spec().compile().nu == 6
    coupled_with_the_arm = mjcf_with_hand().replace('joint1="l"', 'joint1="j3"')
    with pytest.raises(InputError, match="j3"):
        read(tmp_path, coupled_with_the_arm, name="arm.xml")
