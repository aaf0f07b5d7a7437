"""A camera that flies: a body of six axes in the place of an arm, in scenes drawn as a study draws them.

So a free camera runs in the very loop that arms run in, supervisor and all.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import numpy.typing as npt
from benchmarks.arm_runs import Truth
from benchmarks.motion_faults import Job, PostureGaps
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.geometry.arrays import FloatArray, finite_array, frozen
from omniservo.planning import CameraPath
from omniservo.robots import Arm
from omniservo.servoing import EvenPaceLaw
from omniservo.studies import PACKAGE, Study
from omniservo.studies.load_study import study_of_json
from omniservo.studies.scene_start import scene_start
from omniservo.studies.study_controller import NotLed, controller_of_scene
from omniservo.studies.study_scene import NoScene, StudyScene

STUDY = """{
  "format": "omniservo.study/1", "name": "faults", "seed": 29, "units": {"angle": "deg"},
  "scenes": 100000, "cameras": ["fe185", "perspective"], "methods": ["certified-once"],
  "target": {"points": 20, "size": 0.25, "distance": {"uniform": [0.4, 0.7]},
             "off_axis": {"uniform": [0, 15]}},
  "start": {"rotation": {"uniform": [5, 120]}, "distance_ratio": {"uniform": [0.8, 1.6]},
            "off_axis": {"uniform": [0, 15]}},
  "obstacles": {"count": {"choice": [1, 2]}, "radius": 0.02, "clearance": 0.03},
  "images": {"noise": {"uniform": [0.1, 0.5]}},
  "servo": {"clearance_margin": 0.02}
}"""
"""Balls of 2 cm by the way of a camera with a radius of 3 cm, whose plan keeps 2 cm more."""

CLEARANCE_MARGIN = 0.02
MOST_OFF = 0.01
"""[m] that a scene's estimate may have the goal off: what is left of the room is for the fault"""
_NOWHERE = RigidTransform.identity()
_STEP = 1e-4


class FreeBody(Arm):
    """Moved by six axes: its place (x, y, z) [m], and the rotation vector of its axes [rad]."""

    def __init__(self) -> None:
        self.joint_names = ("x", "y", "z", "turn x", "turn y", "turn z")
        self.joint_range = frozen(np.tile([-6.0, 6.0], (6, 1)))
        self.joint_speed = frozen(np.array([1.0, 1.0, 1.0, 3.0, 3.0, 3.0]))
        self.joint_acceleration = frozen(np.array([3.0, 3.0, 3.0, 12.0, 12.0, 12.0]))

    @property
    def name(self) -> str:
        """What it is."""
        return "free camera"

    @property
    def dof(self) -> int:
        """Of a body."""
        return 6

    def __repr__(self) -> str:
        return "FreeBody()"

    def _locate(self, q: npt.ArrayLike, length: float = 1.0) -> tuple[FloatArray, FloatArray]:
        joints = finite_array("q", q, (6,))
        axes = Rotation.from_rotvec(joints[3:]).as_matrix()
        jacobian = np.zeros((6, 6))
        jacobian[:3, :3] = axes.T / length
        jacobian[3:, 3:] = turning(joints[3:])
        return np.column_stack([axes, joints[:3]]), jacobian


def turning(vector: FloatArray) -> FloatArray:
    """Return J (3, 3) of ω = J ṙ: ω the angular velocity in the body's axes, r its rotation vector."""
    angle = float(np.linalg.norm(vector))
    x, y, z = vector
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    if angle < _STEP:
        return np.asarray(np.eye(3) - 0.5 * skew)
    first = (1.0 - np.cos(angle)) / angle**2
    second = (angle - np.sin(angle)) / angle**3
    return np.asarray(np.eye(3) - first * skew + second * skew @ skew)


@dataclass(frozen=True)
class _BodyPath:
    """The axes along a camera path, and by differences how they change."""

    path: CameraPath

    def __call__(self, w: float, order: int = 0) -> FloatArray:
        if order:
            low, high = max(w - _STEP, 0.0), min(w + _STEP, 1.0)
            return np.asarray((self(high) - self(low)) / (high - low))
        pose = self.path(w)
        return np.concatenate([pose.translation, pose.rotation.as_rotvec()])


@dataclass(frozen=True)
class _BallGaps:
    """Distances of a body with a radius to balls."""

    scene: StudyScene
    asked: float

    def least(self, joints: FloatArray) -> float:
        """Return the least that postures (m, 6) leave beyond what is asked [m]."""
        gaps = [
            np.linalg.norm(joints[:, :3] - ball.center, axis=1) - ball.radius for ball in self.scene.obstacles
        ]
        return float(np.min(gaps, initial=np.inf)) - self.scene.clearance - self.asked


@dataclass(frozen=True, eq=False)
class FreeJob(Job):
    """A planned way of a free camera."""

    scene: StudyScene

    @property
    def goal(self) -> RigidTransform:
        """Where the goal truly is."""
        return self.scene.initial_T_goal

    @property
    def room(self) -> float:
        """What the plan keeps to everything around, beyond the body's radius [m]."""
        return CLEARANCE_MARGIN

    def gaps(self, asked: float, self_asked: float) -> PostureGaps:
        """Return what measures distances to the balls; a body has no other parts."""
        del self_asked
        return _BallGaps(self.scene, asked)


@cache
def free_job(index: int) -> FreeJob:
    """Return a planned scene, the same each time: the first with a plan from 8 times its index on."""
    study = study_of_json(STUDY)
    found = (planned(study, number) for number in range(8 * index, study.scenes))
    return next(job for job in found if job is not None)


def planned(study: Study, number: int) -> FreeJob | None:
    """Return a scene with its plan; None: there is none, or it ends beside the goal."""
    name = list(study.cameras)[number % len(study.cameras)]
    start = scene_start(study, number, name)
    if isinstance(start, NoScene):
        return None
    try:
        led = controller_of_scene(study, start, PACKAGE, study.methods[0])
    except NotLed:
        return None
    scene = start.scene
    tracker, plan = led.controller, led.plan
    if plan is None or plan.path is None:
        return None
    off = plan.problem.initial_T_goal.translation - scene.initial_T_goal.translation
    if np.linalg.norm(off) > MOST_OFF:
        return None
    law = tracker.time_law  # type: ignore[attr-defined]
    assert isinstance(law, EvenPaceLaw)
    balls = [(np.array(ball.center), ball.radius) for ball in scene.obstacles]
    points = scene.points[led.followed]
    truth = Truth(FreeBody(), np.zeros(6), _NOWHERE, scene.camera, points, balls)  # type: ignore[arg-type]
    return FreeJob(truth, plan, _BodyPath(plan.path), law, scene)
