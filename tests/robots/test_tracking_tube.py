"""What an arm strays from its path: measured, and what a quantile of it promises."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from omniservo.errors import InputError
from omniservo.robots import (
    CAMERA_HOUSING,
    SELF_CLEARANCE,
    ArmBodies,
    Solid,
    TrackingTube,
    Tube,
    load_arm,
    shipped_arms,
    shipped_tube,
    strayed,
)

MOUNT = RigidTransform.from_translation([0.0, 0.0, 0.09])


@pytest.fixture(scope="module")
def bodies():
    return ArmBodies(load_arm("rx60"), mounted=[Solid.sphere("ball", [0.0, 0.0, 0.05], 0.02)])


def path_of(bodies, turn):
    return np.array([0.0, 0.4, -0.8, 0.1, 0.7, 0.2]) + np.linspace(0.0, 1.0, 41)[:, None] * np.asarray(turn)


def test_being_late_on_the_path_is_no_deviation_and_leaving_it_is(bodies):
    path = path_of(bodies, [0.4, 0.1, -0.2, 0.0, 0.3, 0.0])
    late = path_of(bodies, [0.4, 0.1, -0.2, 0.0, 0.3, 0.0])[[0, 0, 3, 17, 29]]
    most = strayed(bodies, MOUNT, path, late, 0.5)
    np.testing.assert_allclose(most[:-1], 0.0, atol=5e-8)
    assert most[-1] == 0.5
    beside = late + 0.01 * np.eye(6)[3]
    assert strayed(bodies, MOUNT, path, beside, 0.5)[3] == pytest.approx(0.01, abs=1e-4)


def test_no_point_of_a_link_goes_farther_than_the_link_strays(bodies):
    path, random = path_of(bodies, [0.4, 0.1, -0.2, 0.0, 0.3, 0.0]), np.random.default_rng(3)
    at = path[20]
    q = at + 0.02 * random.standard_normal(6)
    most = strayed(bodies, MOUNT, path[20:22], [q], 0.0)
    own = random.uniform(-0.02, 0.02, (500, 3)) + np.array([0.0, 0.0, 0.05])
    own = own[np.linalg.norm(own - np.array([0.0, 0.0, 0.05]), axis=1) <= 0.02]
    arm = bodies.arm
    grid = [path[20] + s * (path[21] - path[20]) for s in np.linspace(0.0, 1.0, 101)]
    near = min(grid, key=lambda p: np.sum((bodies.corners(p) - bodies.corners(q)) ** 2))
    moved = np.linalg.norm(arm.base_T_flange(q).apply(own) - arm.base_T_flange(near).apply(own), axis=1)
    allowed = dict(zip(bodies.links, most[6 : 6 + len(bodies.links)], strict=True))["camera"]
    assert moved.max() <= allowed + 1e-4
    assert allowed < 1.5 * moved.max()


def test_a_run_strays_as_its_worst_row_does_and_a_link_as_its_worst_shape(bodies):
    path, random = path_of(bodies, [0.4, 0.1, -0.2, 0.0, 0.3, 0.0]), np.random.default_rng(5)
    near, far = (Solid.sphere("ball", [0.0, 0.1 * k, 0.05], 0.01) for k in (1.0, 4.0))
    both = [ArmBodies(bodies.arm, mounted=order) for order in ((near, far), (far, near))]
    for worst in range(4):
        run = path[[3, 17, 29, 40]] + 0.001 * random.standard_normal((4, 6))
        run[worst] += 0.02 * random.standard_normal(6)
        alone = np.max([strayed(both[0], MOUNT, path, row[None], 0.5) for row in run], axis=0)
        for each in both:
            np.testing.assert_allclose(strayed(each, MOUNT, path, run, 0.5), alone, atol=1e-6)
    farther = strayed(both[0], MOUNT, path, path[20] + 0.01 * np.eye(6)[[5]], 0.0)[6:-2]
    assert dict(zip(both[0].tube_parts, farther, strict=True))["camera"] > 0.01 * 0.3
    aside = RigidTransform.from_translation(
        [0.0, 0.5, 0.0]
    )  # a camera that the last joint turns about its axis
    assert strayed(both[0], aside, path, path[20] + 0.01 * np.eye(6)[[5]], 0.0)[-2] > 0.01 * 0.4


def test_two_links_of_the_arm_stray_by_what_is_taken_of_the_gap_between_them(bodies):
    path = np.array([0.0, 0.4, -2.2, 0.0, -2.0, 0.0]) + np.linspace(0.0, 0.4, 41)[:, None] * np.eye(6)[0]
    q = path[10] + 0.05 * np.eye(6)[4] * np.array([-1.0, 1.0])[:, None]  # the camera to the forearm, and off
    most = strayed(bodies, MOUNT, path[10:12], q, 0.0)
    parts, nearer = dict(zip(bodies.tube_parts, most[6:-2], strict=True)), 0
    to, off = (
        dict(zip(bodies.tube_parts, strayed(bodies, MOUNT, path[10:12], [row], 0.0)[6:-2], strict=True))
        for row in q
    )
    assert to["camera & forearm"] == pytest.approx(parts["camera & forearm"], abs=1e-7)
    assert to["camera & forearm"] > 2e-3 > off["camera & forearm"]
    for pair in bodies.own_pairs.tolist():
        gaps = []
        for posture in (path[10], *q):
            bodies.place(posture)
            gaps.append(bodies.measure(pair))
        if gaps[0] < 0.1:
            lost = max(0.0, gaps[0] - min(gaps[1:]))
            assert parts[bodies.part_of(pair)] >= lost - 5e-8
            nearer += lost > 2e-3
    assert nearer


def test_the_next_run_leaves_the_tube_as_seldom_as_it_says():
    random, left, count = np.random.default_rng(7), 0, 3000
    for _ in range(count):
        runs = np.exp(random.standard_normal((89, 5)))  # any distribution will do
        tube = TrackingTube.of("an arm", ("link",), runs[:-1], 0.1, "drawn").at(0.05)
        needed = runs[-1] / [*tube.joints, *tube.links.values(), tube.position, tube.image]
        left += needed.max() > 1.0
    assert left / count == pytest.approx(0.05, abs=0.015)


def test_parts_that_hardly_stray_and_then_a_little_do_not_blow_up_the_tube():
    runs = np.tile([1.0, 4e-3, 0.0, 3e-3, 1.0], (100, 1))
    runs[70:80, 2] = 1.1e-3  # of the gap between two links
    runs[80:90, 4] = 1.9  # in the image
    tube = TrackingTube.of("an arm", ("a", "a & b"), runs, 0.1, "made up").at(0.05)
    assert tube.links["a"] == pytest.approx(4e-3)
    assert tube.position == pytest.approx(3e-3)


def test_too_few_runs_promise_nothing_and_say_how_many_are_needed():
    tube = TrackingTube.of("an arm", (), np.ones((147, 3)), 0.1, "made up")
    with pytest.raises(InputError, match="99 are needed"):
        tube.at(0.01)
    assert TrackingTube.of("an arm", (), np.ones((149, 3)), 0.1, "made up").at(0.01).joints == pytest.approx(
        [1.0]
    )


def test_a_tube_is_read_as_it_was_written_and_other_files_are_refused(tmp_path):
    tube = TrackingTube.of("an arm", ("a", "b"), np.arange(1.0, 61.0).reshape(10, 6), 0.1, "made up")
    tube.save(tmp_path / "tube.json")
    again = TrackingTube.load(tmp_path / "tube.json")
    assert (again.arm, again.links, again.source) == (tube.arm, tube.links, tube.source)
    np.testing.assert_allclose(again.ratios, tube.ratios, rtol=1e-5)
    (tmp_path / "other.json").write_text('{"format": "omniservo.tracking-tube/1"}')
    with pytest.raises(InputError, match="no tracking tube"):
        TrackingTube.load(tmp_path / "other.json")
    assert again.singular_value == 0.1
    written = (tmp_path / "tube.json").read_text()
    for wrong in ('"ratios": [-1.0, ', '"ratios": [NaN, ', '"ratios": ["a", ', '"ratios": [[1], '):
        (tmp_path / "wrong.json").write_text(written.replace('"ratios": [', wrong))
        with pytest.raises(InputError):
            TrackingTube.load(tmp_path / "wrong.json")
    (tmp_path / "wrong.json").write_text(written.replace('"singular_value": 0.1', '"singular_value": NaN'))
    with pytest.raises(InputError, match="singular_value"):
        TrackingTube.load(tmp_path / "wrong.json")


@pytest.mark.parametrize("name", shipped_arms())
def test_pairs_that_no_joint_brings_nearer_are_asked_for_no_more(name):
    """Such as the UR5e's upper arm and base, whose shapes are 3.5 mm apart in every posture."""
    arm = load_arm(name)
    parts = ArmBodies(arm, mounted=CAMERA_HOUSING).tube_parts
    tube = Tube(np.zeros(arm.dof), dict.fromkeys(parts, 0.01), 0.01, 1.0, 0.02, 0.01)
    bodies = ArmBodies(arm, mounted=CAMERA_HOUSING, tube=tube)
    own = np.array([not bodies.is_around(i) for i in range(len(bodies.pairs))])
    asked, gaps = bodies.asked(0.0, SELF_CLEARANCE), []
    random = np.random.default_rng(3)
    for _ in range(30):
        bodies.place(random.uniform(*arm.joint_range.T))
        gaps.append([bodies.measure(i) for i in range(len(bodies.pairs))])
    steady = asked < SELF_CLEARANCE + 0.005
    assert own.all()
    beside = np.diff(bodies.shapes.carried[bodies.pairs], axis=1)[:, 0] == 1  # they stray as the joint does
    assert np.ptp(gaps, axis=0)[steady & ~beside].max() < 5e-8
    assert 2 <= (steady & ~beside).sum() < len(steady)
    np.testing.assert_allclose(asked, np.where(steady, SELF_CLEARANCE, SELF_CLEARANCE + 0.01))


