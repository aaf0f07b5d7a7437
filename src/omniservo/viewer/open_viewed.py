"""From what the command is given, a task, a run, a problem or a plan, to what the page begins with."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.errors import InputError, spelled
from omniservo.estimation import TwoViewEstimate
from omniservo.files import read_document
from omniservo.geometry.arrays import FloatArray
from omniservo.planning import Plan, PlanningProblem
from omniservo.planning.certificate.certify import certified_but_for
from omniservo.planning.plan import FORMAT as PLAN_FORMAT
from omniservo.planning.problem_file import FORMAT as PROBLEM_FORMAT
from omniservo.reporting.image_distance import image_distance
from omniservo.runs.arm_setting_of import arm_setting_of
from omniservo.runs.plan_task import problem_of
from omniservo.runs.run_inputs import RunInputs
from omniservo.scenes import Scene, SceneBox, scene_of_task
from omniservo.shipped_tasks import shipped_tasks
from omniservo.tasks import Task, TaughtGoal, load_task
from omniservo.tasks.task import FORMAT as TASK_FORMAT
from omniservo.viewer.executed_run import ExecutedRun, read_executed
from omniservo.viewer.situation import ArmInScene, Situation
from omniservo.viewer.uncertain_target import uncertain_target
from omniservo.viewer.watched_run import WatchedRun, recording_of

_ESTIMATE = "estimate.json"
"""in the folder of a run"""

UPRIGHT = RigidTransform.from_rotation(Rotation.from_matrix([[1, 0, 0], [0, 0, 1], [0, -1, 0]]))
"""A camera that looks along the world's y, its image upright: where a problem's initial camera stands."""

_INSIDE = np.array([[x, y, 0.0] for x in (-0.4, 0.0, 0.4) for y in (-0.4, 0.0, 0.4)])
"""Places on a textured face, in parts of its sides, that stand for its features."""


@dataclass(frozen=True, eq=False)
class Viewed:
    """What the page begins with."""

    name: str
    situation: Situation
    plan: Plan | None = None
    """of a plan file or a run: judged again, and shown until something is changed"""
    run: ExecutedRun | None = None
    watched: WatchedRun | None = None
    """a run that goes on, or its recording"""


def open_viewed(
    what: str | Path, packages: Mapping[str, str | Path] | None = None, *, allow_outside: bool = False
) -> Viewed:
    """Return what a shipped task's name, a file, or the folder of a run holds.

    A run that goes on is named by the folder that its results will be in.

    Args:
        what: the name or path.
        packages: folders of ROS packages by name, for a task's arm.
        allow_outside: whether the files that a task names may lie outside its folder.

    Raises:
        InputError: it is none of them, or not legal; the message names file, field and what is legal.
    """
    path = Path(what)
    if str(what) in shipped_tasks():
        return viewed_task(load_task(what))
    recording = recording_of(path)
    if recording is not None:
        watched = WatchedRun(recording, allow_outside=allow_outside)
        return replace(viewed_task(watched.task, watched.scene), watched=watched)
    if path.is_dir():
        return _opened_run(path)
    fields = read_document(path)
    form = fields.get("format") if isinstance(fields, dict) else None
    if form == TASK_FORMAT:
        return viewed_task(load_task(path, packages=packages, allow_outside=allow_outside))
    if form == PROBLEM_FORMAT:
        return Viewed(path.stem, Situation(PlanningProblem.load(path), UPRIGHT))
    if form == PLAN_FORMAT:
        plan = Plan.load(path)
        return Viewed(path.stem, Situation(plan.problem, UPRIGHT), plan)
    legal = ", ".join(map(repr, (TASK_FORMAT, PROBLEM_FORMAT, PLAN_FORMAT)))
    raise InputError(f"{path}: format: {spelled(form)} given; legal: {legal}, or the folder of a run")


def judged_again(plan: Plan) -> Plan:
    """Return a file's plan with the planner's own certificate; certified only where both say so.

    Raises:
        InputError: its path is none of its problem.
    """
    if plan.path is None:
        return replace(plan, status="infeasible" if plan.status == "certified" else plan.status)
    verdict, certificate, missing = certified_but_for(plan.problem, plan.path)
    if plan.status != "certified" or missing is None:
        return replace(plan, certificate=certificate)
    amount = f"{missing.margin:.6g} {missing.unit} left"
    reason = f"its file says certified; judged again: {missing.name}: {amount}"
    return replace(plan, status=verdict, certificate=certificate, reason=reason)


def viewed_task(task: Task, scene: Scene | None = None) -> Viewed:
    """Return a task with the goal and the target that it states: what a run estimates from its images.

    Args:
        task: the job.
        scene: where it is done; None: the task's.
    """
    points = stated_points(task)
    problem = problem_of(task, task.teach.initial_T_goal.transform, points)
    return Viewed(task.name, situation_of(task, problem, scene))


def stated_points(task: Task) -> FloatArray:
    """Return the target's points (n, 3) as the task states them, in the initial camera frame [m].

    Dots' centres, tags' corners; of a textured face a few places that both end images show.
    """
    target = task.target
    if target.dots:
        return np.array([dot.center for dot in target.dots])
    if target.tags is not None:
        corners = 0.5 * np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
        return np.concatenate([tag.transform.apply(tag.edge * corners) for tag in target.tags.panels])
    points = np.concatenate([face.transform.apply(_INSIDE * [*face.size, 0.0]) for face in target.textures])
    kept = np.ones(len(points), dtype=bool)
    for camera_T_initial in (RigidTransform.identity(), task.teach.initial_T_goal.transform.inv()):
        pixels, valid = task.camera.project(camera_T_initial.apply(points))
        margin = image_distance(task.camera, np.where(valid[:, None], pixels, 0.0))
        kept &= valid & (margin > task.planning.visibility_margin + 1.0)
    if not kept.any():
        raise InputError(f"{task.name}: target: no place of its faces is in view at start and goal")
    return points[kept]


def situation_of(task: Task, problem: PlanningProblem, scene: Scene | None = None) -> Situation:
    """Return a problem with the arm and what stands around it; a body that is an obstacle moves with it."""
    scene = scene_of_task(task) if scene is None else scene
    world_T_initial = task.start.world_T_camera.transform
    pairs = {
        (k, i)
        for k, body in enumerate(scene.obstacles)
        for i, obstacle in enumerate(problem.obstacles)
        if isinstance(body, SceneBox) and _coincide(body, obstacle, world_T_initial)
    }
    known = {k for k, _ in pairs}
    others = tuple(body for k, body in enumerate(scene.obstacles) if k not in known)
    setting = arm_setting_of(task, scene)
    arm = ArmInScene(task, replace(scene, obstacles=others), setting)
    return Situation(problem, world_T_initial, arm, frozenset(i for _, i in pairs))


def _coincide(body: SceneBox, obstacle: Any, world_T_initial: RigidTransform) -> bool:
    if not hasattr(obstacle, "half_extents"):
        return False
    turn = Rotation.from_quat(np.array(obstacle.quaternion))
    pose = world_T_initial * RigidTransform.from_components(obstacle.center, turn)
    near = np.abs(pose.as_matrix() - body.world_T_box.as_matrix()).max() < 1e-6
    return bool(near and np.abs(obstacle.half_extents - body.half_extents).max() < 1e-6)


def _opened_run(folder: Path) -> Viewed:
    inputs, goal = RunInputs.read(folder), TaughtGoal.load(folder / "goal.json")
    with tempfile.TemporaryDirectory(prefix="omniservo-") as files:
        inputs.task.write(Path(files))
        task = inputs.task.load(Path(files), goal.camera)
        plan = Plan.load(folder / "plan.json") if (folder / "plan.json").is_file() else None
        stated = viewed_task(task).situation.problem if plan is None else plan.problem
        situation = situation_of(task, stated)
        if (folder / _ESTIMATE).is_file():
            uncertain = uncertain_target(TwoViewEstimate.load(folder / _ESTIMATE), stated)
            situation = replace(situation, uncertain=uncertain)
        run = read_executed(folder, scene_of_task(task), plan)
        if run is not None:  # the arm may have moved a little and looked again before it planned
            situation = situation.moved_as_a_whole(run.world_T_initial, run.joints[0])
        return Viewed(folder.name, situation, plan, run)
