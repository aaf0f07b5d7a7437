"""Where an arm stands, and how large what it stands among is, changes nothing of what is proven."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.spatial.transform import RigidTransform, Rotation
from tests.robots.joint_paths import straight_joint_path
from tests.whole_arm.arm_scenes import FLANGE_T_CAMERA

from omniservo import cameras
from omniservo.errors import InputError
from omniservo.planning import Capsule, HalfSpace, Mesh, PlanningProblem
from omniservo.robots import CAMERA_HOUSING, ArmBodies, Solid, arm_clearance, load_arm
from omniservo.whole_arm import ArmSetting, plan_with_arm
from omniservo.whole_arm.solids_of import solids_of

STAND = np.radians([0.0, 20.0, 110.0, 0.0, 50.0, 0.0])
POINTS = np.array([[x, y, 0.5] for x in (-0.08, 0.0, 0.08) for y in (-0.08, 0.0, 0.08)])
AHEAD = RigidTransform.from_translation([0.0, 0.0, 0.1])


def rx60(tmp_path, *, place="0 0 0", shapes="", turned="1 0 0 0"):
    """An RX60 whose base stands elsewhere in its frame, with further shapes of the base."""
    text = load_arm("rx60").path.read_text()
    base = '<body name="base" childclass="arm">'
    there = f'<body name="base" childclass="arm" pos="{place}" quat="{turned}">{shapes}'
    file = tmp_path / "arm.xml"
    file.write_text(text.replace(base, there))
    return load_arm(file)


def planned(arm, obstacles=(), *, clearance=0.01, goal=AHEAD, points=POINTS):
    """What becomes of a motion ahead; obstacles are stated in the base frame, by ``base_T_initial``."""
    base_T_initial = arm.base_T_flange(STAND) * FLANGE_T_CAMERA
    obstacles = tuple(each(base_T_initial) for each in obstacles)
    problem = PlanningProblem(cameras.preset("fe185"), points, goal, obstacles=obstacles)
    setting = ArmSetting(
        arm, base_T_initial, FLANGE_T_CAMERA, start=STAND, mounted=CAMERA_HOUSING, clearance=clearance
    )
    return plan_with_arm(problem, setting)


def plane(normal, offset):
    """Free where normal·x ≥ offset, in the base frame."""

    def stated(base_T_initial):
        turned = base_T_initial.rotation.inv().apply(normal)
        return HalfSpace(turned / np.linalg.norm(turned), offset - base_T_initial.translation @ normal)

    return stated


@pytest.mark.parametrize("place", ["0 0 0", "4 0 0", "8 0 0", "0 0 6", "-300 70 20", "0 0 30000"])
def test_a_wall_is_a_wall_wherever_the_arm_stands(tmp_path, place):
    """68 mm inside the upper arm, and 20 mm beside it."""
    arm, y = rx60(tmp_path, place=place), float(place.split()[1])
    inside = planned(arm, [plane([0.0, -1.0, 0.0], -0.04 - y)])
    assert inside.plan.status == "infeasible"
    assert "obstacle 0" in inside.plan.reason
    beside = planned(arm, [plane([0.0, -1.0, 0.0], -0.1285 - y)])
    assert beside.certified
    assert beside.clearance.proven < 0.0105


def test_the_gap_of_every_kind_of_shape_to_a_half_space_is_its_lowest_point():
    """By the definition: the least n·x over 20 000 points of its surface, or over its corners."""
    random, arm = np.random.default_rng(3), load_arm("rx60")
    sphere = random.normal(size=(20000, 3))
    sphere /= np.linalg.norm(sphere, axis=1, keepdims=True)
    rim = np.column_stack([np.cos(t := np.linspace(0, 2 * np.pi, 20000)), np.sin(t), np.zeros(20000)])
    signs = np.array(np.meshgrid(*[(-1, 1)] * 3)).reshape(3, -1).T
    hull = random.uniform(-0.1, 0.1, (9, 3))
    kinds = {
        "sphere": ([0.07], 0.07 * sphere),
        "capsule": ([0.03, 0.1], np.concatenate([0.03 * sphere + [0, 0, z] for z in (-0.1, 0.1)])),
        "cylinder": ([0.03, 0.1], np.concatenate([0.03 * rim + [0, 0, z] for z in (-0.1, 0.1)])),
        "box": ([0.02, 0.05, 0.1], signs * [0.02, 0.05, 0.1]),
        "ellipsoid": ([0.02, 0.05, 0.1], sphere * [0.02, 0.05, 0.1]),
        "hull": ([], hull),
    }
    for kind, (size, surface) in kinds.items():
        pose = RigidTransform.from_components(random.uniform(-0.1, 0.1, 3), Rotation.random(rng=random))
        carried = Solid(kind, kind, np.array(size), pose, hull if kind == "hull" else None)
        normal, q = Rotation.random(rng=random).apply([0, 0, 1]), random.uniform(-1, 1, 6)
        at = arm.base_T_flange(q) * pose
        for depth in (-0.05, 0.0, 0.3):  # inside, touching, away
            lowest = (at.apply(surface) @ normal).min()
            side = Solid.half_space("side", normal, lowest - depth)
            bodies = ArmBodies(arm, mounted=[carried], surroundings=[side])
            pair = next(i for i in range(len(bodies.pairs)) if bodies.names(i) == ("camera", "side"))
            bodies.place(q)
            assert bodies.measure(pair) == pytest.approx(
                depth, abs=5e-5 if kind in ("sphere", "capsule", "ellipsoid") else 1e-8
            )
            assert bodies.lower_gaps(np.array([pair]))[0] == bodies.measure(pair)
            assert bodies.scene.normals[pair] == pytest.approx(normal, abs=1e-12)


def test_ellipsoids_of_an_arm_are_kept_off_a_half_space(tmp_path):
    """The support of an ellipsoid is that of the ball it is stretched from."""
    size, normal = np.array([0.02, 0.3, 0.1]), np.array([0.6, 0.0, 0.8])
    arm = rx60(tmp_path)
    text = arm.path.read_text().replace(
        '<site name="flange"', '<geom type="ellipsoid" size="0.02 0.3 0.1" pos="0 0 0.4"/><site name="flange"'
    )
    arm.path.write_text(text)
    arm = load_arm(arm.path)
    side = Solid.half_space("side", normal, -5.0)
    bodies = ArmBodies(arm, surroundings=[side])
    bodies.place(STAND)
    shape = int(np.flatnonzero(bodies.shapes.kinds == 4)[0])
    pair = next(i for i, (_, b) in enumerate(bodies.pairs.tolist()) if b == shape and bodies.is_around(i))
    axes, place = bodies.scene.axes[shape].reshape(3, 3), bodies.scene.places[shape]
    expected = normal @ place - np.linalg.norm(size * (normal @ axes)) + 5.0
    assert bodies.measure(pair) == pytest.approx(expected, abs=1e-12)


def test_the_distance_of_an_ellipsoid_from_a_ball_is_that_of_its_nearest_point(tmp_path):
    """By Lagrange's multiplier: Σ (s p / (s² + t))² = 1."""
    size, arm, random = np.array([0.02, 0.3, 0.1]), rx60(tmp_path), np.random.default_rng(2)
    words = '<geom type="ellipsoid" size="0.02 0.3 0.1" pos="0 0 0.4"/><site name="flange"'
    arm.path.write_text(arm.path.read_text().replace('<site name="flange"', words))
    arm = load_arm(arm.path)
    for _ in range(10):
        ball = Solid.sphere("ball", random.uniform([-1, -1, 1.5], [1, 1, 3.5]), 0.1)
        bodies = ArmBodies(arm, surroundings=[ball])
        bodies.place(random.uniform(-1.0, 1.0, 6))
        shape = int(np.flatnonzero(bodies.shapes.kinds == 4)[0])
        pair = next(i for i, (_, b) in enumerate(bodies.pairs.tolist()) if b == shape and bodies.is_around(i))
        axes, place = bodies.scene.axes[shape].reshape(3, 3), bodies.scene.places[shape]
        p = (ball.pose.translation - place) @ axes
        t = brentq(lambda t, p=p: np.sum((size * p / (size**2 + t)) ** 2) - 1.0, 0.0, 9.0, xtol=1e-15)
        expected = np.linalg.norm(p - size**2 * p / (size**2 + t)) - 0.1
        assert bodies.measure(pair) == pytest.approx(expected, abs=1e-6)
        assert bodies.lower_gaps(np.array([pair]))[0] <= expected + 1e-12


