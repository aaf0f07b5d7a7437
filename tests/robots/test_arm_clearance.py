"""Whole-arm clearance: what it proves holds wherever one looks, and what it cannot prove it shows."""

import mujoco
import numpy as np
import pytest
from scipy.interpolate import BPoly
from scipy.optimize import lsq_linear, minimize
from scipy.spatial.transform import RigidTransform, Rotation
from tests.robots.joint_paths import straight_joint_path

from omniservo.errors import InputError
from omniservo.robots import ArmBodies, JointPath, Solid, Tube, arm_clearance, load_arm, shipped_arms
from omniservo.robots.collision.gap_kernels import farthest_moves, lower_gaps, middle_of_piece
from omniservo.robots.collision.gap_search import widen
from omniservo.robots.collision.shapes import Bodies

TABLE = Solid.box("table", RigidTransform.from_translation([0.55, 0.0, 0.0]), [0.3, 0.6, 0.1])
CAMERA = Solid.box("camera", RigidTransform.from_translation([0.0, 0.0, 0.05]), [0.03, 0.02, 0.05])


def random_solid(random, name):
    kind = ("sphere", "capsule", "cylinder", "box", "ellipsoid", "hull")[random.integers(6)]
    pose = RigidTransform.from_components(random.uniform(-0.3, 0.3, 3), Rotation.random(rng=random))
    count = {"sphere": 1, "capsule": 2, "cylinder": 2, "box": 3, "ellipsoid": 3, "hull": 0}[kind]
    vertices = random.uniform(-0.1, 0.1, (12, 3)) if kind == "hull" else None
    return Solid(name, kind, random.uniform(0.01, 0.1, count), pose, vertices)


def inside(solid, local):
    """Points (m, 3) in [−1, 1]³ to points of the solid, in its outer frame."""
    if solid.kind == "box":
        points = local * solid.size
    elif solid.kind == "ellipsoid":
        points = local / np.maximum(1.0, np.linalg.norm(local, axis=1, keepdims=True)) * solid.size
    elif solid.kind == "hull":
        weights = np.abs(local @ np.random.default_rng(0).normal(size=(3, len(solid.vertices)))) + 1e-9
        points = (weights / weights.sum(axis=1, keepdims=True)) @ solid.vertices
    else:
        radius = local[:, :3] / np.maximum(1.0, np.linalg.norm(local, axis=1, keepdims=True))
        points = radius * solid.size[0]
        if solid.kind == "capsule":
            points[:, 2] += local[:, 2] * solid.size[1]
        elif solid.kind == "cylinder":
            flat = local[:, :2] / np.maximum(1.0, np.linalg.norm(local[:, :2], axis=1, keepdims=True))
            points = np.column_stack([flat * solid.size[0], local[:, 2] * solid.size[1]])
    return solid.pose.apply(points)


@pytest.mark.parametrize("seed", range(12))
def test_no_two_points_of_a_pair_are_nearer_than_its_lower_gap(seed):
    random = np.random.default_rng(seed)
    arm = load_arm("rx60")
    carried, stands = random_solid(random, "a"), random_solid(random, "b")
    bodies = ArmBodies(arm, mounted=[carried], surroundings=[stands])
    pair = next(i for i in range(len(bodies.pairs)) if bodies.names(i) == ("camera", "b"))
    q = random.uniform(-1.0, 1.0, 6)
    bodies.place(q)
    own, other = (
        inside(carried, random.uniform(-1, 1, (4000, 3))),
        inside(stands, random.uniform(-1, 1, (4000, 3))),
    )
    sampled = np.linalg.norm(arm.base_T_flange(q).apply(own) - other, axis=1).min()
    chosen = np.array([pair])
    rough = bodies.lower_gaps(chosen)[0]
    found = bodies.measure(pair)
    sharp = bodies.lower_gaps(chosen)[0]
    assert rough <= sharp <= sampled
    assert sharp == pytest.approx(found, abs=2e-5)


