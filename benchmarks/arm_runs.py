"""Closed loops of a whole simulated arm, on projected or rendered pixels; how near to everything it came."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.cameras import UnifiedCamera
from omniservo.geometry.arrays import BoolArray, ByteArray, FloatArray
from omniservo.perception import DotTracker, FeatureTracker
from omniservo.planning import Plan
from omniservo.reporting.image_distance import image_distance
from omniservo.robots import CAMERA_HOUSING, Arm, JointPath, Solid
from omniservo.safety import SafetyOptions, Step, Supervisor, VisibilityFilter, servo
from omniservo.scenes import Ball, Dots, Scene, Sensor
from omniservo.servoing import PathLimits, RestToRestLaw
from omniservo.simulation import SimulatedRobot
from omniservo.simulation.unified_renderer import UnifiedRenderer
from omniservo.simulation.world import World
from omniservo.tracking import PathTracker, TrackerOptions

JOINT_SHARE, LEAST_DURATION = 0.5, 4.0
"""of the time law: as `omniservo run` takes them"""

TARGET = {"points": 20, "spread": 0.15, "depth": 1.0}
"""of `random_task`: 20 points in a box of 0.30 m"""

NOISE_PX = 0.5
TOLERANCE_PX = 2.0
"""rms distance to the goal image at which a run may end: the noise alone is 0.7 px"""

VISIBLE_PX = SafetyOptions().visibility_margin
"""Planned points keep this distance to the image's limits, as the visibility filter does."""

LEAST_DISTANCE = 0.05
"""[m] from the camera's centre to every point: one that it all but touches runs through the image at once"""

DOT_RADIUS = 0.01
"""[m] of a rendered point"""

SETTLING = 1.5
"""[s] that a run may take longer than its time law"""

SPARSE = 24
"""Views and poses are looked at every 24 ms."""

PLACES = 401
"""of the planned path"""

FAR = 0.1
"""[m] Gaps that are larger beyond what is asked are not told apart from it."""


@dataclass(frozen=True, eq=False)
class Truth:
    """What is really there."""

    arm: Arm
    start: FloatArray
    """(n,) [rad]"""
    flange_T_camera: RigidTransform
    camera: UnifiedCamera
    points: FloatArray
    """(m, 3) in the initial camera frame [m]"""
    balls: Sequence[tuple[FloatArray, float]]
    """centre in the initial camera frame, radius [m]"""

    @property
    def base_T_initial(self) -> RigidTransform:
        """The initial camera in the base frame."""
        return self.arm.base_T_flange(self.start) * self.flange_T_camera

    def initial_T_camera(self, joints: FloatArray) -> RigidTransform:
        """Return where postures (m, n) have the camera."""
        flange = np.array([self.arm.base_T_flange(q).as_matrix() for q in joints])
        return self.base_T_initial.inv() * RigidTransform.from_matrix(flange) * self.flange_T_camera


@dataclass(eq=False)
class ArmRun:
    """One executed plan."""

    joints: FloatArray
    """(m, n) every millisecond [rad]"""
    path: FloatArray
    """(k, n) planned [rad]"""
    stop: str
    """"" where the goal was reached or the time was over; else the name of what stopped it"""
    visible: float
    """smallest distance of a true point to the image's limits [px]"""
    goal_error_px: float
    """rms of the true points to where the goal image has them, at the end"""
    centres: FloatArray
    """(m/24, 3) of the camera, in the initial camera frame [m]"""
    image_px: float
    """the most that a true point strayed in the image from where the plan has it at the nearest place [px]"""
    contacts: frozenset[tuple[str, str]]
    """what touched, at any millisecond"""


