"""Rays cast together meet what each would meet alone."""

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from omniservo.cameras import preset
from omniservo.robots import Arm, load_arm, shipped_arms
from omniservo.scenes import Scene, SceneBox
from omniservo.simulation import World
from omniservo.simulation.ray_caster import RayCaster

_LINK = """<link name="l{k}">
  <inertial><origin xyz="0.02 0.03 0.08" rpy="0.4 0.5 0.6"/><mass value="2"/>
    <inertia ixx="0.02" ixy="0.004" ixz="0.002" iyy="0.012" iyz="0.003" izz="0.015"/></inertial>
  <visual><origin xyz="0 0.05 0.06"/><geometry><box size="0.04 0.16 0.12"/></geometry></visual>
  <collision><origin xyz="0 0 0.05"/><geometry><box size="0.08 0.05 0.1"/></geometry></collision>
</link>"""
_JOINT = """<joint name="j{k}" type="revolute">
  <parent link="l{k}"/><child link="l{n}"/><origin xyz="0 0 0.12"/><axis xyz="0 {y} {z}"/>
  <limit lower="-2" upper="2" velocity="2"/></joint>"""


def skew_arm(folder):
    """An arm whose links state their inertia as CAD programs do, and are seen where they are not touched."""
    links = "".join(_LINK.format(k=k) for k in range(7))
    joints = "".join(_JOINT.format(k=k, n=k + 1, y=k % 2, z=1 - k % 2) for k in range(6))
    path = folder / "arm.urdf"
    path.write_text(f'<robot name="skew">{links}{joints}</robot>')
    return Arm(path)


@pytest.mark.parametrize("name", [*shipped_arms(), "skew"])
def test_rays_meet_what_each_meets_alone(tmp_path, name):
    arm = skew_arm(tmp_path) if name == "skew" else load_arm(name)
    nowhere, middle = RigidTransform.identity(), arm.joint_range.mean(axis=1)
    posts = [
        SceneBox(f"post {k}", RigidTransform.from_translation([0.4, 0.3 * k, 0.2]), [0.1] * 3)
        for k in range(3)
    ]
    scene = Scene(arm, nowhere, nowhere, preset("perspective"), middle, obstacles=posts, floor=-0.3)
    world = World(scene)
    caster, groups = RayCaster(world, sees_camera=True), np.array([1, 1, 1, 0, 0, 0], dtype=np.uint8)
    rng = np.random.default_rng(0)
    for q in rng.uniform(*(middle + 0.5 * (arm.joint_range.T - middle)), (4, arm.dof)):
        caster.pose_arm(q)
        data = world.data_at(q)
        shown = np.flatnonzero(world.model.geom_group <= 2)
        eye = 1.5 * arm.reach * np.array([0.8, -0.5, 0.5])
        aims = data.geom_xpos[rng.choice(shown, 1500)] + rng.normal(0.0, 0.05, (1500, 3))
        ways = (aims - eye) / np.linalg.norm(aims - eye, axis=1, keepdims=True)
        _, distances, _ = caster.cast(eye, ways)
        alone = [mujoco.mj_ray(world.model, data, eye, way, groups, True, -1, None) for way in ways]
        assert np.count_nonzero(np.array(alone) > 0.0) > 300
        np.testing.assert_allclose(distances, alone, atol=1e-9)
