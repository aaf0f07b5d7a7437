from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.cameras import PRESETS, UnifiedCamera, preset
from omniservo.errors import InputError
from omniservo.planning import PlanningProblem, Sphere, plan_path
from omniservo.planning.obstacles.obstacle import KINDS
from omniservo.tasks import load_task, shipped_tasks
from omniservo.tasks.save_task import save_task
from omniservo.viewer.along_path import MarginCurve, camera_curves
from omniservo.viewer.camera_view import drawn_obstacles, with_trajectories
from omniservo.viewer.edited_task import edited_task
from omniservo.viewer.field_of_view import field_outline, field_surface
from omniservo.viewer.file_tab import written
from omniservo.viewer.new_obstacle import new_obstacle, obstacles_of_file
from omniservo.viewer.open_viewed import open_viewed
from omniservo.viewer.plots import plots_html
from omniservo.viewer.situation import Situation, obstacle_pose, with_xi
from omniservo.viewer.worst_place import nearest_of
from omniservo.whole_arm import plan_with_arm

TURN = RigidTransform.from_components([0.03, -0.02, 0.05], Rotation.from_rotvec([0.2, -0.4, 0.3]))


@pytest.fixture(scope="module")
def situation():
    return open_viewed("whole-arm-1").situation


def world_distances(situation, places):
    """Distances of places in the world to every obstacle."""
    there = np.ascontiguousarray(situation.world_T_initial.inv().apply(places))
    return np.array([o.distance(there) for o in situation.problem.obstacles])


@pytest.mark.parametrize("kind", KINDS)
def test_an_obstacle_of_any_kind_moves_rigidly_with_its_handle(situation, kind):
    put = situation.with_added(new_obstacle(kind, situation))
    (last,) = [len(put.problem.obstacles) - 1]
    handle = put.handles[last]
    places = put.world_T_initial.apply(np.random.default_rng(1).uniform(-0.3, 0.6, (40, 3)))
    moved = put.moved(handles={last: TURN * handle})
    before = world_distances(put, places)[last]
    after = world_distances(moved, TURN.apply(places))[last]
    assert np.abs(after - before).max() < 1e-9
    assert moved.problem.obstacles[0] is put.problem.obstacles[0]


def test_the_world_stands_still_where_the_start_is_dragged(situation):
    start = situation.world_T_initial * RigidTransform.from_translation([0.01, 0.02, -0.02])
    moved = situation.moved(start=start)
    places = situation.world_T_initial.apply(np.random.default_rng(2).uniform(-0.3, 0.6, (40, 3)))
    assert np.abs(world_distances(moved, places) - world_distances(situation, places)).max() < 1e-9
    assert np.allclose(moved.world_T_goal.as_matrix(), situation.world_T_goal.as_matrix(), atol=1e-12)
    points = [s.world_T_initial.apply(s.problem.points) for s in (moved, situation)]
    assert np.abs(points[0] - points[1]).max() < 1e-12
    camera = moved.arm.scene.world_T_camera(moved.arm.setting.start)
    assert np.allclose(camera.as_matrix(), start.as_matrix(), atol=1e-8)


def test_a_start_out_of_reach_is_refused_by_name(situation):
    far = RigidTransform.from_translation([3.0, 0.0, 0.0]) * situation.world_T_initial
    with pytest.raises(InputError, match="the arm cannot start there"):
        situation.moved(start=far)


def test_a_risk_is_refused_where_target_and_goal_are_exact(situation):
    with pytest.raises(InputError, match="risk: target and goal are taken as exact"):
        situation.with_risk(0.01)
    assert situation.with_risk(0.0).risk == 0.0


def test_handles_that_did_not_move_change_nothing(situation):
    same = situation.moved(
        situation.world_T_initial, situation.world_T_goal, dict(enumerate(situation.handles))
    )
    assert same is situation


@pytest.mark.parametrize("name", shipped_tasks())
def test_a_saved_task_states_the_same_problem(name, tmp_path):
    viewed = open_viewed(name)
    save_task(edited_task(viewed.situation), tmp_path / "task.yaml")
    again = open_viewed(tmp_path / "task.yaml")
    before, after = viewed.situation, again.situation
    assert np.abs(before.problem.points - after.problem.points).max() < 1e-12
    for a, b in zip(before.problem.obstacles, after.problem.obstacles, strict=True):
        assert np.abs(a.distance(before.problem.points) - b.distance(before.problem.points)).max() < 1e-12
    assert before.problem.clearance == pytest.approx(after.problem.clearance)
    assert before.problem.degrees == after.problem.degrees
    assert before.bodies == after.bodies
    assert len(before.arm.scene.obstacles) == len(after.arm.scene.obstacles)