def test_a_floor_below_an_upright_first_axis_is_no_nearer_when_it_turns():
    """So a base beside the floor takes no posture's worth of proof; a floor that leans does."""
    arm = load_arm("rx60")
    for normal, first in (([0.0, 0.0, 1.0], 1), ([0.0, 1e-6, 1.0], 0)):
        side = Solid.half_space("floor", np.array(normal) / np.linalg.norm(normal), -0.1)
        bodies = ArmBodies(arm, surroundings=[side])
        around = [i for i in range(len(bodies.pairs)) if bodies.is_around(i)]
        assert set(bodies.shapes.first_between[around].tolist()) == {first}


def test_a_long_rod_that_nearly_lies_on_an_axis_is_not_taken_to_lie_on_it():
    """Its end is 0.9 mm beside the axis of joint 1, round which it goes as the joint turns."""
    arm, first = load_arm("rx60"), {}
    for tilt in (0.0, 0.9e-9):
        pose = RigidTransform.from_components([0, 0, 1e6 + 2.0], Rotation.from_rotvec([tilt, 0, 0]))
        rod = Solid("rod", "capsule", np.array([0.1, 1e6]), pose)
        bodies = ArmBodies(arm, surroundings=[rod])
        around = [i for i in range(len(bodies.pairs)) if bodies.is_around(i)]
        first[tilt] = set(bodies.shapes.first_between[around].tolist())
    assert first == {0.0: {1}, 0.9e-9: {0}}


