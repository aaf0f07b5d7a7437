"""Which shapes of an arm are kept off each other: written out, and met where they meet."""

from collections import Counter
from itertools import product

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation
from tests.robots.joint_paths import straight_joint_path
from tests.whole_arm.test_arm_anywhere import STAND, planned, rx60

from omniservo import cameras
from omniservo.errors import InputError
from omniservo.planning import PlanningProblem
from omniservo.robots import CAMERA_HOUSING, ArmBodies, Solid, arm_clearance, load_arm
from omniservo.robots.arm_files.contacts import _is_bearing
from omniservo.robots.collision.mounted_pairs import mounted_pairs
from omniservo.robots.collision.shapes import Shapes
from omniservo.scenes.scene import Ball, Scene, SceneBox
from omniservo.simulation.world import World
from omniservo.whole_arm import ArmSetting, plan_with_arm

MOUNT = RigidTransform.from_components([0.0, 0.0, 0.0905], Rotation.from_euler("z", 90, degrees=True))
HOUSING = tuple(solid.moved(MOUNT) for solid in CAMERA_HOUSING)

# link: the links before it that it is kept off, with the pairs of shapes that are
JUDGED = {
    "rx60": {
        "upper_arm": {"base": 6},
        "elbow": {"base": 4},
        "forearm": {"base": 6, "shoulder": 9},
        "wrist": {"base": 4, "shoulder": 6, "upper_arm": 6},
        "flange": {"base": 2, "shoulder": 3, "upper_arm": 3, "elbow": 2},
        "camera": {"base": 4, "shoulder": 6, "upper_arm": 6, "elbow": 4, "forearm": 6, "wrist": 4},
    },
    "ur5e": {
        "upper_arm": {"base": 5},
        "forearm": {"base": 4, "shoulder": 12},
        "wrist_1": {"base": 3, "shoulder": 9, "upper_arm": 15},
        "wrist_2": {"base": 3, "shoulder": 9, "upper_arm": 15, "forearm": 12},
        "wrist_3": {"base": 1, "shoulder": 3, "upper_arm": 5, "forearm": 4, "wrist_1": 3},
        "camera": {"base": 2, "shoulder": 6, "upper_arm": 10, "forearm": 8, "wrist_1": 6, "wrist_2": 6},
    },
    "panda": {
        "link2": {"link0": 4},
        "link3": {"link0": 8, "link1": 12},
        "link4": {"link0": 4, "link1": 6, "link2": 4},
        "link5": {"link0": 6, "link1": 9, "link2": 6, "link3": 12},
        "link6": {"link0": 4, "link1": 6, "link2": 4, "link3": 8, "link4": 4},
        "link7": {"link0": 4, "link1": 6, "link2": 4, "link3": 8, "link4": 4, "link5": 6},
        "camera": {"link0": 4, "link1": 6, "link2": 4, "link3": 8, "link4": 4, "link5": 6, "link6": 4},
    },
}


def judged(bodies):
    found = {}
    for link, other in (bodies.names(i) for i in range(len(bodies.pairs))):
        found.setdefault(link, Counter())[other] += 1
    return found


@pytest.mark.parametrize("name", JUDGED)
def test_the_pairs_of_each_shipped_arm_are_these(name):
    assert judged(ArmBodies(load_arm(name), mounted=HOUSING)) == JUDGED[name]


@pytest.mark.parametrize("name", JUDGED)
def test_every_shape_that_moves_is_kept_off_everything_around(name):
    around = [Solid.sphere("ball", [0.9, 0.0, 0.5], 0.1), Solid.half_space("floor", [0.0, 0.0, 1.0], -1.0)]
    bodies = ArmBodies(load_arm(name), mounted=HOUSING, surroundings=around)
    moving = np.flatnonzero(bodies.shapes.carried > 0)
    stands = [int(bodies.shapes_of(each)[0]) for each in ("around 0", "around 1")]
    pairs = {tuple(pair) for i, pair in enumerate(bodies.pairs.tolist()) if bodies.is_around(i)}
    assert pairs == set(product(stands, moving.tolist()))


def test_a_folded_panda_that_touches_itself_is_found():
    """Each of the pairs that meet in some posture only: folded until they do, by MuJoCo's own contacts."""
    arm, random = load_arm("panda"), np.random.default_rng(0)
    bodies, met, seen = ArmBodies(arm), set(), {}
    for _ in range(400):
        q = random.uniform(*arm.joint_range.T)
        bodies.place(q)
        for near in bodies.near(0.0):
            seen.setdefault(bodies.names(near.pair), q)
    for pair, q in seen.items():
        path = straight_joint_path(q, q + 1e-3)
        found = arm_clearance(bodies, path, clearance=0.0, self_clearance=0.0)
        assert found.status == "too_close"
        met.add(pair)
    folded = {("link7", "link0"), ("link6", "link1"), ("link7", "link1"), ("link7", "link2")}
    assert folded <= met