def test_slabs_are_looked_at_only_where_balls_do_not_leave_enough():
    arm = load_arm("panda")
    bodies, every = ArmBodies(arm, mounted=[CAMERA], surroundings=[TABLE]), np.inf
    bodies.place(np.full(arm.dof, 0.4))
    for pair in range(len(bodies.pairs)):
        bodies.measure(pair)
    shapes, scene, found = bodies.shapes, bodies.scene, {}
    solids = shapes.kinds, shapes.sizes, shapes.radii, shapes.corners, shapes.firsts
    placed = Bodies(*solids, scene.places, scene.axes)
    for enough in (-np.inf, 0.05, every):
        found[enough] = np.empty(len(bodies.pairs))
        within = np.full(len(bodies.pairs), enough)
        every_pair = np.arange(len(bodies.pairs))
        lower_gaps(placed, bodies.pairs, every_pair, scene.normals, within, found[enough])
    balls = found[-np.inf]
    assert (found[every] > balls).any()
    assert ((balls >= 0.05) & (found[every] > balls)).any()
    np.testing.assert_array_equal(found[0.05], np.where(balls >= 0.05, balls, found[every]))


@pytest.mark.slow
def test_bounds_of_a_distance_that_a_search_finds_hold_it_between_them_and_meet():
    """By MuJoCo's distances, beginning from nowhere and from what was found; ends are as far apart."""
    random, arm, apart, touching = np.random.default_rng(4), load_arm("rx60"), 0, 0
    for _ in range(12):
        carried = [random_solid(random, "a"), random_solid(random, "b")]
        stands = [random_solid(random, name) for name in ("c", "d")]
        bodies = ArmBodies(arm, mounted=carried, surroundings=stands)
        shapes, scene = bodies.shapes, bodies.scene
        solids = shapes.kinds, shapes.sizes, shapes.radii, shapes.corners, shapes.firsts
        placed = Bodies(*solids, scene.places, scene.axes)
        for pair, (i, j) in [each for _ in range(5) for each in enumerate(bodies.pairs)]:
            if pair == 0:
                bodies.place(random.uniform(-1.5, 1.5, 6))
            gap, normal, ends = bodies.measure(pair), np.zeros(3), np.empty(6)
            for _ in range(2):
                least, most = widen(placed, i, j, normal, ends, np.empty((4, 7)))
                assert least <= gap + 1e-6
                if gap < 0.0:
                    assert most == np.inf
                    continue
                assert most == pytest.approx(gap, abs=2e-6)
                assert least == pytest.approx(gap, abs=2e-6)
                assert np.linalg.norm(ends[3:] - ends[:3]) == pytest.approx(most, abs=1e-9)
                assert normal == pytest.approx(scene.normals[pair], abs=2e-3 + 1e-5 / gap)
            apart += gap > 0.0
            touching += gap < 0.0
    assert apart > 3000
    assert touching > 30


@pytest.mark.parametrize("seed", range(6))
def test_surroundings_that_were_moved_are_as_if_built_there(seed):
    random = np.random.default_rng([8, seed])
    arm, kinds = load_arm("rx60"), ("sphere", "capsule", "cylinder", "box", "hull", "ellipsoid")

    def solids(hull):
        made = []
        while len(made) < len(kinds):
            solid = random_solid(random, kinds[len(made)])
            if solid.kind == solid.name:
                made.append(hull if solid.kind == "hull" and hull else solid)
        return made

    first = solids(None)
    first[0] = Solid.sphere("sphere", [0.0, 0.0, 0.4], 0.05)  # on joint 1's axis, that need not turn
    there = solids(first[4])
    parts = ArmBodies(arm, mounted=[CAMERA], surroundings=first).tube_parts
    tube = Tube(np.full(6, 0.01), dict.fromkeys(parts, 0.02), 0.01, 1.0, 0.02, 0.01)
    moved, built = (ArmBodies(arm, mounted=[CAMERA], surroundings=each, tube=tube) for each in (first, there))
    assert moved.move_surroundings(there)
    np.testing.assert_allclose(moved.asked(0.01, 0.002), built.asked(0.01, 0.002), atol=1e-12)
    for own, other in zip(moved.shapes, built.shapes, strict=True):
        np.testing.assert_allclose(own, other, atol=1e-12)
    for _ in range(3):
        q = random.uniform(*arm.joint_range.T)
        moved.place(q)
        built.place(q)
        np.testing.assert_allclose(moved.corners(q), built.corners(q), atol=1e-12)
        for pair in range(len(built.pairs)):
            assert moved.measure(pair) == pytest.approx(built.measure(pair), abs=1e-6)


