"""What the flange carries among what stands still: told by its pose as MuJoCo tells it by the joints."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform
from tests.robots.test_arm_clearance import CAMERA, random_solid

from omniservo.robots import ArmBodies, load_arm, shipped_arms
from omniservo.robots.collision.carried_bodies import carried_too_close


@pytest.mark.parametrize("name", shipped_arms())
def test_a_pose_of_the_flange_tells_whether_what_it_carries_is_too_close(name):
    random, arm, told = np.random.default_rng(7), load_arm(name), set()
    for _ in range(60):
        q = random.uniform(arm.joint_range[:, 0], arm.joint_range[:, 1])
        flange = arm.base_T_flange(q)
        near = RigidTransform.from_translation(flange.translation + random.uniform(-0.1, 0.1, 3))
        around = [random_solid(random, f"{i}").moved(near) for i in range(2)]
        bodies = ArmBodies(arm, mounted=[CAMERA], surroundings=around)
        shapes, asked = bodies.shapes, bodies.asked(0.02, 0.002)
        bodies.place(q)
        own = [
            pair
            for pair, (stands, carried) in enumerate(bodies.pairs.tolist())
            if shapes.carried[stands] == 0 and shapes.carried[carried] == arm.dof
        ]
        left = min(bodies.measure(pair) - asked[pair] for pair in own)
        if abs(left) < 1e-4:
            continue
        elsewhere = RigidTransform.from_translation([0.0, 0.0, 20.0])
        poses = np.array([(elsewhere * flange).as_matrix(), flange.as_matrix()])
        assert carried_too_close(bodies, poses, asked) == (left < 0.0)
        assert not carried_too_close(bodies, poses[:1], asked)
        told.add(bool(left < 0.0))
    assert told == {True, False}
