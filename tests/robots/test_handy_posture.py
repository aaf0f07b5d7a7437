"""The posture that is suggested to begin with."""

import math

import numpy as np
import pytest
from urdf_arms import SEVEN, SIX, fingers, urdf

from omniservo.robots import SELF_CLEARANCE, Arm, ArmBodies, handy_posture, load_arm, shipped_arms


@pytest.mark.parametrize("name", [*shipped_arms(), "six", "seven"])
def test_it_is_free_far_from_singular_and_the_hand_looks_down(tmp_path, name):
    path = tmp_path / "arm.urdf"
    path.write_text(urdf(SEVEN if name == "seven" else SIX, extra=fingers()))
    arm = load_arm(name) if name in shipped_arms() else Arm(path)
    q = handy_posture(arm)
    assert arm.within_limits(q)
    bodies = ArmBodies(arm)
    bodies.place(q)
    assert not bodies.near(SELF_CLEARANCE)
    assert np.linalg.svd(arm.scaled_flange_jacobian(q), compute_uv=False)[-1] > 0.2
    x, y, z = arm.base_T_flange(q).translation
    assert z >= 0.25 * arm.reach
    assert math.hypot(x, y) >= 0.3 * arm.reach
    down = arm.base_T_flange(q).rotation.apply([0.0, 0.0, -1.0])[2]
    assert down >= 0.6  # of all these the tool's z axis points out of the hand