def test_a_saved_task_has_what_was_moved_and_added_and_its_bodies(situation, tmp_path):
    put = situation.with_added(new_obstacle("box", situation)).with_added(new_obstacle("capsule", situation))
    put = put.moved(goal=put.world_T_goal * RigidTransform.from_translation([0.0, 0.01, 0.0]))
    put = put.moved(start=put.world_T_initial * RigidTransform.from_translation([0.01, 0.0, 0.0]))
    save_task(edited_task(put), tmp_path / "task.yaml")
    task = load_task(tmp_path / "task.yaml")
    again = open_viewed(tmp_path / "task.yaml").situation
    assert len(task.obstacles) == 2  # the task's own box and the one that was added
    assert len(again.problem.obstacles) == 3
    assert again.bodies == {0, 1}
    places = put.world_T_initial.apply(np.random.default_rng(3).uniform(-0.3, 0.6, (40, 3)))
    assert np.abs(world_distances(again, places) - world_distances(put, places)).max() < 1e-9
    assert np.allclose(again.world_T_goal.as_matrix(), put.world_T_goal.as_matrix(), atol=1e-9)
    points = [s.world_T_initial.apply(s.problem.points) for s in (again, put, situation)]
    assert np.abs(points[0] - points[1]).max() < 1e-9
    assert np.abs(points[1] - points[2]).max() < 1e-9
    boards = [s.arm.scene.boards[0].world_T_box.as_matrix() for s in (again, situation)]
    assert np.allclose(*boards, atol=1e-9)


def test_a_plan_file_is_shown_as_it_is_and_other_files_are_refused(tmp_path):
    problem = PlanningProblem(preset("fe185"), [[0, 0, 0.5]], RigidTransform.from_translation([0.1, 0, 0]))
    plan_path(problem).save(tmp_path / "plan.json")
    viewed = open_viewed(tmp_path / "plan.json")
    assert viewed.plan.status == "certified"
    assert viewed.situation.arm is None
    problem.save(tmp_path / "problem.json")
    assert open_viewed(tmp_path / "problem.json").plan is None
    (tmp_path / "other.json").write_text('{"format": "omniservo.goal/2"}')
    with pytest.raises(
        InputError, match=r"other.json: format: 'omniservo.goal/2' given; legal: 'omniservo.task/1'"
    ):
        open_viewed(tmp_path / "other.json")


@pytest.mark.parametrize("kind", KINDS)
def test_the_nearest_place_of_an_obstacle_lies_on_its_surface_at_its_distance(situation, kind):
    obstacle = new_obstacle(kind, situation)
    place = np.array([0.02, 0.31, -0.05])
    nearest = nearest_of(obstacle, place)
    gap = float(obstacle.distance(place[None])[0])
    assert abs(float(obstacle.distance(nearest[None])[0])) < 1e-5
    assert np.linalg.norm(nearest - place) == pytest.approx(abs(gap), abs=1e-5)


@pytest.mark.parametrize("name", PRESETS)
def test_the_drawn_field_is_what_the_image_shows(name):
    camera = PRESETS[name]
    vertices, faces = field_surface(camera, 0.2)
    seen = vertices[np.linalg.norm(vertices, axis=1) > 0.1]
    pixels, valid = camera.project(0.999 * seen + 0.001 * np.array([0.0, 0.0, 0.2]))
    assert valid.all()
    rim = field_outline(camera, 0.2)[:, 0]
    inside = camera.in_image(pixels)[len(rim) :]  # the innermost ring lies on a dead zone's border
    assert inside.mean() > 0.98
    polar = np.arccos(rim[:, 2] / 0.2)
    beyond = rim * [1.02, 1.02, 1.0] if camera.usable_angle < 1.5 else np.add(rim, [0.0, 0.0, -0.02])
    pixels, valid = camera.project(beyond)
    assert (~valid | ~camera.in_image(np.nan_to_num(pixels, nan=-1e6))).mean() > 0.95
    assert polar.max() <= camera.usable_angle
    assert faces.max() == len(vertices) - 1


@pytest.mark.parametrize("xi", [0.0, 0.5, 2.0])
def test_another_xi_leaves_the_middle_of_the_image_as_large(xi):
    camera = PRESETS["fe185"]
    changed = with_xi(camera, xi)
    near = np.array([[0.001, 0.0, 1.0], [0.0, 0.001, 1.0], [0.0, 0.0, 1.0]])
    assert np.abs(changed.project(near)[0] - camera.project(near)[0]).max() < 1e-3
    assert changed.xi == xi


