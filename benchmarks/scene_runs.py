"""A servo method on a scene of one's own making; loop and estimate are those of a study."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.cameras.models import CentralModel
from omniservo.estimation import estimate_known_target
from omniservo.geometry.arrays import FloatArray
from omniservo.studies.closed_loop import ClosedLoop
from omniservo.studies.program import PACKAGE
from omniservo.studies.scene_start import Estimated, SceneStart, estimate_of_scene
from omniservo.studies.study import Study
from omniservo.studies.study_camera import StudyCamera
from omniservo.studies.study_controller import NotLed, controller_of_scene
from omniservo.studies.study_scene import Conditions, Geometry, StudyScene

METHODS = (
    "certified", "paper", "ibvs", "ibvs-desired", "ibvs-mean", "bearing", "spherical", "pbvs", "pbvs-target",
    "hybrid-2.5d", "switched",
)  # fmt: skip


@dataclass(frozen=True)
class Run:
    """How a run ended."""

    status: str
    reason: str
    success: bool
    """near the goal, as the study's limits have it, and without a collision"""
    translation: float
    """of the last pose from the goal [m]"""
    rotation: float
    """likewise [rad]"""
    length: float
    """of the camera's way [m]"""
    seconds: float
    lost: bool
    """a point left the image"""
    farthest: float
    """of the camera from the goal on its way [m]"""


def study_of(name: str, camera: CentralModel, method: str, **sections: object) -> Study:
    """Return the study of one method that says how a run is made."""
    return Study(name=name, scenes=1, cameras={"camera": camera}, methods=(method,), **sections)  # type: ignore[arg-type]


def scene_of(
    camera: CentralModel, points: FloatArray, initial_T_goal: RigidTransform, noise: float
) -> StudyScene:
    """Return the scene of a start and a goal, without obstacles, images 20 ms old when they arrive."""
    conditions = Conditions(
        noise, lost=0.0, wrong=0.0, latency=0.02, jitter=0.0, dropped=0.0, delayed=0.0, delay=0.0, model=0.0,
        focal=0.0, centre=(0.0, 0.0), depth=0.0,
    )  # fmt: skip
    far = [float(np.linalg.norm(p.mean(axis=0))) for p in (points, initial_T_goal.inv().apply(points))]
    turn = float(initial_T_goal.rotation.magnitude())
    drawn = Geometry(len(points), 0.0, far[1], 0.0, turn, far[0] / far[1], 0.0, 0)
    return StudyScene(0, camera, None, drawn, conditions, points, initial_T_goal, (), 0.0)


def run_method_on(
    study: Study,
    scene: StudyScene,
    seed: int,
    *,
    known: bool = False,
    camera: type[StudyCamera] = StudyCamera,
) -> Run:
    """Run the study's method on a scene.

    Args:
        study: of one method; how it is run, and what counts as success.
        scene: what is true.
        seed: of the images.
        known: the target's geometry is known to the method.
        camera: takes the images.
    """
    random, goal = np.random.default_rng([seed, 1]), scene.initial_T_goal
    taken_by = camera(scene, random)
    estimated = _pose_of_known(scene, taken_by) if known else estimate_of_scene(study, scene, taken_by)
    start = SceneStart(scene, estimated, random)
    try:
        led = controller_of_scene(study, start, PACKAGE, study.methods[0])
    except NotLed as none:
        off, turn = float(np.linalg.norm(goal.translation)), float(goal.rotation.magnitude())
        return Run(none.status, none.reason, False, off, turn, 0.0, 0.0, False, off)
    ended = ClosedLoop(study, scene, taken_by, led).run()
    way, off = ended.trajectory, goal.inv() * ended.trajectory.end
    farthest = float(np.linalg.norm(way.centres - goal.translation, axis=1).max())
    translation, rotation = float(np.linalg.norm(off.translation)), float(off.rotation.magnitude())
    gap, limits = way.least_gap(scene), study.limits
    near = translation <= limits.translation and rotation <= limits.rotation
    success = near and (gap is None or gap >= scene.clearance)
    return Run(
        ended.status, ended.reason, success, translation, rotation, way.length, way.times[-1],
        way.feature_lost, farthest,
    )  # fmt: skip


def _pose_of_known(scene: StudyScene, camera: StudyCamera) -> Estimated | str:
    """Return what two images say of a target whose points are known."""
    goal = scene.initial_T_goal
    images = [camera.take(p.rotation.as_matrix(), np.array(p.translation)) for p in (goal * goal.inv(), goal)]
    pixels = images[0].pixels, images[1].pixels
    estimate = estimate_known_target(scene.camera, scene.points, *pixels)
    if estimate.initial_T_goal is None:
        return f"{estimate.status}: {estimate.message}"
    rows = np.flatnonzero(estimate.inliers)
    points = estimate.points[rows]
    return Estimated(estimate, estimate.initial_T_goal, rows, points, None, pixels[1][rows])
