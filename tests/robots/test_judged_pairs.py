"""Which shapes of an arm are kept off each other: written out, and met where they meet."""

from collections import Counter

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation
from tests.planning.test_arm_anywhere import STAND, planned, rx60
from tests.robots.joint_paths import straight_joint_path

from omniservo import cameras
from omniservo.errors import InputError
from omniservo.planning import ArmSetting, PlanningProblem, plan_with_arm
from omniservo.robots import CAMERA_HOUSING, ArmBodies, Solid, arm_clearance, load_arm
from omniservo.simulation.scene import Ball, Box, Scene
from omniservo.simulation.world import World

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
    assert "camera and wrist_2 overlap by 7.65 mm" in found.plan.reason
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


def test_a_gripper_of_the_file_is_kept_off_the_link_before_the_last_joint(tmp_path):
    """A finger beside the flange, back along the wrist, so that the last joint turns it into wrist_2."""
    text = load_arm("ur5e").path.read_text()
    finger = '<body name="finger"><geom type="box" pos="0.045 0 -0.02" size="0.01 0.01 0.05"/></body>'
    file = tmp_path / "with_finger.xml"
    with_finger = text.replace("<site ", f"{finger}<site ", 1)
    assert with_finger != text
    file.write_text(with_finger)
    arm = load_arm(file, tool="flange")
    bodies = ArmBodies(arm)
    assert judged(bodies)["finger"]["wrist_2"] >= 1
    gaps, q = [], np.zeros(6)
    for q[5] in np.linspace(-3.0, 3.0, 61):
        bodies.place(q)
        gaps.append(min((near.gap for near in bodies.near(0.1)), default=1.0))
    assert min(gaps) < 0.0 < max(gaps)


def test_a_post_of_the_base_is_kept_off_the_first_link_and_its_bearing_is_not(tmp_path):
    """The post stands where the shoulder of the RX60 comes by as joint 1 turns."""
    post = '<geom type="cylinder" pos="0.1 0.1 0.3" size="0.02 0.3"/>'
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
            surroundings=(Box("post", RigidTransform.from_translation(place), [0.02] * 3),),
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