def test_bodies_of_one_name_are_one_thing_of_which_each_is_judged():
    near, far = (Solid.sphere("tree", [0.0, y, 1.0], 0.1) for y in (0.5, 3.0))
    bodies = ArmBodies(load_arm("rx60"), surroundings=[TABLE, far, near])
    bodies.place(np.zeros(6))
    seen = [bodies.names(pair)[1] for pair in range(len(bodies.pairs)) if bodies.is_around(pair)]
    assert seen.count("tree") == 2 * seen.count("table")
    assert dict.fromkeys(seen) == dict.fromkeys(["table", "tree"])
    gaps = [bodies.measure(pair) for pair in range(len(bodies.pairs)) if bodies.names(pair)[1] == "tree"]
    alone = ArmBodies(load_arm("rx60"), surroundings=[near])
    alone.place(np.zeros(6))
    assert min(gaps) == pytest.approx(
        min(alone.measure(p) for p in range(len(alone.pairs)) if alone.is_around(p))
    )
    assert bodies.move_surroundings([TABLE, near, far])


def test_surroundings_that_are_others_are_not_moved():
    bodies = ArmBodies(load_arm("rx60"), surroundings=[TABLE])
    ball, hull = Solid.sphere("table", [0, 0, 1], 0.1), random_solid(np.random.default_rng(1), "hull")
    for others in ([], [ball], [TABLE, ball], [hull]):
        assert not bodies.move_surroundings(others)
    assert bodies.move_surroundings([TABLE])
    stone = Solid("stone", "hull", [], RigidTransform.identity(), np.eye(4, 3))
    bodies = ArmBodies(load_arm("rx60"), surroundings=[stone])
    assert bodies.move_surroundings([stone])
    assert not bodies.move_surroundings([stone.moved(RigidTransform.from_translation([0.0, 0.0, 0.1]))])


def test_the_distance_of_two_boxes_is_that_of_a_quadratic_program():
    random = np.random.default_rng(3)
    arm = load_arm("rx60")
    for _ in range(5):
        poses = [
            RigidTransform.from_components(random.uniform(-0.2, 0.2, 3), Rotation.random(rng=random))
            for _ in "ab"
        ]
        boxes = [Solid.box(n, p, random.uniform(0.01, 0.05, 3)) for n, p in zip("ab", poses, strict=True)]
        bodies = ArmBodies(arm, mounted=boxes[:1], surroundings=boxes[1:])
        bodies.place(np.full(6, 0.3))
        pair = next(i for i in range(len(bodies.pairs)) if bodies.names(i) == ("camera", "b"))
        bodies.measure(pair)
        base_T_a = arm.base_T_flange(np.full(6, 0.3)) * poses[0]

        def square(y, base_T_a=base_T_a, poses=poses, boxes=boxes):
            gap = base_T_a.apply(y[:3] * boxes[0].size) - poses[1].apply(y[3:] * boxes[1].size)
            return float(gap @ gap)

        best = minimize(square, np.zeros(6), bounds=[(-1, 1)] * 6, options={"ftol": 1e-14, "gtol": 1e-12})
        assert bodies.lower_gaps(np.array([pair]))[0] == pytest.approx(np.sqrt(best.fun), abs=1e-5)


