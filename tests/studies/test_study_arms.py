"""Arms in studies: where they stand, how they move the camera, and what is said of them."""

import pickle
from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from scipy.optimize import brentq
from scipy.spatial.transform import RigidTransform
from tests.robots.urdf_arms import urdf
from tests.studies.conftest import rows_of, written

from omniservo.errors import Blocked, InputError
from omniservo.planning import Sphere
from omniservo.reporting.study_report import study_html
from omniservo.studies import (
    PACKAGE,
    Shard,
    StudyHeader,
    StudyTally,
    load_study,
    merge_studies,
    read_header,
    run_row,
    run_study,
)
from omniservo.studies.arm_carrier import ArmCarrier
from omniservo.studies.closed_loop import ClosedLoop
from omniservo.studies.free_carrier import HOLD, FreeCarrier
from omniservo.studies.load_study import study_of_json
from omniservo.studies.placed_arm import MountError
from omniservo.studies.replanned_tracker import ReplannedTracker
from omniservo.studies.scene_start import scene_start
from omniservo.studies.study_camera import StudyCamera
from omniservo.studies.study_controller import Led
from omniservo.studies.study_parts import PartWork, part_of_content
from omniservo.studies.study_plan import planned
from omniservo.studies.study_row import scored
from omniservo.studies.study_scene import NoScene, draw_scene, generators
from omniservo.studies.trajectory import Trajectory
from omniservo.tracking import PathTracker

NEAR = {
    "start": "{rotation: {uniform: [5, 40]}, distance_ratio: {uniform: [0.9, 1.2]}}",
    "cameras": "[fe185]",
    "scenes": 4,
    "seed": 10,
}
MESH = '<mesh filename="meshes/link.stl"/>'


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """8 rows of 0.8 s at most: two arms and none."""
    folder = tmp_path_factory.mktemp("arms")
    fields = {"arms": "{choice: [ur5e, panda, none]}", "methods": "[certified, pbvs]", **NEAR}
    return load_study(written(folder, **fields, limits="{seconds: 0.8}"))


@pytest.fixture(scope="module")
def rows(study):
    return [run_row(study, number).row for number in range(study.rows)]


def scenes_of(study, count):
    """Return the first scenes that exist."""
    found = []
    for number in range(count):
        try:
            found.append(draw_scene(study, number, study.cameras["fe185"]))
        except NoScene:
            continue
    return found


@pytest.fixture(scope="module")
def scene(study):
    """The first one with a UR5e."""
    return next(s for s in scenes_of(study, 4) if s.arm is not None and s.arm.name == "ur5e")


def test_each_scene_has_one_of_the_arms_and_all_methods_the_same(study, rows):
    by_scene = {row.scene: {other.arm for other in rows if other.scene == row.scene} for row in rows}
    assert all(len(arms) == 1 for arms in by_scene.values())
    assert {arm for arms in by_scene.values() for arm in arms} == {"ur5e", "panda", "none"}
    statuses = {row.status for row in rows}
    assert statuses <= {"converged", "timed_out", "stopped", "not_planned", "not_estimated"}
    assert "timed_out" in {row.status for row in rows if row.arm == "ur5e"}


@pytest.mark.slow
def test_an_arm_stands_at_start_and_goal_and_touches_nothing_there(tmp_path):
    crowded = {"arms": "ur5e", "obstacles": "{count: 5, radius: 0.06, aside: 0.3}", "scenes": 9}
    study = load_study(written(tmp_path, **NEAR | crowded, methods="[pbvs]"))
    found = scenes_of(study, study.scenes)
    assert len(found) > 4
    for scene in found:
        arm, mount = scene.arm.arm, scene.arm.flange_T_camera
        begin = arm.base_T_flange(scene.arm.start) * mount
        goals = arm.branches(begin * scene.initial_T_goal * mount.inv())
        assert arm.within_limits(scene.arm.start)
        assert begin.translation[2] > 0.0
        assert not scene.arm.nearness(scene.arm.start[None], scene.obstacles)[1]
        assert any(not scene.arm.nearness(goal[None], scene.obstacles)[1] for goal in goals)


def test_scenes_without_an_arm_are_those_of_a_study_without_arms(study, tmp_path):
    without = load_study(written(tmp_path, **NEAR, methods="[certified, pbvs]", limits="{seconds: 0.8}"))
    free = [s for s in scenes_of(study, 4) if s.arm is None]
    assert free
    for scene in free:
        same = draw_scene(without, scene.number, without.cameras["fe185"])
        assert np.array_equal(scene.points, same.points)
        assert np.array_equal(scene.initial_T_goal.as_matrix(), same.initial_T_goal.as_matrix())