class _Projected:
    """The target's true projections with noise."""

    def __init__(
        self, robot: SimulatedRobot, truth: Truth, random: np.random.Generator, noise_px: float
    ) -> None:
        self._robot, self._truth, self._random, self._noise_px = robot, truth, random, noise_px
        self._initial_T_base = truth.base_T_initial.inv()

    def update(self, image: ByteArray, predicted: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Return where the newest frame shows the points."""
        del image, predicted
        newest = self._robot.image()
        assert newest is not None
        pose = self._initial_T_base * self._robot.world_T_camera(newest.time)
        pixels, valid = self._truth.camera.project(pose.inv().apply(self._truth.points))
        valid = valid & self._truth.camera.in_image(np.where(valid[:, None], pixels, 0.0))
        noisy = pixels + self._noise_px * self._random.standard_normal(pixels.shape)
        seen = valid & self._truth.camera.unproject(np.where(valid[:, None], noisy, 0.0))[1]
        return np.where(seen[:, None], noisy, np.nan), seen


class _Rendered:
    """The target's dots, found in rendered pictures, with noise added to where they are found."""

    def __init__(self, camera: UnifiedCamera, random: np.random.Generator, noise_px: float) -> None:
        self._tracker, self._random, self._noise_px = DotTracker(camera), random, noise_px
        self._camera = camera

    def update(self, image: ByteArray, predicted: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Return where the newest frame shows the points."""
        pixels, seen = self._tracker.update(image, predicted)
        noisy = pixels + self._noise_px * self._random.standard_normal(pixels.shape)
        seen = seen & self._camera.unproject(np.where(seen[:, None], noisy, 0.0))[1]
        return np.where(seen[:, None], noisy, np.nan), seen


def dots_of(truth: Truth, initial_T_goal: RigidTransform) -> Dots:
    """Return discs at the points, each turned half way between the two views."""
    towards = [pose.translation - truth.points for pose in (RigidTransform.identity(), initial_T_goal)]
    normals = sum(way / np.linalg.norm(way, axis=1, keepdims=True) for way in towards)
    place = truth.base_T_initial
    return Dots(place.apply(truth.points), place.rotation.apply(normals), DOT_RADIUS)


def scene_of(truth: Truth, dots: Dots | None) -> Scene:
    """Return the simulator's world, its origin at the arm's base."""
    balls = (Ball(f"ball {i}", truth.base_T_initial.apply(c), r) for i, (c, r) in enumerate(truth.balls))
    return Scene(
        truth.arm, RigidTransform.identity(), truth.flange_T_camera, truth.camera, truth.start, Sensor(),
        obstacles=tuple(balls), dots=dots,
    )  # fmt: skip


def found_in_picture(
    truth: Truth, joints: FloatArray, dots: Dots, random: np.random.Generator
) -> tuple[FloatArray, BoolArray]:
    """Return where a rendered picture shows the points (n, 2) [px], noise added, and which are found (n,).

    Which dot is which is told by where the points are.
    """
    image = UnifiedRenderer(World(scene_of(truth, dots))).photograph(joints, random)
    pose = truth.initial_T_camera(joints[None])
    expected = _views(truth, pose)[0][0]
    return _Rendered(truth.camera, random, NOISE_PX).update(image, expected)


def execute(
    truth: Truth,
    plan: Plan,
    branch: JointPath,
    random: np.random.Generator,
    *,
    camera: UnifiedCamera | None = None,
    flange_T_camera: RigidTransform | None = None,
    pictures: tuple[FloatArray, FloatArray] | None = None,
    noise_px: float = NOISE_PX,
    dots: Dots | None = None,
) -> ArmRun:
    """Follow a plan in the closed loop.

    Args:
        truth: what is really there; its points are those that the plan has.
        plan: certified.
        branch: the joints along it.
        random: of the pixels' noise.
        camera: as the controller knows it; None: the true one.
        flange_T_camera: likewise.
        pictures: the points (m, 2) in the initial and in the goal image [px]; None: the goal is where the
            plan ends.
        noise_px: of every point in every frame [px].
        dots: what frames are rendered of; None: points are projected.
    """
    arm, scene = truth.arm, scene_of(truth, dots)
    sensor = scene.sensor
    robot = SimulatedRobot(scene, rendered=dots is not None)
    known = truth.camera if camera is None else camera
    mount = truth.flange_T_camera if flange_T_camera is None else flange_T_camera
    limits = PathLimits(branch, JOINT_SHARE * arm.joint_speed, JOINT_SHARE * arm.joint_acceleration)
    law = RestToRestLaw.for_limits(limits, least_duration=LEAST_DURATION)
    initial, goal = pictures or (None, None)
    options = TrackerOptions(delay=sensor.latency + 0.5 / sensor.rate, tolerance_px=TOLERANCE_PX)
    tracker = PathTracker(
        plan, known, initial_pixels=initial, goal_pixels=goal, options=options, time_law=law
    )
    trace = [np.array(truth.start)]

    def wait(duration: float) -> None:
        robot.advance(duration)
        trace.append(robot.read().joint_positions)

    def posture(time: float) -> tuple[FloatArray, FloatArray]:
        w, speed = law(time)
        return branch(w), branch(w, 1) * speed

    def nothing(step: Step) -> None:
        del step

    supervisor = Supervisor(robot, arm, mount, camera=robot, wait=wait)
    features: FeatureTracker = _Projected(robot, truth, random, noise_px)
    if dots is not None:
        features = _Rendered(known, random, noise_px)
    stop = servo(
        supervisor, tracker, features, VisibilityFilter(known, delay=sensor.latency),
        on_step=nothing, time_limit=law.duration + SETTLING, posture=posture,
    )  # fmt: skip
    reason = "" if stop is None or stop.reason == "time_limit" else stop.reason
    path = branch(np.linspace(0.0, 1.0, PLACES))
    return _seen(truth, np.array(trace), path, reason, plan, goal, robot.contacts())


def _seen(
    truth: Truth,
    joints: FloatArray,
    path: FloatArray,
    stop: str,
    plan: Plan,
    goal: FloatArray | None,
    contacts: frozenset[tuple[str, str]],
) -> ArmRun:
    """Say what the true camera saw on the way."""
    poses = truth.initial_T_camera(joints[::SPARSE])
    pixels, valid = _views(truth, poses)
    distances = np.where(valid, image_distance(truth.camera, pixels), -100.0)
    assert plan.path is not None
    planned, known = _views(truth, plan.path(np.linspace(0.0, 1.0, PLACES)))
    planned = np.where(known[..., None], planned, 1e9)
    strays = [strayed_px(planned, row) for row in pixels if np.isfinite(row).all()]
    aim = planned[-1] if goal is None else goal
    error = float(np.sqrt(np.mean(((pixels[-1] - aim) ** 2).sum(axis=1))))
    return ArmRun(joints, path, stop, float(distances.min()), error, poses.translation, max(strays), contacts)


def strayed_px(planned: FloatArray, seen: FloatArray) -> float:
    """Return the most that a point seen (n, 2) strays from where planned views (k, n, 2) have it [px].

    Of the place along them where that is least; between views every point goes straight.
    """
    steps, gone = np.diff(planned, axis=0), seen - planned[:-1]
    length = np.maximum((steps**2).sum(axis=(1, 2)), 1e-300)
    share = np.clip((gone * steps).sum(axis=(1, 2)) / length, 0.0, 1.0)
    gaps = gone - share[:, None, None] * steps
    return math.sqrt(float((gaps**2).sum(axis=2).max(axis=1).min()))


def _views(truth: Truth, initial_T_camera: RigidTransform) -> tuple[FloatArray, BoolArray]:
    """Return where every pose (m,) sees the true points: (m, points, 2) [px]."""
    turns, centres = initial_T_camera.rotation.as_matrix(), initial_T_camera.translation
    return truth.camera.project(np.einsum("mji,mnj->mni", turns, truth.points[None] - centres[:, None]))


class Gaps:
    """MuJoCo's own distances in a model of its own: what is left of what every pair is asked to keep."""

    def __init__(self, truth: Truth, clearance: float, self_clearance: float) -> None:
        spec = truth.arm.spec()
        holder = spec.body(truth.arm.flange_link).add_body(name="camera")
        for solid in CAMERA_HOUSING:
            solid.moved(truth.arm.link_T_flange * truth.flange_T_camera).add_to(spec, holder).mass = 1e-3
        names = [f"around {i}" for i in range(len(truth.balls))]
        for name, (centre, radius) in zip(names, truth.balls, strict=True):
            ball = Solid.sphere(name, truth.base_T_initial.apply(centre), radius)
            ball.add_to(spec, spec.worldbody.add_body(name=name))
        self._model: Any = spec.compile()
        self._model.geom_margin[:] = max(clearance, self_clearance) + FAR
        self._data = mujoco.MjData(self._model)
        self._around = np.array(
            [str(self._model.body(int(b)).name) in names for b in self._model.geom_bodyid]
        )
        self._asked = clearance, self_clearance

    def left(self, q: FloatArray) -> float:
        """Return the least that any pair keeps beyond what is asked [m]; negative: it misses that."""
        self._data.qpos[:] = q
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_comPos(self._model, self._data)
        mujoco.mj_collision(self._model, self._data)
        contacts = self._data.contact
        if not self._data.ncon:
            return FAR
        asked = np.where(self._around[contacts.geom].any(axis=1), *self._asked)
        return float(min(FAR, (contacts.dist - asked).min()))

    def least(self, joints: FloatArray) -> float:
        """Return the least of postures (m, n)."""
        return min(self.left(q) for q in joints)