@pytest.mark.parametrize(("off", "joint"), [(0.0, 1), (5e-10, 1), (3e-9, 0), (1e-3, 0)])
def test_a_ball_is_on_an_axis_if_it_is_so_within_what_rounding_is_allowed(off, joint):
    bodies = ArmBodies(load_arm("rx60"), surroundings=[Solid.sphere("ball", [off, 0.0, 1.5], 0.1)])
    around = [i for i in range(len(bodies.pairs)) if bodies.is_around(i)]
    assert set(bodies.shapes.first_between[around].tolist()) == {joint}


def test_a_half_space_cannot_be_carried_and_can_be_moved():
    arm = load_arm("rx60")
    side = Solid.half_space("side", [0.0, 0.0, 1.0], -0.5)
    with pytest.raises(InputError, match="mounted: a half-space given"):
        ArmBodies(arm, mounted=[side])
    bodies = ArmBodies(arm, surroundings=[side])
    assert bodies.move_surroundings([Solid.half_space("side", [1.0, 0.0, 0.0], -0.9)])
    built = ArmBodies(arm, surroundings=[Solid.half_space("side", [1.0, 0.0, 0.0], -0.9)])
    for each in (bodies, built):
        each.place(STAND)
    for pair in range(len(built.pairs)):
        assert bodies.measure(pair) == pytest.approx(built.measure(pair), abs=1e-12)
    for own, other in zip(bodies.shapes, built.shapes, strict=True):
        np.testing.assert_allclose(own, other, atol=1e-12)


@pytest.mark.parametrize("size", [1.0, 10.0, 1e3, 1e5])
def test_a_block_given_as_a_mesh_has_the_gap_of_its_own_vertices(size):
    """Its top is 25 mm below the shoulder of the RX60; it lies obliquely in the camera's frame."""
    arm, start = load_arm("rx60"), STAND + np.radians([5.0, 3.0, -7.0, 10.0, 4.0, 6.0])
    base_T_initial = arm.base_T_flange(start) * FLANGE_T_CAMERA
    corners = [
        [i, j, k] for i in (-0.7 * size, 0.9 * size) for j in (-0.8 * size, 0.6 * size) for k in (-size, 0.2)
    ]
    block = Mesh(base_T_initial.inv().apply(corners))
    problem = PlanningProblem(
        cameras.preset("fe185"),
        POINTS - [0, 0, 0.3],
        RigidTransform.from_translation([0, 0, -0.05]),
        obstacles=(block,),
    )
    setting = ArmSetting(arm, base_T_initial, FLANGE_T_CAMERA, start=start, mounted=CAMERA_HOUSING)
    slack = 2e-8 + 3e-13 * size
    enough = plan_with_arm(problem, replace(setting, clearance=0.025 - slack))
    assert enough.certified, enough.plan.reason
    assert 0.0 <= enough.clearance.proven <= slack
    too_much = plan_with_arm(problem, replace(setting, clearance=0.025 + slack))
    assert not too_much.certified