def pair_moves(bodies, turns):
    """How far the shapes of every pair can come closer [m] while joints turn by ``turns``."""
    scene, shapes = bodies.scene, bodies.shapes
    places = (scene.anchors, scene.directions, scene.places, shapes.radii, shapes.carried, shapes.spins)
    farthest_moves(*places, turns, scene.moves)
    return scene.moves[bodies.pairs[:, 1], shapes.first_between]


@pytest.mark.parametrize("name", shipped_arms())
def test_no_pair_comes_closer_by_more_than_its_bound(name):
    arm, random = load_arm(name), np.random.default_rng(5)
    bodies = ArmBodies(arm, mounted=[CAMERA], surroundings=[TABLE])
    pairs = range(len(bodies.pairs))
    sharpest = 0.0
    for _ in range(8):
        q = random.uniform(*arm.joint_range.T)
        turns = random.uniform(0.0, 0.3, arm.dof) * (random.uniform(size=arm.dof) < 0.5)
        bodies.place(q)
        bounds, before = pair_moves(bodies, turns), np.array([bodies.measure(pair) for pair in pairs])
        for _ in range(3):
            bodies.place(q + random.choice([-1.0, 1.0], arm.dof) * turns)
            after = np.array([bodies.measure(pair) for pair in pairs])
            taken = np.abs(after - before)[(before > 0.0) & (after > 0.0)]
            bound = bounds[(before > 0.0) & (after > 0.0)]
            assert (taken <= bound + 1e-5).all()
            sharpest = max(sharpest, float((taken[bound > 0.05] / bound[bound > 0.05]).max(initial=0.0)))
    assert sharpest > 0.3


def test_a_point_of_a_folded_chain_moves_no_farther_than_its_bound():
    """Random flat chains of three joints, whose turns add up."""
    random = np.random.default_rng(11)
    largest = 0.0
    for _ in range(3000):
        anchors = np.column_stack([random.normal(size=(3, 2)), np.zeros(3)])
        place, turns = np.append(random.normal(size=2), 0.0)[None], random.uniform(0.2, 1.0, 3)
        moves = np.zeros((1, 4))
        axes = np.tile([0.0, 0.0, 1.0], (3, 1))
        three = np.full(1, 3)
        farthest_moves(anchors, axes, place, np.zeros(1), three, np.zeros(1, dtype=np.int64), turns, moves)
        point = place[0]
        for joint in (2, 1, 0):
            turned = Rotation.from_rotvec([0.0, 0.0, random.choice([-1, 1]) * turns[joint]])
            point = anchors[joint] + turned.apply(point - anchors[joint])
        moved = np.linalg.norm(point - place[0])
        assert moved <= moves[0, 0] + 1e-12
        largest = max(largest, moved / moves[0, 0])
    assert largest > 0.7


@pytest.mark.parametrize("seed", range(6))
def test_halves_of_a_piece_are_the_piece_and_its_turns_bound_it(seed):
    piece = np.random.default_rng(seed).normal(size=(6, 3))
    piece[seed] *= 30.0  # whichever coefficient is farthest off
    first, second, turns = np.empty((6, 3)), np.empty((6, 3)), np.empty(3)
    middle_of_piece(piece, first, second, turns)
    whole = BPoly(piece[:, None], [0.0, 1.0])
    np.testing.assert_allclose(turns, np.abs(piece - whole(0.5)).max(axis=0), atol=1e-13)
    for part, ends in ((first, (0.0, 0.5)), (second, (0.5, 1.0))):
        half = BPoly(part[:, None], ends)
        w = np.linspace(*ends, 50)
        np.testing.assert_allclose(half(w), whole(w), atol=1e-13)
        assert (np.abs(whole(w) - whole(0.5)) <= turns + 1e-13).all()


