"""The posture that is suggested to begin with."""

import math

import numpy as np
import pytest
from urdf_arms import SEVEN, SIX, fingers, urdf

from omniservo.robots import (
    CAMERA_HOUSING,
    SELF_CLEARANCE,
    Arm,
    ArmBodies,
    load_arm,
    shipped_arms,
    suggested_mount,
    suggested_posture,
    suggested_table,
)


def looks(arm):
    """The way that a camera with the suggested mount looks, in the flange frame."""
    return suggested_mount(arm).rotation.apply([0.0, 0.0, 1.0])


@pytest.mark.slow
@pytest.mark.parametrize("name", [*shipped_arms(), "six", "seven"])
def test_it_is_free_far_from_singular_and_the_hand_looks_down(tmp_path, name):
    path = tmp_path / "arm.urdf"
    path.write_text(urdf(SEVEN if name == "seven" else SIX, extra=fingers()))
    arm = load_arm(name) if name in shipped_arms() else Arm(path)
    q = suggested_posture(arm)
    assert arm.within_limits(q)
    camera = [solid.moved(suggested_mount(arm)) for solid in CAMERA_HOUSING]
    bodies = ArmBodies(arm, mounted=camera)
    bodies.place(q)
    near = bodies.near(0.03)
    of_wrist = bodies.shapes.carried == arm.dof - 1  # the camera sits beside it, wherever it is
    assert not [
        bodies.names(n.pair)
        for n in near
        if n.gap < SELF_CLEARANCE
        or ("camera" in bodies.names(n.pair) and not of_wrist[bodies.pairs[n.pair, 0]])
    ]
    assert np.linalg.svd(arm.scaled_flange_jacobian(q), compute_uv=False)[-1] > 0.2
    x, y, z = arm.base_T_flange(q).translation
    assert z >= 0.25 * arm.reach
    assert math.hypot(x, y) >= 0.3 * arm.reach
    hand = arm.base_T_flange(q).rotation.apply(looks(arm))
    assert z >= -0.42 * hand[2]
    down = arm.base_T_flange(q).rotation.apply([0.0, 0.0, -1.0])[2]
    assert down >= 0.6  # of all these the flange's z axis points away from the arm


@pytest.mark.slow
def test_a_small_arm_stands_high_enough_for_a_target_before_its_camera(tmp_path):
    small = tuple((name, tuple(0.75 * np.array(xyz)), *rest) for name, xyz, *rest in SIX)
    path = tmp_path / "arm.urdf"
    path.write_text(urdf(small, collision='<cylinder radius="0.02" length="0.05"/>'))
    arm = Arm(path)
    flange = arm.base_T_flange(suggested_posture(arm))
    hand = flange.rotation.apply(looks(arm))
    assert hand[2] < -0.6
    assert flange.translation[2] >= -0.42 * hand[2] > 0.4 * arm.reach


@pytest.mark.slow
def test_an_arm_may_stand_anywhere_in_its_file(tmp_path):
    """One of two arms stands beside the origin of their frame."""
    foot, found = np.array([-0.5, 0.7, 0.0]), []
    for place in (np.zeros(3), foot):
        path = tmp_path / "arm.urdf"
        name, xyz, *rest = SIX[0]
        path.write_text(urdf(((name, tuple(place + xyz), *rest), *SIX[1:])))
        arm = Arm(path)
        q = suggested_posture(arm)
        found.append(suggested_table(arm, suggested_mount(arm), q).pose.translation)
    np.testing.assert_allclose(found[1], found[0] + foot, atol=1e-9)


@pytest.mark.parametrize("twist", [0.0, 1e-9])
@pytest.mark.parametrize(("rpy", "way"), [((0, 0, 0.5), 2), ((math.pi, 0, 0), -2), ((0, -math.pi / 2, 0), 0)])
def test_the_mount_looks_away_from_the_arm_however_the_flange_is_turned(tmp_path, rpy, way, twist):
    path = tmp_path / "arm.urdf"
    path.write_text(urdf(SIX).replace('rpy="0 0 0.5"', f'rpy="{rpy[0] + twist} {rpy[1]} {rpy[2]}"'))
    arm = Arm(path)
    mount = suggested_mount(arm)
    np.testing.assert_allclose(looks(arm), math.copysign(1, way) * np.eye(3)[abs(way)], atol=1e-8)
    ahead = float(mount.translation @ looks(arm))
    np.testing.assert_allclose(mount.translation, ahead * looks(arm), atol=1e-9)
    assert 0.0905 <= ahead <= 0.15  # the last link reaches beyond the flange
    assert mount.rotation.as_rotvec()[2] == 0.0  # it does not turn about what it looks along


def test_the_camera_stands_clear_of_what_a_link_carries(tmp_path):
    ball = '<link name="ball"><collision><geometry><sphere radius="0.08"/></geometry></collision></link>'
    holder = '<joint name="holder" type="fixed"><origin xyz="0.2 0 0"/><parent link="lift_link"/>'
    path = tmp_path / "arm.urdf"
    path.write_text(urdf(SIX, extra=f'{ball}{holder}<child link="ball"/></joint>'))
    arm = Arm(path, flange="tool0")
    bodies = ArmBodies(arm, mounted=[solid.moved(suggested_mount(arm)) for solid in CAMERA_HOUSING])
    bodies.place(suggested_posture(arm))
    assert min(n.gap for n in bodies.near(0.2) if "camera" in bodies.names(n.pair)) >= 0.03