@pytest.mark.slow
def test_rows_with_arms_are_the_same_in_any_order_shards_and_process(study, rows, tmp_path):
    assert [run_row(study, n).row for n in (3, 0, 2, 1)] == [rows[n] for n in (3, 0, 2, 1)]
    for number in (1, 2):
        run_study(study, tmp_path / f"shard-{number}", workers=1, shard=Shard(number, 2))
    (tmp_path / "whole").mkdir()
    merge_studies([tmp_path / "shard-1", tmp_path / "shard-2"], tmp_path / "whole")
    assert rows_of(tmp_path / "whole") == rows
    assert read_header(tmp_path / "whole").study == study


class Constant:
    """Commands one twist."""

    done = False

    def __init__(self, twist):
        self.twist = np.array(twist)

    def step(self, time, pixels, valid, acts_at=None):
        return self.twist


def ended(study, scene, twist, seconds=0.8):
    longer = study.model_copy(update={"limits": study.limits.model_copy(update={"seconds": seconds})})
    scene = replace(
        scene, conditions=replace(scene.conditions, latency=0.0, jitter=0.0, dropped=0.0, delayed=0.0)
    )
    led = Led(Constant(twist), np.arange(len(scene.points)), None)
    camera = StudyCamera(scene, generators(study, 0)[1])
    return ClosedLoop(longer, scene, camera, led).run()


def test_an_arm_moves_the_camera_as_a_free_one_but_for_its_acceleration(study, scene):
    twist = np.array([0.02, -0.01, 0.02, 0.05, 0.02, -0.04])
    ways = Trajectory(), Trajectory()
    carriers = ArmCarrier(scene.arm, study.servo, None, ways[0]), FreeCarrier(ways[1])
    for carrier in carriers:
        carrier.carry(twist)
        carrier.move(0.2)
    off = ways[0].end.inv() * ways[1].end
    assert np.linalg.norm(off.translation) < 1e-3  # 10 ms behind
    assert off.rotation.magnitude() < 2e-3
    assert len(ways[0].joints) == len(ways[0].times)


def test_without_images_the_arm_is_led_to_rest(study, scene):
    way = Trajectory()
    carrier = ArmCarrier(scene.arm, study.servo, None, way)
    carrier.carry(np.array([0.02, 0.0, 0.0, 0.0, 0.0, 0.0]))
    carrier.move(2.0)
    joints, times = np.array(way.joints), np.array(way.times)
    moving = np.abs(np.diff(joints, axis=0)).max(axis=1) > 0.0
    assert HOLD - 0.02 < times[1:][moving].max() < HOLD + 0.1
    assert times[-1] == pytest.approx(2.0)


@pytest.mark.parametrize("axis", range(6))
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_wherever_an_arm_is_led_no_joint_leaves_its_range_and_the_limit_is_named(study, scene, axis, sign):
    twist = np.zeros(6)
    twist[axis] = sign * (0.4 if axis < 3 else 1.2)
    found = ended(study, scene, twist, seconds=8.0)
    joints = np.array(found.trajectory.joints)
    assert scene.arm.arm.limit_margins(joints).min() >= 0.0
    speeds = np.diff(joints, axis=0) / np.maximum(np.diff(found.trajectory.times), 1e-9)[:, None]
    assert (np.abs(speeds) <= scene.arm.arm.joint_speed * (1.0 + 1e-6)).all()
    if axis < 3:  # no arm reaches 3 m
        assert (found.status, found.joint_limit) == ("stopped", True)
        assert found.reason.startswith("joint_limit: ")


def test_a_plan_is_paced_within_the_speeds_of_the_camera_and_half_of_those_of_the_joints(study, scene):
    start = scene_start(study, scene.number, "fe185")
    found = planned(study, scene, "certified", start.estimated)
    law = found.time_law(study)
    w, speed, change = law.motion(np.linspace(0.0, law.duration, 2001))
    twists = found.plan.path(w, order=1) * speed[:, None]
    joints = found.joints(w, 1) * speed[:, None]
    bend = found.joints(w, 2) * speed[:, None] ** 2 + found.joints(w, 1) * change[:, None]
    arm, servo = scene.arm.arm, study.servo
    shares = {
        "linear": np.linalg.norm(twists[:, :3], axis=1).max() / (0.75 * servo.linear_speed),
        "angular": np.linalg.norm(twists[:, 3:], axis=1).max() / (0.75 * servo.angular_speed),
        "joint speed": (np.abs(joints) / (0.5 * arm.joint_speed)).max(),
        "joint acceleration": (np.abs(bend) / (0.5 * arm.joint_acceleration)).max(),
    }
    assert max(shares.values()) <= 1.01
    assert max(shares.values()) > 0.5 or law.duration == 2.0
    assert found.joints(0.0) == pytest.approx(scene.arm.start, abs=1e-6)


