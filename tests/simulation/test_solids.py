"""Obstacles of any kind as bodies of the simulator's world, and a world's shapes as triangles."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.planning.obstacles.obstacle import KINDS
from omniservo.simulation import World
from omniservo.simulation.body_meshes import BodyPoses, body_meshes, solid_triangles
from omniservo.simulation.ray_caster import MISS, RayCaster
from omniservo.viewer.new_obstacle import new_obstacle
from omniservo.viewer.open_viewed import open_viewed
from omniservo.whole_arm.solids_of import solids_of


@pytest.fixture(scope="module")
def situation():
    return open_viewed("whole-arm-1").situation


@pytest.mark.parametrize("kind", KINDS)
def test_rays_meet_an_obstacle_of_any_kind_where_its_distance_is_zero(situation, kind):
    obstacle = new_obstacle(kind, situation)
    solids = solids_of((obstacle,), situation.world_T_initial)
    world = World(replace(situation.arm.scene, solids=solids, boards=()))
    caster = RayCaster(world, sees_camera=False, sees_arm=False)
    caster.pose_arm(situation.arm.scene.start_joints)
    origin = np.array(situation.world_T_initial.translation)
    middle = situation.with_added(obstacle).handles[-1].translation
    spread = Rotation.from_rotvec(np.random.default_rng(1).normal(0.0, 0.05, (200, 3)))
    rays = spread.apply((middle - origin) / np.linalg.norm(middle - origin))
    geoms, distances, _ = caster.cast(origin, np.ascontiguousarray(rays))
    met = np.flatnonzero([g != MISS and world.body_of(int(g)) == "obstacle 0" for g in geoms])
    assert len(met) > 10
    places = situation.world_T_initial.inv().apply(origin + distances[met, None] * rays[met])
    tolerance = 0.03 if kind == "cloud" else 1e-6  # the boxes that hold a cloud's balls are met
    assert np.abs(obstacle.distance(np.ascontiguousarray(places))).max() < tolerance


def test_a_cylinder_is_an_obstacle_and_no_dot(situation):
    plain = World(situation.arm.scene)
    solids = solids_of((new_obstacle("cylinder", situation),), situation.world_T_initial)
    world = World(replace(situation.arm.scene, solids=solids))
    assert len(world.dot_geoms) == len(plain.dot_geoms) == 9
    assert len(world.obstacle_geoms) == len(plain.obstacle_geoms) + 1
    near = world.arm_obstacle_distance(world.data_at(situation.arm.scene.start_joints))
    assert 0.0 < near < 1.0


def test_a_solid_s_name_is_unique(situation):
    solids = tuple(
        replace(s, name="board 0") for s in solids_of(situation.problem.obstacles, RigidTransform.identity())
    )
    with pytest.raises(ValueError, match="'board 0' is given twice"):
        replace(situation.arm.scene, solids=solids)


def test_the_arm_s_triangles_lie_on_what_its_rays_meet(situation):
    scene = situation.arm.scene
    world = World(scene)
    places, quaternions = BodyPoses(world).at(scene.start_joints)
    meshes = body_meshes(world)
    camera = [mesh for mesh in meshes if mesh.name == "camera"]
    assert len(camera) == 1
    turn = Rotation.from_quat(quaternions[camera[0].body], scalar_first=True)
    vertices = turn.apply(camera[0].vertices) + places[camera[0].body]
    centre = scene.world_T_camera(scene.start_joints).translation
    assert np.linalg.norm(vertices - centre, axis=1).max() < 0.1
    assert {mesh.name for mesh in meshes} >= {"floor", "board 0"}
    assert sum(len(mesh.faces) for mesh in meshes) > 1000


@pytest.mark.parametrize(
    ("kind", "size"),
    [("sphere", [0.1]), ("capsule", [0.1, 0.2]), ("cylinder", [0.1, 0.2]), ("box", [0.1, 0.2, 0.3]),
     ("ellipsoid", [0.1, 0.2, 0.3])],
)  # fmt: skip
@pytest.mark.parametrize("unit", [1.0, 1e-3, 1e-5], ids=["large", "a tenth of a millimetre", "a micrometre"])
def test_triangles_of_a_solid_have_its_extents_however_small_it_is(kind, size, unit):
    shape = solid_triangles(kind, unit * np.array(size), None)
    half = {"sphere": [0.1] * 3, "capsule": [0.1, 0.1, 0.3], "cylinder": [0.1, 0.1, 0.2]}.get(kind, size)
    assert np.allclose(shape.bounds, unit * np.array([np.negative(half), half]), atol=2e-3 * unit)
    assert shape.is_watertight
    assert len(shape.faces) == len(solid_triangles(kind, np.array(size), None).faces)
