"""The simulated arm and the camera on it: physics at 1 kHz, and images as late as a real camera's."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import RigidTransform

from omniservo.errors import InputError
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import ByteArray, FloatArray, finite_array, finite_number
from omniservo.robots import CameraImage, RobotState
from omniservo.scenes.light import Light
from omniservo.scenes.scene import Ball, Scene, SceneBox
from omniservo.simulation.unified_renderer import JointsAt, UnifiedRenderer
from omniservo.simulation.world import TICK, World

_RAMP = 0.99
"""share of the acceleration limits at which set points change; the rest is for what the drives correct"""


@with_field_docs
@dataclass(frozen=True, eq=False)
class Exposure:
    """All that one frame shows: it can be rendered later, and by another thread than moves the arm."""

    time: float
    """of the exposure, on the robot's clock [s]"""
    joints: FloatArray | JointsAt
    """(n,) [rad] as they were, or, where the frame takes time, as they were around it"""
    world: World
    """as it was"""
    light: Light
    """as it was"""
    noise: tuple[int, int]
    """seed of the sensor's noise"""

    def photographed(self, renderer: UnifiedRenderer) -> ByteArray:
        """Return the grey values (height, width); the renderer is of this world."""
        return renderer.photograph(self.joints, np.random.default_rng(list(self.noise)), self.light)


_STATE = mujoco.mjtState.mjSTATE_INTEGRATION
"""all that moves"""

_ROUNDING = 1e-6  # [ticks]: a duration this much short of a whole tick is that tick