@pytest.mark.parametrize("name", shipped_arms())
def test_what_is_proven_holds_wherever_one_looks(name):
    """Contacts come from MuJoCo's collision detection, which is not what the proof asks."""
    arm, random = load_arm(name), np.random.default_rng(7)
    bodies = ArmBodies(arm, mounted=[CAMERA], surroundings=[TABLE])
    statuses = set()
    for _ in range(16):
        begin = 0.7 * random.uniform(*arm.joint_range.T)
        path = straight_joint_path(begin, begin + random.uniform(-0.5, 0.5, arm.dof))
        found = arm_clearance(bodies, path, clearance=0.01)
        statuses.add(found.status)
        least = min(_left(bodies, path(w)) for w in np.linspace(0.0, 1.0, 60))
        if found.status == "clear":
            assert found.proven >= 0.0
            assert least >= found.proven - 1e-9
        else:
            assert found.status == "too_close"
            assert found.closest.gap < (0.01 if found.closest.other == "table" else 0.002)
            assert found.closest.link in found.reason
    assert statuses == {"clear", "too_close"}


def _left(bodies, q):
    """What is left beyond the clearance of the closest pair, by MuJoCo's distances; 1 where all is far."""
    bodies.place(q)
    asked = [0.01 if bodies.is_around(i) else 0.002 for i in range(len(bodies.pairs))]
    near = bodies.near(0.02)
    return min((one.gap - asked[one.pair] for one in near), default=1.0)


def test_a_needle_between_samples_is_found():
    """Two balls of half a millimetre meet for a thousandth of the path."""
    arm = load_arm("rx60")
    path = straight_joint_path(
        np.array([-0.5, 0.6, -1.0, 0.1, 1.2, 0.2]), np.array([0.6, 0.7, -1.1, 0.1, 1.2, 0.2])
    )
    tip = Solid.sphere("tip", [0.0, 0.0, 0.2], 5e-4)
    needle = Solid.sphere("needle", arm.base_T_flange(path(0.4137)).apply([0.0, 0.0, 0.2]), 5e-4)
    alone, beside = ArmBodies(arm, mounted=[tip]), ArmBodies(arm, mounted=[tip], surroundings=[needle])
    assert arm_clearance(alone, path, clearance=0.0).status == "clear"
    found = arm_clearance(beside, path, clearance=0.0)
    assert found.status == "too_close"
    assert found.closest.other == "needle"
    for w in np.linspace(0.0, 1.0, 17):
        beside.place(path(w))
        assert all(beside.names(one.pair)[1] != "needle" for one in beside.near(0.0))


LINKS = ("base", "shoulder", "upper_arm", "elbow", "forearm", "wrist")


@pytest.mark.parametrize("joint", range(6))
def test_a_needle_on_any_link_is_found_whichever_joint_alone_brings_the_camera_to_it(tmp_path, joint):
    """It stands on the link before the joint; tip and needle meet for less than a hundredth of the path."""
    arm, link = load_arm("rx60"), LINKS[joint]
    begin = np.array([-0.5, 0.6, -1.0, 0.1, 1.2, 0.2])
    path = straight_joint_path(begin, begin + np.eye(6)[joint])
    tip = Solid.sphere("tip", [0.06, 0.0, 0.2], 5e-4)
    alone = ArmBodies(arm, mounted=[tip])
    assert arm_clearance(alone, path, clearance=0.0).status == "clear"
    alone.place(path(0.127))  # where a piece of the path begins
    there, stands = alone.scene.places[alone.shapes_of("camera")[0]], alone._data.body(link)
    place = stands.xmat.reshape(3, 3).T @ (there - stands.xpos)
    needle = f'<geom type="sphere" size="5e-4" pos="{" ".join(map(repr, place.tolist()))}"/>'
    text, begins = arm.path.read_text(), f'<body name="{link}"'
    rest = text.index(">", text.index(begins)) + 1
    file = tmp_path / "arm.xml"
    file.write_text(f"{text[:rest]}{needle}{text[rest:]}")
    found = arm_clearance(ArmBodies(load_arm(file), mounted=[tip]), path, clearance=0.0, self_clearance=0.0)
    assert (found.status, found.closest.link, found.closest.other) == ("too_close", "camera", link)
    assert found.closest.w == pytest.approx(0.127, abs=0.01)


