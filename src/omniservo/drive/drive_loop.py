"""The loop of the drive process: messages in, 200 looks a second at the arm, commands until they expire."""

from __future__ import annotations

import math
import select
import socket
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial

import numpy as np
import numpy.typing as npt

from omniservo.drive.arm_opener import DriveSetup
from omniservo.drive.deadline import DeadlinePassed
from omniservo.drive.messages import (
    LARGEST,
    DriveCommand,
    Kind,
    Phase,
    Status,
    opened,
    seen_time,
    stop_named,
)
from omniservo.errors import ConnectionLost, InputError, InvalidData, RobotLost, ServoStop
from omniservo.geometry.arrays import FloatArray
from omniservo.robots import ArmDriver, ArmMode, CameraImage, RobotState
from omniservo.safety.robot_link import checked_state
from omniservo.safety.supervisor import TICK, Passed, Supervisor, as_stop

LATE = 5e-3
"""A tick that is later than this is counted [s]."""

LOOKS_AHEAD = 2
"""The arm is braked so many looks before a deadline: one may be late, and a command takes a moment."""

PROVEN = 0.25
"""So long zeros are sent to an arm that must stand by them before it is armed [s]."""

INPUT = "input_error"
"""reason of a drive that cannot begin: what it was given is wrong"""


class _Reported:
    """The camera as the other process tells of it: that there was an image, and when."""

    def __init__(self) -> None:
        self.time: float | None = None

    def image(self) -> CameraImage | None:
        return None if self.time is None else CameraImage(self.time, np.zeros((0, 0), dtype=np.uint8))

    def close(self) -> None:
        """Nothing is open."""


class _Watched:
    """The arm's driver, with the last state that is one."""

    def __init__(self, driver: ArmDriver, dof: int) -> None:
        self._driver, self._dof = driver, dof
        self.state: RobotState | None = None

    def read(self) -> RobotState:
        self.state = checked_state(self._driver.read(), self._dof)
        return self.state

    def command(self, joint_velocities: npt.ArrayLike) -> None:
        self._driver.command(joint_velocities)

    def stop(self) -> None:
        self._driver.stop()

    def close(self) -> None:
        self._driver.close()