class SimulatedRobot:
    """An `ArmDriver` and `CameraSource` on one clock, on which time passes in `advance` only.

    Velocity commands pass the drives' acceleration limits, become joint set points, and a stiff position
    loop that knows the arm's masses follows them, so that speeds and accelerations of the joints themselves
    keep their limits at every millisecond; only a joint that is driven to the end of its range stands at
    once. Frame k is exposed round the tick nearest to k / rate, as its `Sensor` says along the joints' own
    motion; it carries the time of that tick, and can be read from latency later on. Before time 0 the arm
    stood still. Its noise depends on seed and k alone.
    """

    def __init__(self, scene: Scene, seed: int = 0, *, rendered: bool = True) -> None:
        """Put the arm at rest in the scene's start joints, at time 0.

        Args:
            scene: the world.
            seed: of the sensor's noise.
            rendered: False: frames come in time but empty, (0, 0), for who projects points by himself.
        """
        self.world = World(scene)
        self._scene = scene
        self._seed, self._rendered = seed, rendered
        self._renderer: UnifiedRenderer | None = None
        gains, dampings = self.world.model.actuator_gainprm[:, 0], -self.world.model.actuator_biasprm[:, 2]
        self._lead = dampings / gains  # [s]: set point ahead by this share of the velocity, so that none lags
        self._stiffness = gains
        self._most_change = _RAMP * scene.arm.joint_acceleration * TICK
        self._lowest, self._highest = scene.arm.joint_range.T.copy()
        self.place(scene.start_joints)

    def place(self, joints: npt.ArrayLike) -> None:
        """Start anew at time 0 with the arm at rest in ``joints`` (n,) [rad]; earlier frames and contacts go.

        Raises:
            InputError: wrong shape, not finite, or outside the arm's range.
        """
        q = finite_array("joints", joints, (self._scene.arm.dof,))
        if not self._scene.arm.within_limits(q):
            raise InputError(f"joints {np.rad2deg(q).round(1)} deg leave the arm's range")
        self._data = self.world.data_at(q)
        self._tick = 0
        self._due = 0.0  # ticks that advance() owes, with their fraction
        self._set_point = q.copy()
        self._velocity = np.zeros_like(q)
        self._command = np.zeros_like(q)
        self._contacts = self.world.touching(self._data)
        self._exposed: dict[float, tuple[FloatArray, World]] = {}
        kept = math.ceil((self._scene.sensor.latency + self._scene.sensor.half_span) / TICK) + 2
        self._joints: deque[FloatArray] = deque(maxlen=kept)
        """of the last ticks"""
        self._motion: JointsAt | None = None
        """of the delivered frame"""
        self._waiting: deque[tuple[int, int]] = (
            deque()
        )  # exposure tick and number of frames not yet delivered
        self._delivered: tuple[int, int] | None = None
        self._picture: CameraImage | None = None
        self._expose()

    @property
    def time(self) -> float:
        """The robot's clock [s]."""
        return self._tick * TICK

    def read(self) -> RobotState:
        """Return the joints as they are now, without delay."""
        return RobotState(self.time, self._data.qpos.copy(), self._data.qvel.copy())

    def image(self) -> CameraImage | None:
        """Return the newest delivered frame; None before the first one arrives."""
        if self._delivered is None:
            return None
        if self._picture is None or self._picture.time != self._delivered[0] * TICK:
            exposure, pixels = self._exposure(*self._delivered), np.zeros((0, 0), dtype=np.uint8)
            if self._rendered:
                if self._renderer is None or self._renderer.world is not exposure.world:
                    self._renderer = UnifiedRenderer(exposure.world)
                pixels = exposure.photographed(self._renderer)
            self._picture = CameraImage(exposure.time, pixels)
        return self._picture

    def newest_exposure(self) -> Exposure | None:
        """Return what the newest delivered frame shows; None before the first one arrives."""
        return None if self._delivered is None else self._exposure(*self._delivered)

    def forget(self) -> None:
        """Let go of the exposures before that of the newest delivered frame, kept for truth else."""
        first = 0.0 if self._delivered is None else self._delivered[0] * TICK
        for time in [time for time in self._exposed if time < first]:
            del self._exposed[time]

    def _exposure(self, tick: int, number: int) -> Exposure:
        joints, world = self._exposed[tick * TICK]
        light = self._scene.light_at(tick * TICK)
        return Exposure(tick * TICK, self._motion or joints, world, light, (self._seed, number))

    def command(self, joint_velocities: npt.ArrayLike) -> None:
        """Move with these joint velocities (n,) [rad/s] until commanded otherwise.

        A command beyond a joint's nominal speed is scaled down as a whole, so that its direction is kept.

        Raises:
            InputError: wrong shape, NaN or infinity.
        """
        wanted = finite_array("joint_velocities", joint_velocities, (self._scene.arm.dof,))
        excess = max((np.abs(wanted) / self._scene.arm.joint_speed).tolist())
        self._command = wanted / max(excess, 1.0)

    def stop(self) -> None:
        """Brake to standstill with 99% of the joints' acceleration limits."""
        self._command = np.zeros_like(self._command)

    def close(self) -> None:
        """Let go of what images are made with."""
        self._renderer = None

    def advance(self, duration: float) -> None:
        """Let time pass, in steps of 1 ms; a remainder is kept for the next call.

        Args:
            duration: [s], 0 or more.

        Raises:
            InputError: negative or not finite.
        """
        self._due += finite_number("duration", duration, minimum=0.0) / TICK
        while self._due >= 1.0 - _ROUNDING:
            self._due -= 1.0
            self._step()

    def light_up(self, light: Light) -> None:
        """Let this light alone shine from now on."""
        self._scene = replace(self._scene, lights=(replace(light, since=0.0),))

    def rearrange(self, obstacles: Sequence[SceneBox | Ball]) -> None:
        """Put the scene's obstacles elsewhere, at once; the arm moves on. Earlier exposures show them before.

        Args:
            obstacles: as many as the scene has, in their order.
        """
        state = np.empty(mujoco.mj_stateSize(self.world.model, _STATE))
        mujoco.mj_getState(self.world.model, self._data, state, _STATE)
        self._scene = replace(self._scene, obstacles=tuple(obstacles))
        self.world = World(self._scene)
        self._data = mujoco.MjData(self.world.model)
        mujoco.mj_setState(self.world.model, self._data, state, _STATE)
        mujoco.mj_forward(self.world.model, self._data)
        self._contacts |= self.world.touching(self._data)

    def contacts(self) -> frozenset[tuple[str, str]]:
        """Return truth: the pairs of bodies that have touched since the start (names sorted in each pair)."""
        return frozenset(self._contacts)

    def arm_obstacle_distance(self) -> float:
        """Return truth: smallest distance from arm or camera to any obstacle now [m]; negative inside."""
        mujoco.mj_kinematics(self.world.model, self._data)
        return self.world.arm_obstacle_distance(self._data)

    def world_T_camera(self, time: float | None = None) -> RigidTransform:
        """Return truth: the camera's pose now, or at the exposure of the frame with this time stamp [s].

        Raises:
            InputError: no frame was exposed at that time.
        """
        return self._scene.world_T_camera(self._data.qpos if time is None else self.exposure(time)[0])

    def exposure(self, time: float) -> tuple[FloatArray, World]:
        """Return truth: joints (n,) [rad] and world at the exposure of the frame with this time stamp [s].

        Raises:
            InputError: no frame was exposed at that time.
        """
        if time not in self._exposed:
            raise InputError(f"time: {time} s given; no frame was exposed then")
        return self._exposed[time]

    def _step(self) -> None:
        data, before, change = self._data, self._velocity.copy(), self._most_change
        self._velocity += np.minimum(np.maximum(self._command - before, -change), change)  # clip takes longer
        here, wanted = self._set_point, self._set_point + self._velocity * TICK
        self._set_point = np.minimum(np.maximum(wanted, self._lowest), self._highest)
        self._velocity[self._set_point != wanted] = 0.0  # a joint that reaches its end stands
        torque = np.empty_like(wanted)  # of the acceleration; without it the arm swings past its limits
        mujoco.mj_mulM(self.world.model, data, torque, (self._velocity - before) / TICK)
        torque += data.qfrc_bias - data.qfrc_passive  # what turning links and friction take
        data.ctrl[:] = here + self._lead * self._velocity + torque / self._stiffness
        mujoco.mj_step(self.world.model, data)
        if data.ncon:
            self._contacts |= self.world.touching(data)
        self._tick += 1
        self._expose()

    def _expose(self) -> None:
        """Record the joints if a frame is exposed at this tick; deliver frames whose latency has passed."""
        sensor = self._scene.sensor
        self._joints.append(self._data.qpos.copy())
        number = round(self.time * sensor.rate)
        if round(number / sensor.rate / TICK) == self._tick:
            self._exposed[self.time] = self._data.qpos.copy(), self.world
            self._waiting.append((self._tick, number))
        latency = math.ceil(sensor.latency / TICK - _ROUNDING)
        while self._waiting and self._waiting[0][0] + latency <= self._tick:
            self._delivered = self._waiting.popleft()
            self._motion = self._motion_round(self._delivered[0]) if sensor.half_span > 0.0 else None

    def _motion_round(self, tick: int) -> JointsAt:
        """Return the joints round a tick, from the last ticks' and, between them, from both neighbours'."""
        joints = np.array(self._joints)
        times = (np.arange(len(joints)) + self._tick + 1 - len(joints) - tick) * TICK

        def joints_at(time: float) -> FloatArray:
            return np.array([np.interp(time, times, angle) for angle in joints.T])

        return joints_at