def bracket_turned(arm, bar, *, start, mount, turn=1.5):
    goal = RigidTransform.from_components([0.0, 0.0, 0.05], Rotation.from_rotvec([0.0, 0.0, -turn]))
    points = [[i, j, 0.5] for i in (-0.08, 0.0, 0.08) for j in (-0.08, 0.0, 0.08)]
    problem = PlanningProblem(cameras.preset("fe185"), points, goal)
    base_T_initial = arm.base_T_flange(start) * mount
    setting = ArmSetting(arm, base_T_initial, mount, start=start, mounted=(bar,), clearance=0.0)
    return plan_with_arm(problem, setting)


def test_what_the_flange_carries_is_kept_off_the_link_before_it():
    """A bar back from the flange of a UR5e that the last joint turns into wrist_2, and one that stays off."""
    arm, start = load_arm("ur5e"), np.array([0.0, -1.2, 1.6, -1.8, -1.57, 0.0])
    mount = RigidTransform.from_translation([0.0, 0.0, 0.09])
    bar = Solid.box("bracket", RigidTransform.from_translation([0.045, 0.0, -0.11]), [0.01, 0.01, 0.05])
    found = bracket_turned(arm, bar, start=start, mount=mount)
    assert not found.certified
    assert "camera and wrist_2 overlap by 5.40 mm" in found.plan.reason
    aside = Solid.box("bracket", RigidTransform.from_translation([0.09, 0.0, -0.11]), [0.01, 0.01, 0.05])
    assert bracket_turned(arm, aside, start=start, mount=mount).certified


def test_only_what_overlaps_in_every_posture_of_the_last_joint_is_left_out_and_said():
    arm = load_arm("ur5e")
    sleeve = Solid("sleeve", "cylinder", [0.08, 0.1], RigidTransform.from_translation([0.0, 0.0, -0.08]))
    far = RigidTransform.from_translation([0.06, 0.0, -0.02])
    bar = Solid.box("bar", far, [0.01, 0.01, 0.05])
    bodies = ArmBodies(arm, mounted=[sleeve, bar])
    assert judged(bodies)["camera"]["wrist_2"] == 3
    assert bodies.notices == (
        "shapes that overlap in every posture, not kept off each other: camera and wrist_2 (3 of 6 pairs)",
    )
    assert ArmBodies(arm, mounted=[bar]).notices == ()


BALL, ROD = np.array([0.4, 0.3, 0.2]), np.array([0.3, 0.3, 0.2])
APART = {
    "a ball, 2 mm apart at -2 rad": (2, BALL, 0.2 * np.sin(1.0) - 0.1 - 0.002, (-2.0, 1.0), True),
    "a ball, 2 mm apart at 2 rad": (2, BALL, 0.2 * np.sin(1.0) - 0.1 - 0.002, (-1.0, 2.0), True),
    "a ball, nowhere apart": (2, BALL, 0.2 * np.sin(1.0) - 0.1 - 0.002, (-1.9, 1.9), False),
    "a rod through the axis, across the other at 1.5 rad": (3, ROD, 0.01, (-0.5, 1.5), True),
    "a rod through the axis, nowhere across": (3, ROD, 0.01, (-0.5, 0.5), False),
}


@pytest.mark.parametrize(("kind", "place", "radius", "ends", "meets"), APART.values(), ids=APART.keys())
def test_two_that_are_apart_in_some_posture_of_the_last_joint_are_judged(kind, place, radius, ends, meets):
    """A ball beside the joint's axis, 10 cm from it, and what the joint turns."""
    along_x = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    shapes = Shapes(
        kinds=np.array([2, kind]),
        sizes=np.array([[0.1 if kind == 2 else 0.05, 0.0, 0.0], [radius, 0.1, 0.0]]),
        radii=np.full(2, 0.2),
        corners=np.zeros((0, 3)),
        firsts=np.zeros(3, dtype=np.int64),
        carried=np.array([5, 6]),
        spins=np.zeros(2, dtype=np.int64),
        places=np.array([BALL, place]),
        axes=np.tile(along_x.ravel(), (2, 1)),
        pairs=np.zeros((0, 2), dtype=np.int64),
        first_between=np.zeros(0, dtype=np.int64),
    )
    hinge = np.array([0.3, 0.3, 0.0]), np.array([0.0, 0.0, 1.0])
    found, left_out = mounted_pairs(shapes, np.array([0]), np.array([1]), hinge, np.array(ends))
    assert (found.tolist(), left_out.tolist()) == (([[0, 1]], []) if meets else ([], [[0, 1]]))


