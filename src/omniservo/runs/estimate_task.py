"""Motion and structure of a task's two images, made metric by the task's scale."""

from __future__ import annotations

import numpy as np

from omniservo.cameras.models import CentralModel
from omniservo.errors import InputError, NoSolutionError
from omniservo.estimation import TwoViewEstimate, estimate_known_target, estimate_two_view
from omniservo.estimation.deferred import changed
from omniservo.geometry.arrays import FloatArray
from omniservo.perception import DotKind, MatchedPoints
from omniservo.results.run_result import Seen
from omniservo.scenes.scene import Scene
from omniservo.targets import Target
from omniservo.tasks import Task, TaughtGoal

TwoViewScale = float | tuple[tuple[int, int], float]
"""As `estimate_two_view` takes it."""

_LEAST_DISPLACEMENT = 1e-5
"""[m] No arm knows a shorter one."""


def estimate_task(
    task: Task, scene: Scene, seen: Seen, goal: TaughtGoal, joints: FloatArray
) -> TwoViewEstimate:
    """Return the metric estimate of goal pose and target.

    Args:
        task: its scale says what makes the estimate metric.
        scene: the arm's kinematics, for ``odometry``.
        seen: the matched points.
        goal: with the arm's joints, where ``odometry`` is the scale.
        joints: (n,) the arm's joints at the initial image [rad].

    Raises:
        InputError: the scale names dots that are not there, or needs joints that the goal does not hold.
        NoSolutionError: the images do not determine the motion.
    """
    if task.scale.tags:
        return _with_pose(task, estimate_on_target(task.camera, seen.matched, task.target.known))
    scale = _scale(task, scene, seen, goal, joints)
    matched = seen.matched
    return _with_pose(
        task,
        estimate_two_view(
            task.camera,
            matched.initial,
            matched.goal,
            scale=scale,
            noise=matched.noise,
            scale_sigma=task.scale.sigma,
            squares=matched.squares,
            windows=matched.window,
        ),
    )


def estimate_on_target(
    camera: CentralModel, matched: MatchedPoints, target: Target | None, dictionary: str | None = None
) -> TwoViewEstimate:
    """Return the metric estimate from the corners of a target's tags.

    Raises:
        InputError: no target, or none with tags of the dictionary.
        NoSolutionError: a tag that the target does not have.
    """
    if target is None or matched.ids is None:
        raise InputError("target: tags of known size and place are needed")
    points, known = target.corners_of(matched.ids, dictionary)
    if not known.all():
        stranger = int(matched.ids[int(np.argmin(known))]) // 4
        raise NoSolutionError(f"tag {stranger} is in both images, but the target has no such tag")
    return estimate_known_target(
        camera, points, matched.initial, matched.goal, noise=matched.noise, squares=matched.squares
    )


def _with_pose(task: Task, estimate: TwoViewEstimate) -> TwoViewEstimate:
    """Return the estimate with the task's camera; refuse one without a pose."""
    if estimate.status != "ok":
        raise NoSolutionError(
            f"motion and structure cannot be estimated: {estimate.status}: {estimate.message}"
        )
    return changed(estimate, camera=task.camera)


def known_dots(task: Task, seen: Seen) -> tuple[int, int]:
    """Return the matched points (rows) between which the task knows the length.

    Raises:
        InputError: the task knows none, or one of its dots is not matched.
    """
    if task.scale.known_length is None:
        raise InputError("scale.known_length: missing")
    field, kind, image = "scale.known_length.dots", DotKind(), seen.initial_image
    i, j = (
        kind.row(field, dot, image, task.camera, seen.matched.initial) for dot in task.scale.known_length.dots
    )
    return i, j


def _scale(task: Task, scene: Scene, seen: Seen, goal: TaughtGoal, joints: FloatArray) -> TwoViewScale:
    if task.scale.displacement is not None:
        return task.scale.displacement
    if task.scale.known_length is not None:
        return known_dots(task, seen), task.scale.known_length.length
    if goal.joints is None:
        raise InputError("scale.odometry: the taught goal holds no joints; give a displacement or a length")
    moved = scene.world_T_camera(goal.joints).translation - scene.world_T_camera(joints).translation
    distance = float(np.linalg.norm(moved))
    if distance < _LEAST_DISPLACEMENT:
        raise InputError(
            f"scale.odometry: by the arm's joints the camera is {1e3 * distance:.2g} mm from where the goal"
            " was taught: it stands there already, or turns without moving, which shows no depth"
        )
    return distance