@pytest.mark.parametrize("name", shipped_arms())
def test_every_pair_is_judged(name, monkeypatch):
    """One pair after the other is asked for 10 m, the others for nothing."""
    bodies, q = ArmBodies(load_arm(name), mounted=[CAMERA], surroundings=[TABLE]), np.full(7, 0.4)
    for pair in range(len(bodies.pairs)):
        asked = np.full(len(bodies.pairs), -10.0)
        asked[pair] = 10.0
        monkeypatch.setattr(bodies, "asked", lambda *_, asked=asked: asked)
        found = arm_clearance(bodies, still(q[: bodies.arm.dof]), clearance=0.0)
        assert found.status == "too_close"
        assert (found.closest.link, found.closest.other) == bodies.names(pair)


def test_the_slope_of_a_gap_is_its_finite_difference():
    arm, random = load_arm("panda"), np.random.default_rng(2)
    bodies = ArmBodies(arm, mounted=[CAMERA], surroundings=[TABLE])
    seen = np.zeros(2, dtype=int)
    for _ in range(30):
        q = 0.8 * random.uniform(*arm.joint_range.T)
        bodies.place(q)
        for one in bodies.near(0.2):
            numeric = np.empty(arm.dof)
            for i in range(arm.dof):
                step = 1e-5 * np.eye(arm.dof)[i]
                ends = []
                for sign in (1.0, -1.0):
                    bodies.place(q + sign * step)
                    ends.append(bodies.measure(one.pair))
                numeric[i] = (ends[0] - ends[1]) / 2e-5
            # where the nearest points jump along a flat side the gap has no slope; few pairs do
            own = int(bodies.shapes.carried[bodies.pairs[one.pair, 0]] > 0)
            seen[own] += np.allclose(one.slope, numeric, atol=2e-3) and np.abs(numeric).max() > 0.05
            assert np.abs(one.slope).max() < 2.0
    assert seen[0] >= 3
    assert seen[1] >= 30


def still(q):
    """A path that ends where it begins."""
    once = np.ones((1, len(q)))
    return JointPath(np.zeros(1), q[None], once, once, np.ones(1), once, (), 0.0)


def test_a_path_of_one_posture_is_judged_there():
    assert arm_clearance(ArmBodies(load_arm("rx60")), still(np.zeros(6)), clearance=0.01).status == "clear"


@pytest.mark.parametrize("name", shipped_arms())
def test_compiled_code_places_shapes_and_axes_where_mujoco_does(name):
    arm, random = load_arm(name), np.random.default_rng(7)
    bodies = ArmBodies(arm, mounted=[CAMERA], surroundings=[TABLE])
    scene = bodies.scene
    shown = (scene.places, scene.axes, scene.anchors, scene.directions)
    for q in random.uniform(*arm.joint_range.T, (20, arm.dof)):
        arm_clearance(bodies, still(q), clearance=0.0)
        placed = [array.copy() for array in shown]
        bodies.place(q)
        for array, expected in zip(placed, shown, strict=True):
            np.testing.assert_allclose(array, expected, atol=1e-12)