class DriveLoop:
    """Drives one arm for the process at the other end of a socket.

    Args:
        line: a socket of packets, whose end is the end: the arm is braked then.
        setup: what is driven, and within which limits.
    """

    def __init__(self, line: socket.socket, setup: DriveSetup) -> None:
        self._line, self._setup = line, setup
        line.setblocking(False)
        self._camera = _Reported()
        self._driver: _Watched | None = None
        self._supervisor: Supervisor | None = None
        self._found: FloatArray | None = None
        """(n,) joints in which the arm was found first [rad]: a new connection moves no workspace"""
        self._failed: ServoStop | None = None
        """why there is no supervisor"""
        self._armed, self._arming_since, self._braking = False, math.nan, False
        self._valid_until = math.inf
        self._number, self._late_ticks, self._lateness = 0, 0, 0.0
        zeros = np.zeros(setup.arm.dof)
        self._passed = Passed(zeros, zeros, ())
        self._ended = False

    def run(self) -> None:
        """Drive until the other process says so, or is gone; the arm stands, and is closed, on return."""
        try:
            self._connect()
            due = time.monotonic()
            while not self._ended:
                due = max(due + TICK, time.monotonic())
                self._hear(due)
                self._lateness = time.monotonic() - due
                self._late_ticks += self._lateness > LATE
                self._guarded(self._tick)
                self._say()
        finally:
            self._failed = self._stopped or ConnectionLost("the drive process ends")
            self._disconnect()

    @property
    def _stopped(self) -> ServoStop | None:
        return self._failed if self._supervisor is None else self._supervisor.stopped

    @property
    def _phase(self) -> Phase:
        if self._braking:
            return Phase.BRAKING
        if self._stopped is not None:
            return Phase.STOPPED
        if self._supervisor is None:
            return Phase.CONNECTING
        if not self._armed:
            return Phase.LISTENING
        return Phase.MOVING if self._supervisor.moving else Phase.ARMED

    def _connect(self) -> None:
        """Open the arm, and listen to it."""
        setup, self._failed = self._setup, None
        self._say()
        try:
            self._driver = _Watched(setup.opener.open(setup.arm), setup.arm.dof)
            self._supervisor = Supervisor(
                self._driver,
                setup.arm,
                setup.flange_T_camera,
                camera=self._camera,
                wait=self._pause,
                clock=time.monotonic,
                options=setup.options,
                found=self._found,
            )
            self._found = self._supervisor.found
            with suppress(ServoStop):  # loads compiled code; an arm that is singular is told of later
                joints = self._supervisor.read().joint_positions
                setup.arm.joint_velocities(joints, np.zeros(6), setup.flange_T_camera)
        except InputError as error:
            self._failed = ServoStop(str(error))
            self._failed.reason = INPUT
        except Exception as error:
            self._failed = as_stop(error)
        self._say()

    def _disconnect(self) -> None:
        """Brake, and end the connection to the arm."""
        supervisor, self._supervisor = self._supervisor, None
        self._armed, self._arming_since = False, math.nan
        try:
            with suppress(ServoStop):
                if supervisor is not None:
                    supervisor.stop()
        finally:
            if self._driver is not None:
                with suppress(Exception):  # it may be what failed
                    self._driver.close()
                self._driver = None

    def _pause(self, duration: float) -> None:
        """Let time pass while the arm is braked."""
        self._braking = True
        try:
            self._say()
            time.sleep(duration)
        finally:
            self._braking = False

    def _hear(self, until: float) -> None:
        """Deal with what is said until the next tick [s]."""
        while not self._ended:
            left = until - time.monotonic()
            if not select.select([self._line], [], [], max(left, 0.0))[0]:
                return
            try:
                message = self._line.recv(LARGEST)
            except ConnectionError:
                message = b""
            if not message:
                self._end(ConnectionLost("the process that leads the arm is gone"))
                return
            self._guarded(partial(self._deal_with, message))
            self._say()
            if left <= 0.0:
                return

    def _guarded(self, work: Callable[[], None]) -> None:
        """Do some work; whatever goes wrong in it stops the arm, and the drive lives on to say so."""
        try:
            work()
        except Exception as error:
            stop = as_stop(error)
            if self._supervisor is None:
                self._failed = self._failed or stop
            else:
                with suppress(ServoStop):
                    self._supervisor.stop(stop)

    def _deal_with(self, message: bytes) -> None:
        kind, body = opened(message)
        if kind is Kind.SEEN:
            self._see(seen_time(body))
        elif kind is Kind.MOVE:
            self._move(DriveCommand.of(body, self._setup.arm.dof))
        elif kind is Kind.ARM:
            if self._phase is Phase.LISTENING:
                self._arming_since = time.monotonic()
        elif kind is Kind.STOP:
            self._stop_for(body.decode(errors="replace"))
        elif kind is Kind.RELEASE:
            self._release(body.decode(errors="replace"))
        elif kind is Kind.CLOSE:
            self._end(None)
        else:
            raise InvalidData(f"a {kind.name} for the drive")

    def _see(self, exposed: float) -> None:
        if self._camera.time is None or exposed > self._camera.time:
            self._camera.time = exposed
        if self._supervisor is not None:
            self._supervisor.image()

    def _move(self, move: DriveCommand) -> None:
        """Follow a command; one that comes when none may is answered by what the status says."""
        supervisor, self._number = self._supervisor, move.number
        if supervisor is None or self._stopped is not None or not self._armed:
            return
        self._see(move.seen_at)
        late = time.monotonic() - move.valid_until
        if late > 0.0:
            raise DeadlinePassed(f"the command came {late:.3f} s after its deadline")
        self._valid_until = move.valid_until
        if move.twist is None:
            self._passed = supervisor.command(move.joints if move.joints is not None else ())
        else:
            wished = move.joints
            wish = None if wished is None else lambda _: wished
            self._passed = supervisor.carry(move.twist, wish)

    def _stop_for(self, text: str) -> None:
        reason, _, words = text.partition("\0")
        stop = stop_named(reason, words) if reason else None
        if self._supervisor is not None:
            self._supervisor.stop(stop)

    def _release(self, reason: str) -> None:
        """Go back to listening; nothing moves before the drive is armed again."""
        stopped = self._stopped
        if stopped is None or stopped.reason != reason:
            return
        self._armed, self._arming_since = False, math.nan
        if self._supervisor is not None and not isinstance(stopped, RobotLost):
            with suppress(ServoStop):  # a driver that is at fault for good must be opened anew
                self._supervisor.release(reason)
                return
        self._disconnect()
        self._connect()

    def _tick(self) -> None:
        """Look at the arm, and lead it on."""
        supervisor = self._supervisor
        if supervisor is None:
            return
        if self._stopped is not None:
            with suppress(Exception):  # what is to be told is why it was stopped
                if self._driver is not None:
                    self._driver.read()
        elif self._armed and supervisor.moving:
            if time.monotonic() + LOOKS_AHEAD * TICK > self._valid_until:
                raise DeadlinePassed("no command came before the deadline of the last one")
            supervisor.watch()
        elif self._armed or not math.isnan(self._arming_since):
            supervisor.hold()  # stops for an arm that does not stand by what it is sent
            if time.monotonic() - self._arming_since >= PROVEN:
                self._armed, self._arming_since = True, math.nan
        else:
            supervisor.read()

    def _end(self, reason: ServoStop | None) -> None:
        self._ended = True
        if self._supervisor is not None:
            with suppress(ServoStop):
                self._supervisor.stop(reason)

    def _say(self) -> None:
        """Tell the other process what is being done; one that does not listen misses it."""
        state, stopped, dof = None, self._stopped, self._setup.arm.dof
        if self._driver is not None:
            state = self._driver.state
        joints = np.zeros((5, dof))
        if self._supervisor is not None and state is not None:
            joints[:2] = state.joint_positions, state.joint_velocities
            joints[2] = self._supervisor.sent
        joints[3:] = self._passed.target, self._passed.wanted
        status = Status(
            self._phase,
            ArmMode.READY if state is None else state.mode,
            self._number,
            self._passed.limits,
            self._late_ticks,
            time.monotonic(),
            math.nan if state is None else state.time,
            self._lateness,
            joints,
            "" if stopped is None else stopped.reason,
            "" if stopped is None else str(stopped)[:1000],
        )
        with suppress(BlockingIOError, ConnectionError):
            self._line.send(status.packed())