def obstacles_of(name, content):
    """What is added of a file that is uploaded."""
    with written(SimpleNamespace(name=name, content=content)) as path:
        return obstacles_of_file(path)


def test_obstacles_come_from_meshes_clouds_and_problem_files():
    sheet = "\n".join(f"{x} {y} 0.5" for x in (0.1, 0.2) for y in (0.1, 0.2))
    (cloud,) = obstacles_of("wall.xyz", sheet.encode())
    assert (len(cloud.points), cloud.file) == (4, "wall.xyz")
    ball = b'{"obstacles": [{"type": "sphere", "center": [0.1, 0, 0.2], "radius": 0.05}]}'
    (sphere,) = obstacles_of("balls.json", ball)
    assert isinstance(sphere, Sphere)
    with pytest.raises(InputError, match=r"^balls.json: no list of obstacles"):
        obstacles_of("balls.json", b"[1]")
    for name, content in (("balls.json", b'{"obstacles": [1]}'), ("wall.xyz", b""), ("wall.xyz", b"nan 0 0")):
        with pytest.raises(InputError, match=f"^{name}: "):
            obstacles_of(name, content)


def test_the_own_frame_of_an_obstacle_is_where_its_handle_is(situation):
    for kind in KINDS:
        obstacle = new_obstacle(kind, situation)
        pose = obstacle_pose(obstacle)
        gap = float(obstacle.distance(np.ascontiguousarray(pose.translation)[None])[0])
        assert gap < 0.02, kind


def test_a_situation_without_an_arm_has_no_task():
    problem = PlanningProblem(preset("fe185"), [[0, 0, 0.5]], RigidTransform.from_translation([0.1, 0, 0]))
    with pytest.raises(InputError, match="without an arm"):
        edited_task(Situation(problem, RigidTransform.identity()))


def test_a_budget_ends_the_arm_s_search_after_the_start_at_hand_and_else_changes_nothing(situation):
    problem, setting = situation.problem, situation.arm.setting
    free, ample, none = (plan_with_arm(problem, setting, time_budget=s) for s in (None, 600.0, 1e-9))
    assert free.certified
    assert np.array_equal(free.plan.path.translation, ample.plan.path.translation)
    assert none.attempts == 1
    with pytest.raises(InputError, match="time_budget"):
        plan_with_arm(problem, setting, time_budget=0.0)


def test_a_view_takes_little_memory_however_large_an_image_a_problem_states():
    wide = UnifiedCamera(4e4, 4e4, 5e4, 5e4, 0.8, 100_000, 100_000)
    problem = PlanningProblem(wide, [[0, 0, 0.5]], TURN, (Sphere([0.1, 0.0, 0.4], 0.03),))
    small = replace(problem, camera=UnifiedCamera(384, 384, 479.5, 479.5, 0.8, 960, 960))
    here = RigidTransform.identity()
    view, same = (drawn_obstacles(p, here) for p in (problem, small))
    assert view.shape == same.shape == (960, 960)
    assert (np.abs(view.astype(int) - same) > 20).mean() < 1e-3  # where it is in such an image
    assert with_trajectories(view, plan_path(problem), 0.0).shape == (480, 480, 3)
    narrow = UnifiedCamera(4e4, 4e4, 5e4, 0.0, 0.8, 100_000, 1)
    assert drawn_obstacles(replace(problem, camera=narrow), here).shape == (1, 960)


def test_curve_of_a_camera_that_deviates_is_above_what_is_certified_and_required():
    """All three are of the model's pixels, of which the true ones may be off by the deviation."""
    fields = preset("fe185").to_dict() | {"deviation_px": 1.5}
    points = [[-0.1, 0.0, 0.6], [0.1, 0.1, 0.5]]
    goal = RigidTransform.from_translation([0.0, -0.1, 0.2])
    problem = PlanningProblem(UnifiedCamera.from_dict(fields), points, goal, visibility_margin=5.0)
    curve = camera_curves(plan_path(problem))[-1]
    assert curve.required == pytest.approx(6.5)
    assert curve.required - 1e-6 <= curve.certified <= curve.values.min()
    assert curve.certified > curve.values.min() - 0.5


def test_a_bound_is_rounded_down_beside_its_curve():
    curve = MarginCurve("camera to obstacles", "mm", np.linspace(0, 1, 2), np.full(2, 57.0), 55.0, 56.989)
    assert "certified ≥ 56.98 mm" in plots_html([curve], 0.0)