@pytest.mark.parametrize(("share", "goes_on"), [(0.7, True), (0.3, False)])
def test_a_ball_that_comes_near_leaves_links_half_their_room_or_stops_them(study, scene, share, goes_on):
    known = scene_start(study, scene.number, "fe185").estimated
    found = planned(study, scene, "certified", known)
    law, goal_pixels = found.time_law(study), known.goal_pixels
    tracker = PathTracker(found.plan, scene.camera, goal_pixels=goal_pixels, time_law=law)
    replanned = ReplannedTracker(study, scene, tracker, found)
    bodies = found.setting.bodies(())
    forearm = bodies.corners(scene.arm.start)[bodies.shapes_of("forearm")].mean(axis=(0, 1))

    def ball(lifted):
        centre = forearm + np.array([0.0, 0.0, lifted])
        return Sphere(found.setting.base_T_initial.inv().apply(centre), 0.01)

    def excess(lifted):
        among = found.setting.bodies((ball(lifted),))
        among.place(scene.arm.start)
        gaps = [among.measure(k) for k in range(len(among.pairs)) if "obstacle 0" in among.names(k)]
        return min(gaps) - share * found.setting.clearance

    replanned.set_obstacles((ball(brentq(excess, 0.05, 0.5)),))
    pixels, seen = scene.camera.project(known.points)
    with nullcontext() if goes_on else pytest.raises(Blocked, match="obstacles changed"):
        replanned.step(0.0, pixels, seen)
    assert len(replanned.events) == 1


def test_a_link_in_the_floor_is_a_collision_though_no_ball_is_near(study, scene):
    joints = np.tile(scene.arm.start, (3, 1))
    assert scene.arm.nearness(joints, ())[1] is False
    joints[1, 1] = 0.4  # the UR5e's upper arm and elbow point downwards
    least, touch = scene.arm.nearness(joints, ())
    assert touch
    assert least < -0.05


@pytest.mark.parametrize("folded", [False, True])
def test_a_row_whose_arm_touched_itself_is_a_collision_and_no_success(study, rows, scene, folded):
    way, row = Trajectory.standing(), next(row for row in rows if row.scene == scene.number)
    at_goal = replace(scene, initial_T_goal=way.end, obstacles=())
    joints = scene.arm.start.copy()
    if folded:
        joints[1:4] = -1.57, 3.1, 0.0
    way.joints.append(joints)
    found = scored(study, at_goal, row, way)
    assert (found.collision, found.success) == (folded, not folded)
    assert found.least_gap_m is None


def test_an_arm_that_folds_onto_itself_touches(study, scene):
    joints = scene.arm.start[None].copy()
    joints[0, 1:4] = -1.57, 3.1, 0.0
    assert scene.arm.nearness(joints, ())[1]


def test_a_mount_that_is_stated_wrongly_leads_the_camera_elsewhere(study, scene):
    off = MountError(0.02, 0.2).drawn(np.random.default_rng(4))
    assert np.linalg.norm(off.translation) == pytest.approx(0.02, rel=0.02)
    assert off.rotation.magnitude() == pytest.approx(0.2)
    wrong = replace(scene.arm, flange_T_camera=scene.arm.stated.flange_T_camera.transform * off)
    ways = Trajectory(), Trajectory()
    for placed, way in zip((scene.arm, wrong), ways, strict=True):
        carrier = ArmCarrier(placed, study.servo, None, way)
        carrier.carry(np.array([0.1, 0.0, 0.0, 0.0, 0.0, 0.0]))
        carrier.move(0.2)
        assert np.allclose(way.places[0], 0.0, atol=1e-12)
    directions = [np.array(way.end.translation) / np.linalg.norm(way.end.translation) for way in ways]
    assert 0.05 < np.arccos(directions[0] @ directions[1]) <= 0.2 + 1e-3


def test_the_report_says_success_collision_and_joint_limit_with_each_arm_and_without(study, rows):
    header = StudyHeader(study, "another", ())  # so that no row is drawn
    spoilt = [replace(row, joint_limit=row.arm == "panda") for row in rows]
    tally = StudyTally(spoilt)
    for found in tally.summaries():
        own = [row for row in spoilt if row.method == found.method]
        assert found.joint_limit.of == sum(row.arm != "none" for row in own)
        assert found.joint_limit.count == sum(row.arm == "panda" for row in own)
        assert set(found.arms) == {"none", "panda", "ur5e"}
        assert found.arms["panda"].joint_limit.share == 1.0
        assert found.arms["none"].joint_limit.of == 0
        assert sum(rates.success.of for rates in found.arms.values()) == found.success.of
    html = study_html(header, tally, PACKAGE)
    assert "With an arm and without" in html
    free = StudyTally(row for row in rows if row.arm == "none")
    assert "With an arm and without" not in study_html(header, free, PACKAGE)