def test_a_path_beside_something_says_how_close_it_comes_and_where():
    """A ball 3 cm beside the camera's way half way: the gap that is reported is that of the worst place."""
    arm, w = load_arm("rx60"), 0.5
    path = straight_joint_path(
        np.array([-0.5, 0.6, -1.0, 0.1, 1.2, 0.2]), np.array([0.6, 0.7, -1.1, 0.1, 1.2, 0.2])
    )
    tip = Solid.sphere("tip", [0.0, 0.0, 0.2], 0.01)
    place = np.add(arm.base_T_flange(path(w)).apply([0.0, 0.0, 0.2]), [0.0, 0.0, 0.05])
    bodies = ArmBodies(arm, mounted=[tip], surroundings=[Solid.sphere("ball", place, 0.01)])
    clear = arm_clearance(bodies, path, clearance=0.02)
    least = min(
        np.linalg.norm(arm.base_T_flange(path(at)).apply([0.0, 0.0, 0.2]) - place) - 0.02
        for at in np.linspace(0.0, 1.0, 4001)
    )
    assert clear.status == "clear"
    assert 0.0 < clear.proven <= least - 0.02
    found = arm_clearance(bodies, path, clearance=0.04)
    assert (found.status, found.closest.link, found.closest.other) == ("too_close", "camera", "ball")
    assert least - 1e-6 <= found.closest.gap < 0.04
    assert found.closest.gap < least + 2e-3
    assert found.proven == -np.inf
    into = Solid.sphere("ball", place - [0.0, 0.0, 0.04], 0.01)
    met = arm_clearance(ArmBodies(arm, mounted=[tip], surroundings=[into]), path, clearance=0.0).closest
    at = arm.base_T_flange(path(met.w)).apply([0.0, 0.0, 0.2])
    assert met.gap == pytest.approx(np.linalg.norm(at - into.pose.translation) - 0.02, abs=1e-6)
    assert met.gap == pytest.approx(-0.01, abs=1e-3)


def asked_of_two(bodies, names):
    """Bodies of which two alone are asked for clearance."""
    two = [bodies.names(pair) == names for pair in range(len(bodies.pairs))]
    bodies.asked = lambda clearance, _: np.where(two, clearance, -100.0)
    return bodies


def test_a_gap_that_is_just_what_is_asked_is_undecided_and_not_claimed():
    """The arm turns about an upright axis, on which a ball hangs; half as much is left as rounding takes."""
    arm, q = load_arm("rx60"), np.array([0.0, 0.5, 0.8, 0.0, 0.7, 0.0])
    tip, ball = Solid.sphere("tip", [0.0, 0.0, 0.1], 0.05), Solid.sphere("ball", [0.0, 0.0, 1.5], 0.1)
    gap = np.linalg.norm(arm.base_T_flange(q).apply(tip.pose.translation) - ball.pose.translation) - 0.15
    bodies = asked_of_two(ArmBodies(arm, mounted=[tip], surroundings=[ball]), ("camera", "ball"))
    path = straight_joint_path(q, q + 0.3 * np.eye(6)[0])
    for left, status in ((-1e-8, "too_close"), (5e-9, "undecided"), (1e-6, "clear")):
        found = arm_clearance(bodies, path, clearance=gap - left)
        assert (found.status, found.proven >= 0.0) == (status, status == "clear")
        assert found.proven < left


def ends_of(rod):
    return rod.pose.apply([[0.0, 0.0, -rod.size[1]], [0.0, 0.0, rod.size[1]]])


def apart(one, other):
    """The distance of two rods: of their axes, each at the place nearest to the other, less the radii."""
    (a, b), (c, d) = ends_of(one), ends_of(other)
    ways = np.column_stack([b - a, c - d])
    shares = lsq_linear(ways, c - a, (0.0, 1.0), method="bvls", tol=1e-15).x
    return float(np.linalg.norm(a - c + ways @ shares) - one.size[0] - other.size[0])