def test_two_parts_with_one_joint_between_them_stray_as_that_joint_does():
    """A camera housing and the wrist before it: what the joint takes of the gap, and no more than 3 times."""
    arm = load_arm("ur5e")
    bar = Solid.box("bar", RigidTransform.from_translation([0.07, 0.0, 0.06]), [0.01, 0.01, 0.1])
    parts = ArmBodies(arm, mounted=[bar]).tube_parts
    tube = Tube(np.full(6, 0.05), dict.fromkeys(parts, 0.7), 0.01, 1.0, 0.02, 0.01)
    bodies, q = ArmBodies(arm, mounted=[bar], tube=tube), np.zeros(6)
    extra, beside = bodies.asked(0.0, 0.0), 0
    for pair in range(len(bodies.pairs)):
        if bodies.names(pair) != ("camera", "wrist_2"):
            continue
        beside, gaps = beside + 1, []
        for q[5] in np.linspace(-3.0, 3.0, 121):
            bodies.place(q)
            gaps.append(bodies.measure(pair))
        taken = np.abs(np.diff(gaps)).max()
        assert taken <= extra[pair] + 1e-7
        assert extra[pair] in (0.0, pytest.approx(0.05 * (0.07 + np.linalg.norm([0.01, 0.01, 0.1]))))
    assert beside == 3


@pytest.mark.parametrize("name", shipped_arms())
def test_a_shipped_tube_lets_its_arm_stand_somewhere(name):
    """Parts of an arm that are always close to each other may not be asked for more than there ever is."""
    arm, tube = load_arm(name), shipped_tube(name).at(0.005)
    bodies = ArmBodies(arm, mounted=[solid.moved(MOUNT) for solid in CAMERA_HOUSING], tube=tube)
    asked = bodies.asked(0.0, SELF_CLEARANCE)
    low, high = arm.joint_range.T + np.array([1.0, -1.0])[:, None] * tube.joints

    def free(q):
        bodies.place(q)
        return all(near.gap >= asked[near.pair] for near in bodies.near(float(asked.max())))

    random = np.random.default_rng(5)
    assert sum(free(random.uniform(low, high)) for _ in range(100)) > 20