@pytest.mark.parametrize(("ends", "bearing"), [((-1.0, 2.0), 0), ((-2.0, 1.0), 0), ((-1.0, 1.0), 1)])
def test_two_that_a_joint_brings_apart_at_one_end_of_its_range_only_are_no_bearing(ends, bearing):
    """Balls of 10 and 4.8 cm, both 10 cm beside the axis; 20 mm apart at 2 rad."""
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    spec.worldbody.add_geom(size=[0.1, 0.0, 0.0], pos=[0.1, 0.0, 0.0])
    link = spec.worldbody.add_body(name="link")
    link.add_joint(type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 0, 1], range=ends)
    link.add_geom(size=[0.2 * np.sin(1.0) - 0.12, 0.0, 0.0], pos=[0.1, 0.0, 0.0])
    assert _is_bearing(spec.compile(), (0, 1)) == bool(bearing)


def test_a_gripper_of_the_file_is_kept_off_the_link_before_the_last_joint(tmp_path):
    """A finger beside the flange, back along the wrist, so that the last joint turns it into wrist_2."""
    text = load_arm("ur5e").path.read_text()
    finger = '<body name="finger"><geom type="box" pos="0.045 0 -0.02" size="0.01 0.01 0.05"/></body>'
    file = tmp_path / "with_finger.xml"
    with_finger = text.replace("<site ", f"{finger}<site ", 1)
    assert with_finger != text
    file.write_text(with_finger)
    arm = load_arm(file, flange="flange")
    bodies = ArmBodies(arm)
    assert judged(bodies)["finger"]["wrist_2"] >= 1
    gaps, q = [], np.zeros(6)
    for q[5] in np.linspace(-3.0, 3.0, 61):
        bodies.place(q)
        gaps.append(min((near.gap for near in bodies.near(0.1)), default=1.0))
    assert min(gaps) < 0.0 < max(gaps)


POSTS = {
    "a post where the shoulder comes by": '<geom type="cylinder" pos="0.1 0.1 0.3" size="0.02 0.3"/>',
    "a knob above it, nowhere more than 35 mm off": '<geom type="sphere" pos="0.05 0 0.43" size="0.01"/>',
}


@pytest.mark.parametrize("post", POSTS.values(), ids=POSTS.keys())
def test_a_post_of_the_base_is_kept_off_the_first_link_and_its_bearing_is_not(tmp_path, post):
    """As joint 1 of the RX60 turns."""
    arm = rx60(tmp_path, shapes=post)
    bodies, q = ArmBodies(arm), STAND.copy()
    own = judged(bodies)["shoulder"]
    assert 1 <= own["base"] <= 3
    assert any(f"base and shoulder ({9 - own['base']} of 9 pairs)" in notice for notice in arm.notices)
    first, gaps = [i for i in range(len(bodies.pairs)) if bodies.names(i) == ("shoulder", "base")], []
    for q[0] in np.linspace(*arm.joint_range[0], 200):
        bodies.place(q)
        gaps.append(min(map(bodies.measure, first)))
    assert min(gaps) < 0.0 < max(gaps)