def test_a_distance_is_never_called_kept_that_a_search_has_found_but_for_its_last_digits():
    """Rods 20 m apart, asked for two parts in a hundred million more than there is."""
    random, arm, q = np.random.default_rng(0), load_arm("rx60"), np.zeros(6)
    for _ in range(60):
        far = random.normal(size=3)
        poses = [
            RigidTransform.from_components(place, Rotation.random(rng=random))
            for place in (np.zeros(3), 20.0 * far / np.linalg.norm(far))
        ]
        rods = [
            Solid(name, "capsule", random.uniform(0.1, 3.0, 2), pose)
            for name, pose in zip("ab", poses, strict=True)
        ]
        gap = apart(rods[0].moved(arm.base_T_flange(q)), rods[1])
        bodies = asked_of_two(ArmBodies(arm, mounted=rods[:1], surroundings=rods[1:]), ("camera", "b"))
        assert arm_clearance(bodies, still(q), clearance=gap * (1.0 + 2e-8)).status != "clear"
        for less in (2e-7, 4e-8, 2e-8):
            kept = arm_clearance(bodies, still(q), clearance=gap * (1.0 - less))
            assert kept.status == "clear" or less < 1e-7
            assert kept.proven <= less * gap


@pytest.mark.parametrize("carried", [True, False])
def test_what_is_allowed_for_rounding_grows_with_sizes(carried):
    """A ball before a plate, and before one of 10 000 km: less is proven by at least what sides lose."""
    arm, q, proven = load_arm("rx60"), np.full(6, 0.3), []
    flange = arm.base_T_flange(q)
    for side in (1.0, 1e7):
        plate = Solid.box("plate", RigidTransform.from_translation([0.0, 0.0, 0.3]), [side, side, 0.01])
        ball = Solid.sphere("ball", [0.0, 0.0, 0.6], 0.1)
        near, far = (plate, ball) if carried else (ball, plate)
        bodies = ArmBodies(arm, mounted=[near], surroundings=[far.moved(flange)])
        bodies = asked_of_two(bodies, ("camera", far.name))
        proven.append(arm_clearance(bodies, still(q), clearance=0.0).proven)
    assert proven[0] == pytest.approx(0.19, abs=1e-7)
    assert 1e-7 < proven[0] - proven[1] < 1e-4


def test_wrong_solids_and_clearances_are_named():
    with pytest.raises(InputError, match=r"table: size \[-1\.0\] m given; legal: ≥ 0"):
        Solid.sphere("table", [0, 0, 0], -1.0)
    with pytest.raises(InputError, match=r"kind: 'cone' given; legal: sphere, capsule"):
        Solid("x", "cone", [1.0], RigidTransform.identity())
    with pytest.raises(InputError, match="table: 2 vertices given; legal: at least 3"):
        Solid("table", "hull", np.zeros(0), RigidTransform.identity(), np.eye(3)[:2])
    with pytest.raises(InputError, match="hull has vertices"):
        Solid("x", "hull", [], RigidTransform.identity())
    with pytest.raises(InputError, match="'table' is given twice"):
        ArmBodies(load_arm("rx60"), surroundings=[TABLE, Solid.sphere("ball", [0, 0, 1], 0.1), TABLE])
    arm = load_arm("rx60")
    with pytest.raises(InputError, match="clearance"):
        arm_clearance(ArmBodies(arm), straight_joint_path(np.zeros(6), np.ones(6)), clearance=-1.0)
    with pytest.raises(InputError, match="q"):
        ArmBodies(arm).place(np.full(6, np.nan))


def test_pairs_are_those_between_which_mujoco_finds_contacts():
    """Whatever MuJoCo's own broad phase reports in random postures is among the pairs."""
    for name in shipped_arms():
        arm, random = load_arm(name), np.random.default_rng(4)
        bodies = ArmBodies(arm, mounted=[CAMERA], surroundings=[TABLE])
        known = {frozenset(pair) for pair in bodies.pairs.tolist()}
        data = mujoco.MjData(bodies._model)
        met = set()
        for _ in range(300):
            data.qpos[:] = random.uniform(*arm.joint_range.T)
            mujoco.mj_fwdPosition(bodies._model, data)
            met |= {frozenset(int(g) for g in pair) for pair in data.contact.geom}
        assert len(met) > 5
        assert met <= known