@pytest.mark.parametrize("thickness", [1e-5, 1e-8])
def test_a_mesh_may_be_as_thin_or_small_as_a_mesh_can_be(thickness):
    """A plate between the camera and where it goes, and a grain there: MuJoCo takes neither as a mesh."""
    arm = load_arm("rx60")
    base_T_initial = arm.base_T_flange(STAND) * FLANGE_T_CAMERA
    setting = ArmSetting(arm, base_T_initial, FLANGE_T_CAMERA, start=STAND, mounted=CAMERA_HOUSING)
    plate = [[x, y, z] for x in (-0.02, 0.02) for y in (-0.02, 0.02) for z in (0.05, 0.05 + thickness)]
    grain = np.array([0.0, 0.0, 0.05]) + thickness * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    for vertices in (plate, grain):
        if thickness < 1e-7 and vertices is grain:
            continue
        problem = PlanningProblem(cameras.preset("fe185"), POINTS, AHEAD, obstacles=(Mesh(vertices),))
        bodies = setting.bodies(problem.obstacles)
        bodies.place(STAND)
        pairs = [i for i in range(len(bodies.pairs)) if bodies.names(i) == ("camera", "obstacle 0")]
        assert min(map(bodies.measure, pairs)) == pytest.approx(0.045, abs=1e-8)
        behind = Mesh(np.array(vertices) - [0.0, 0.0, 0.05 + 0.06])  # inside the housing
        inside = plan_with_arm(replace(problem, obstacles=(behind,)), setting)
        assert inside.plan.status == "infeasible"


def test_rods_far_away_and_against_the_z_axis_are_where_they_are_stated():
    """Ends a million metres apart; the axis is all but −z, where rotations onto it are badly conditioned."""
    for tilt in (0.0, 1e-9, 1e-6, 1e-3):
        start, end = np.zeros(3), 1e6 * np.array([np.sin(tilt), 0.0, -np.cos(tilt)])
        (rod,) = solids_of((Capsule(start, end, 0.1),), RigidTransform.identity())
        own = rod.pose.apply([[0.0, 0.0, -rod.size[1]], [0.0, 0.0, rod.size[1]]])
        assert np.abs(own - [start, end]).max() < 1e-9


@pytest.mark.parametrize("off", [3e-7, 1e-6, 1e-5])
def test_shapes_lie_where_they_are_stated_and_not_where_their_frame_nearly_is(off):
    """A box a little off its frame in place and turn: MuJoCo takes frames so near for one."""
    pose = RigidTransform.from_components([off, 0.0, 0.0], Rotation.from_rotvec([0.0, off, 0.0]))
    bodies = ArmBodies(load_arm("rx60"), surroundings=[Solid.box("table", pose, [3.0, 3.0, 0.1])])
    shape = int(bodies.pairs[bodies._has_surroundings][0, 0])
    bodies.place(np.zeros(6))
    for places, axes in (
        (bodies.shapes.places, bodies.shapes.axes),
        (bodies.scene.places, bodies.scene.axes),
    ):
        assert places[shape] == pytest.approx(pose.translation, abs=1e-15)
        assert axes[shape].reshape(3, 3) == pytest.approx(pose.rotation.as_matrix(), abs=1e-15)


def test_what_is_allowed_for_rounding_grows_with_coordinates(tmp_path):
    """The same arm and ball, here and 10 000 km away: what is proven is less by at least what places lose."""
    ball = Solid.sphere("ball", [0.5, 0.3, 0.2], 0.05)
    near = rx60(tmp_path)
    path = straight_joint_path(STAND, STAND + 0.01)
    here = arm_clearance(ArmBodies(near, surroundings=[ball]), path, clearance=0.0)
    far = rx60(tmp_path, place="10000000 0 0")
    there = Solid.sphere("ball", [1e7 + 0.5, 0.3, 0.2], 0.05)
    away = arm_clearance(ArmBodies(far, surroundings=[there]), path, clearance=0.0)
    assert here.status == away.status == "clear"
    assert 1e-7 < here.proven - away.proven < 1e-4