def own_arm(folder, **mount):
    """Write an arm of one's own with a mesh, and return the study's fields that name it."""
    (folder / "robot" / "meshes").mkdir(parents=True)
    trimesh.creation.box((0.04, 0.04, 0.04)).export(folder / "robot" / "meshes" / "link.stl")
    (folder / "robot" / "arm.urdf").write_text(urdf(collision=MESH))
    placed = mount or {"translation": [0, 0, 0.1]}
    arm = f"{{model: robot/arm.urdf, flange_T_camera: {placed}}}"
    return {"arms": f"{{choice: [mine, none], mounts: {{mine: {arm}}}}}"}


def test_an_arm_of_one_s_own_travels_with_the_study_its_meshes_too(tmp_path):
    study = load_study(written(tmp_path, **own_arm(tmp_path), scenes=2, methods="[pbvs]", cameras="[fe185]"))
    (tmp_path / "robot" / "arm.urdf").unlink()
    work = pickle.loads(pickle.dumps(PartWork(study.to_json(), PACKAGE)))  # noqa: S301
    elsewhere = study_of_json(study.to_json())
    assert elsewhere.hash == study.hash
    assert set(elsewhere.arms.mounts["mine"].files) == {"arm.urdf", "meshes/link.stl"}
    assert elsewhere.arms.mounts["mine"].load().dof == 6
    part = part_of_content(study, PACKAGE.version, tmp_path, 0, work.content(0))
    assert [row.status in ("error", "no_scene") for row in part.rows].count(True) < 2


def test_the_hash_is_that_of_the_arm_s_files(tmp_path):
    fields = own_arm(tmp_path)
    before = load_study(written(tmp_path, **fields)).hash
    trimesh.creation.box((0.05, 0.04, 0.04)).export(tmp_path / "robot" / "meshes" / "link.stl")
    assert load_study(written(tmp_path, **fields)).hash != before


def test_a_mount_is_in_the_file_s_units(tmp_path):
    fields = own_arm(tmp_path, translation=[0, 0, 100])
    study = load_study(written(tmp_path, **fields, units="{length: mm, angle: deg}"))
    mount = study_of_json(study.to_json()).arms.mounts["mine"].flange_T_camera.transform
    assert np.allclose(mount.as_matrix(), RigidTransform.from_translation([0, 0, 0.1]).as_matrix())


@pytest.mark.parametrize(
    ("arms", "message"),
    [
        ("ur5", "arms.choice: 'ur5' given; legal: none, panda, rx60, ur5e; did you mean 'ur5e'"),
        ("[ur5e]", r"arms: \['ur5e'\] given; legal: none, a shipped arm"),
        ("{choice: []}", "arms.choice: "),
        ("{choice: [ur5e], mounts: {mine: {model: ur5e, flange_T_camera: {}}}}", "'mine' is not in choice"),
    ],
)
def test_a_wrong_choice_of_arms_is_named(tmp_path, arms, message):
    with pytest.raises(InputError, match=message):
        load_study(written(tmp_path, arms=arms))


@pytest.mark.parametrize(
    ("mount", "message"),
    [
        ("model: ur5e", "flange_T_camera: Field required"),
        ("model: ur5e, flange_T_camera: {}, foot: [0, 0, 1]", "foot: .*floor"),
        ("model: ../arm.urdf, flange_T_camera: {}", "inside the file's folder"),
        ("model: no.urdf, flange_T_camera: {}", "neither a file nor a shipped"),
        ("model: ../../x, flange_T_camera: {}, files: {a: ''}", "legal: one of the files kept with it"),
        ("model: /etc/passwd, flange_T_camera: {}, files: {}", "legal: panda"),
        ("model: a, flange_T_camera: {}, files: {a: '*'}", "Base64"),
        ("model: a, flange_T_camera: {}, files: {a: '', ../b: ''}", "legal: one that stays inside"),
    ],
)
def test_a_wrong_arm_is_named_and_no_file_elsewhere_is_read(tmp_path, mount, message):
    with pytest.raises(InputError, match=message):
        load_study(written(tmp_path, arms=f"{{choice: [mine], mounts: {{mine: {{{mount}}}}}}}"))


@pytest.mark.slow
def test_an_arm_goes_on_where_the_refined_goal_leaves_its_links_less_than_planned(monkeypatch):
    """By the refined estimate a wrist ends 4.9 mm from a ball; the first plan keeps 5."""
    study = load_study("paper-benchmark")
    row = run_row(study, 732).row
    assert row.success
    assert row.least_link_gap_m > 0.0
    monkeypatch.setattr("omniservo.studies.replanned_tracker._LATER", 1.0)
    blocked = run_row(study, 732).row
    assert blocked.status == "stopped"
    assert "4.87 mm apart; 5 mm are required" in blocked.reason