def test_of_two_links_that_overlap_in_every_posture_the_other_shapes_are_kept_off_each_other(tmp_path):
    """A ball of the base and one of the upper arm where axes 1 and 2 meet; both links have more shapes."""
    ball = '<geom type="sphere" pos="0 0 {}" size="0.01"/>'
    arm = rx60(tmp_path, shapes=ball.format(0.341))
    text, link = arm.path.read_text(), '<body name="upper_arm" gravcomp="1">'
    assert link in text
    arm.path.write_text(text.replace(link, link + ball.format(0)))
    arm = load_arm(arm.path)
    every = 3 * (JUDGED["rx60"]["upper_arm"]["base"] // 2 + 1)
    left_out = every - judged(ArmBodies(arm))["upper_arm"]["base"]
    assert 1 <= left_out <= 3
    assert any(f"base and upper_arm ({left_out} of {every} pairs)" in notice for notice in arm.notices)


def test_a_plane_among_the_shapes_of_a_base_is_a_half_space(tmp_path):
    """3 × 3 m as it is drawn, at a height of 0.6 m: the arm reaches 0.3 m through it."""
    found = planned(rx60(tmp_path, shapes='<geom type="plane" size="3 3 .1" pos="0 0 .6"/>'))
    assert found.plan.status == "infeasible"
    assert "base" in found.plan.reason
    low = planned(rx60(tmp_path, shapes='<geom type="plane" size="3 3 .1" pos="0 0 -.1"/>'))
    assert low.certified


def test_shapes_of_kinds_that_are_not_known_are_refused_by_name(tmp_path):
    shapes = '<geom name="hills" type="sdf" size="1 1 1"/>'
    with pytest.raises(InputError, match="sdf|mesh"):
        ArmBodies(rx60(tmp_path, shapes=shapes))


def test_the_simulated_camera_touches_the_wrist_that_it_is_turned_into():
    """A camera mounted askew beside the flange of an RX60, back along its wrist."""
    arm = load_arm("rx60")
    mount = RigidTransform.from_components([0.07, 0.0, 0.0], Rotation.identity())
    scene = Scene(arm, RigidTransform.identity(), mount, cameras.preset("fe185"), STAND)
    world = World(scene)
    bodies = ArmBodies(arm, mounted=[solid.moved(mount) for solid in CAMERA_HOUSING])
    told, seen = [], []
    for turn in np.linspace(-3.0, 3.0, 41):
        q = STAND + turn * np.eye(6)[5]
        bodies.place(q)
        names = [bodies.names(near.pair) for near in bodies.near(0.0)]
        told.append(("camera", "wrist") in names)
        seen.append(("camera", "wrist") in world.touching(world.data_at(q)))
    assert told == seen
    assert any(told)


OF_FILE, OF_CLASS = "<default>", '<default class="arm">\n      <geom '
DEFAULTS = {
    "no contact in the file": (OF_FILE, '<geom contype="0" conaffinity="0"/>'),
    "no contact in the class": (OF_CLASS, 'contype="0" conaffinity="0" '),
    "contacts of another kind": (OF_CLASS, 'contype="2" conaffinity="4" '),
    "meshes in millimetres": (OF_FILE, '<mesh scale="0.001 0.001 0.001"/>'),
    "wide margins": (OF_FILE, '<geom margin="0.5" gap="0.1" group="4"/>'),
}


@pytest.mark.parametrize(("where", "defaults"), DEFAULTS.values(), ids=DEFAULTS.keys())
def test_what_is_put_beside_an_arm_takes_none_of_the_defaults_of_its_file(tmp_path, where, defaults):
    """The arm's own shapes state what they have: pairs, gaps and contacts are those of the shipped file."""
    head, tree = load_arm("rx60").path.read_text().split("<worldbody>")
    assert where in head
    tree = tree.replace("<geom ", '<geom contype="1" conaffinity="1" margin="0" gap="0" ')
    file = tmp_path / "arm.xml"
    file.write_text(f"{head.replace(where, where + defaults, 1)}<worldbody>{tree}")
    vertices = np.random.default_rng(2).uniform(-0.1, 0.1, (8, 3))
    hull = Solid("hull", "hull", [], RigidTransform.identity(), vertices)
    stone = Solid("stone", "hull", [], RigidTransform.from_translation([0.0, 0.5, 0.5]), vertices)
    ball = Solid.sphere("ball", [0.3, 0.0, 0.5], 0.1)
    told = []
    for arm in (load_arm("rx60"), load_arm(file)):
        bodies = ArmBodies(arm, mounted=[hull, *HOUSING], surroundings=[ball, stone])
        bodies.place(STAND)
        every = range(len(bodies.pairs))
        place = (arm.base_T_flange(STAND) * MOUNT).translation
        scene = Scene(
            arm,
            RigidTransform.identity(),
            MOUNT,
            cameras.preset("fe185"),
            STAND,
            obstacles=(Ball("obstacle", place, 0.02),),
            surroundings=(SceneBox("post", RigidTransform.from_translation(place), [0.02] * 3),),
            floor=float(place[2]),
        )
        world = World(scene)
        touching = world.touching(world.data_at(STAND))
        told.append(([bodies.names(i) for i in every], [bodies.measure(i) for i in every], touching))
    (names, gaps, touching), found = told
    assert found[0] == names
    np.testing.assert_allclose(found[1], gaps, atol=1e-9)
    assert found[2] == touching
    assert {("camera", "obstacle"), ("camera", "post"), ("camera", "floor")} <= touching


@pytest.mark.parametrize(
    ("normal", "offset"), [([0, 0, 0.5], 0.2), ([0, 0, 0], 0.2), ([0, 0, np.nan], 0.2), ([0, 0, 1], np.nan)]
)
def test_a_half_space_whose_normal_is_not_of_length_1_is_refused(normal, offset):
    """0.5 z ≤ 0.2 ends at 0.4; it was taken to end at 0.1."""
    with pytest.raises(InputError, match="table: (normal|offset)"):
        Solid.half_space("table", normal, offset)


@pytest.mark.parametrize("length", [1.0 - 9e-7, 1.0 + 9e-7])
@pytest.mark.parametrize("offset", [-20.0, 7.0])
def test_a_half_space_ends_where_its_normal_as_stated_has_its_offset(length, offset):
    normal = length * np.array([0.6, 0.0, 0.8])
    wall = Solid.half_space("wall", normal, offset)
    assert normal @ wall.pose.translation == pytest.approx(offset, rel=1e-15)
    np.testing.assert_allclose(wall.pose.rotation.apply([0.0, 0.0, 1.0]), normal / length, atol=1e-15)
