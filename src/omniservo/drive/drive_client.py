"""The drive process as the process sees it that leads the arm: what `servo` needs of a supervisor."""

from __future__ import annotations

import os
import pickle
import socket
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from threading import Condition, Thread

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import RigidTransform

from omniservo.drive.arm_opener import ArmOpener, DriveSetup
from omniservo.drive.deadline import COMMAND_LIFE
from omniservo.drive.drive_loop import INPUT
from omniservo.drive.messages import (
    LARGEST,
    DriveCommand,
    Kind,
    Phase,
    Status,
    opened,
    packed,
    packed_seen,
    stop_named,
)
from omniservo.errors import ConnectionLost, InputError, NotFinite, ServoStop, StaleImage, spelled
from omniservo.geometry.arrays import FloatArray, finite_array, frozen
from omniservo.robots import Arm, CameraImage, CameraSource, RobotState
from omniservo.safety.motion_history import MotionHistory
from omniservo.safety.robot_link import CameraLink
from omniservo.safety.safety_options import SafetyOptions
from omniservo.safety.supervisor import Passed, Wish

_ANSWERED = 1.0
"""The drive process answers a command within this [s], or is taken to be gone."""

_REST = 5.0
"""The longest braking [s]"""

_LOOK = 2e-3
"""[s] between two looks while something is waited for"""


class DriveClient:
    """An arm that another process drives, and a camera that this one looks through: a `SupervisedRobot`.

    The drive process holds the `Supervisor`, the joints' limits and the connection to the arm. It brakes when
    a command's deadline passes without another, when this process ends in whatever way, and for everything
    that a supervisor brakes for; that latches there. It opens the arm and listens; `enable` makes it ready
    for motion. All times are `time.monotonic()`.

    Args:
        opener: how the drive process opens the arm.
        arm: its kinematics and limits.
        flange_T_camera: how the camera sits on it.
        camera: on its flange, read by this process.
        options: see SafetyOptions.
        command_life: see `COMMAND_LIFE` [s].
        patience: the drive is given so long to begin, and to connect [s].

    Raises:
        InputError: the arm cannot be opened like this, or is another one.
        ServoStop: it does not answer.
    """

    def __init__(
        self,
        opener: ArmOpener,
        arm: Arm,
        flange_T_camera: RigidTransform,
        *,
        camera: CameraSource,
        options: SafetyOptions | None = None,
        command_life: float = COMMAND_LIFE,
        patience: float = 60.0,
    ) -> None:
        self.arm = arm
        """as given"""
        self.flange_T_camera = flange_T_camera
        """as given"""
        self.options = options or SafetyOptions()
        """as given"""
        self._camera, self._life, self._patience = CameraLink(camera), command_life, patience
        self._news = Condition()
        self._statuses: deque[Status] = deque(maxlen=4096)
        self._status: Status | None = None
        self._openings = 0
        """so often the drive began to connect"""
        self._gone = False
        self._told: tuple[str, str] | None = None
        """the stop that was raised already"""
        self._number, self._seen_at = 0, -np.inf
        self._history: MotionHistory | None = None
        self._state = RobotState(-np.inf, np.zeros(arm.dof), np.zeros(arm.dof))
        """as taken in"""
        self._line, self._process = _started(DriveSetup(opener, arm, flange_T_camera, self.options))
        self._thread = Thread(target=self._listen, daemon=True)
        self._thread.start()
        try:
            self._until(lambda status: status.phase is not Phase.CONNECTING, patience, "connect")
            if self.status.reason == INPUT:
                raise InputError(self.status.words)
            if (stop := self.stopped) is not None:
                raise stop
            self._until(lambda status: not np.isnan(status.state_time), patience, "read a joint")
        except BaseException:
            self.close()
            raise
        self._take_in()

    @property
    def status(self) -> Status:
        """The newest that the drive process said.

        Raises:
            ConnectionLost: it never said anything.
        """
        with self._news:
            if self._status is None:
                raise ConnectionLost("the drive process said nothing")
            return self._status

    @property
    def process_id(self) -> int:
        """Of the drive process."""
        return self._process.pid

    @property
    def time(self) -> float:
        """This instant on the clock of joints and images [s]."""
        return time.monotonic()

    @property
    def history(self) -> MotionHistory:
        """What was sent and what was measured."""
        self._take_in()
        if self._history is None:
            raise ConnectionLost("the drive process gave no joints")
        return self._history

    @property
    def stopped(self) -> ServoStop | None:
        """What the robot was stopped for, and has not been released from."""
        with self._news:
            status, gone = self._status, self._gone
        if status is not None and status.reason:
            return stop_named(status.reason, status.words)
        return ConnectionLost("the drive process is gone") if gone else None

    def enable(self) -> None:
        """Prove that commands reach the arm, and be ready for motion; images are read meanwhile.

        Raises:
            ServoStop: the arm does not stand by what it is sent, or the robot was stopped before.
        """
        self._refuse_stopped()
        self._send(packed(Kind.ARM))
        end = time.monotonic() + self._patience
        while self.status.phase not in (Phase.ARMED, Phase.MOVING):
            self.image()
            self.wait(_LOOK)
            if time.monotonic() > end:
                raise ConnectionLost(f"the drive is not armed within {self._patience:g} s")

    def read(self) -> RobotState:
        """Return the newest reading of the joints.

        Raises:
            ServoStop: the drive stopped the arm, or its process is gone or says nothing.
        """
        self._take_in()
        self._raise_news()
        oldest = time.monotonic() - _ANSWERED
        self._until(
            lambda status: not np.isnan(status.state_time) and status.time > oldest, _ANSWERED, "read a joint"
        )
        self._take_in()
        return self._state

    def image(self) -> CameraImage | None:
        """Return the newest delivered frame, and inform the drive; None before the first one arrives.

        Raises:
            ServoStop: the camera does not answer, or not with a frame; the arm has been braked.
        """
        try:
            image = self._camera.image()
        except ServoStop as stop:
            self.stop(stop)
            raise
        if image is not None and image.earliest > self._seen_at:
            self._seen_at = image.earliest
            self._send(packed_seen(self._seen_at))
        return image

    def command(self, joint_velocities: npt.ArrayLike) -> Passed:
        """Move with these joint velocities (n,) [rad/s], or as near to them as the limits allow.

        Raises:
            ServoStop: nothing near them can be sent; the robot stands still by then.
            InputError: wrong shape, or the drive is not enabled; the robot stands still by then.
        """
        return self._moved(None, self._checked("joint_velocities", joint_velocities, self.arm.dof))

    def carry(self, twist: npt.ArrayLike, wish: Wish | None = None) -> Passed:
        """Move the camera with this twist (6,) (linear [m/s], angular [rad/s]; camera frame).

        Args:
            twist: of the camera.
            wish: where joints go in what the twist leaves free, and near singularities; None: nowhere.

        Raises:
            ServoStop: no velocities for it can be sent; the robot stands still by then.
            InputError: wrong shape, or the drive is not enabled; the robot stands still by then.
        """
        wanted = self._checked("twist", twist, 6)
        own = None if wish is None else self._checked("wish", wish(self.read()), self.arm.dof)
        return self._moved(wanted, own)

    def wait(self, duration: float) -> float:
        """Let time [s] pass while the drive watches the arm; return how much did [s].

        Raises:
            ServoStop: the drive stopped the arm meanwhile, or its process is gone.
        """
        begin = time.monotonic()
        time.sleep(max(duration, 0.0))
        self._take_in()
        self._raise_news()
        return time.monotonic() - begin

    def stop(self, reason: ServoStop | None = None) -> None:
        """Brake every joint as fast as its acceleration limit allows; the robot stands still on return.

        Raises:
            ConnectionLost: the drive process is gone, and its arm's watchdog on its own.
        """
        text = "" if reason is None else f"{reason.reason}\0{reason}"
        self._told = self._told if reason is None else (reason.reason, str(reason))
        self._send(packed(Kind.STOP, text))
        self._until(
            lambda status: not self._alive(status) and (reason is None or bool(status.reason)), _REST, "brake"
        )
        if (stopped := self.stopped) is not None:
            self._told = stopped.reason, str(stopped)

    def release(self, reason: str) -> None:
        """Let the drive listen again after a stop; `enable` makes it ready for motion.

        Args:
            reason: what it was stopped for: `ServoStop.reason` of `stopped`.

        Raises:
            InputError: it was not stopped, or for another reason.
            ServoStop: the arm does not answer.
        """
        stopped = self.stopped
        if stopped is None or reason != stopped.reason:
            legal = "the robot is not stopped" if stopped is None else f"legal: {stopped.reason!r}"
            raise InputError(f"reason: {spelled(reason)} given; {legal}")
        before = self._openings
        self._send(packed(Kind.RELEASE, reason))

        def answered(status: Status) -> bool:
            refused = status.phase is Phase.STOPPED and self._openings > before
            return status.phase is Phase.LISTENING or refused

        self._until(answered, self._patience, "listen again")
        if (stop := self.stopped) is not None:
            raise self._news_of(stop)
        self._told = None

    def close(self) -> None:
        """Brake, and end the drive process and the camera; a second call does nothing."""
        with suppress(ConnectionLost):
            self._send(packed(Kind.CLOSE))
        try:
            self._process.wait(self._patience)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._thread.join()
        self._line.close()
        self._camera.close()

    def _alive(self, status: Status) -> bool:
        """Return whether the arm is still being moved."""
        return status.phase in (Phase.MOVING, Phase.BRAKING) or bool(status.joints[2].any())

    def _checked(self, name: str, value: npt.ArrayLike, count: int) -> FloatArray:
        try:
            return finite_array(name, value, (count,))
        except InputError as error:
            numbers = np.asarray(value)
            wrong = numbers.shape == (count,) and numbers.dtype.kind == "f"
            stop = NotFinite(f"{error}; it was not sent") if wrong and name != "twist" else None
            self.stop(stop)
            raise stop or error from None

    def _moved(self, twist: FloatArray | None, joints: FloatArray | None) -> Passed:
        self._refuse_stopped()
        if self.status.phase not in (Phase.ARMED, Phase.MOVING):
            raise InputError(
                f"the drive is {self.status.phase.name.lower()}; enable() makes it ready for motion"
            )
        if np.isinf(self._seen_at):
            stop = StaleImage("no image came yet; without one nothing moves")
            self.stop(stop)
            raise stop
        self._number += 1
        now = time.monotonic()
        move = DriveCommand(
            self._number, now + self.options.command_lag, self._seen_at, now + self._life, twist, joints
        )
        self._send(move.packed())
        status = self._until(lambda status: status.number >= move.number, _ANSWERED, "answer a command")
        self._raise_news()
        return Passed(frozen(status.joints[4]), frozen(status.joints[3]), status.limits)

    def _refuse_stopped(self) -> None:
        self._raise_news()
        stopped = self.stopped
        if stopped is not None:
            raise type(stopped)(f"stopped before: {stopped}; release({stopped.reason!r}) lets it move again")

    def _raise_news(self) -> None:
        """Raise what the drive stopped for, once, as soon as the arm stands."""
        stopped = self.stopped
        if stopped is not None and self._told is None:
            with suppress(ConnectionLost):  # of a drive that says no more nothing can be waited for
                self._until(lambda status: status.phase is not Phase.BRAKING, _REST, "brake")
            raise self._news_of(stopped)

    def _news_of(self, stopped: ServoStop) -> ServoStop:
        self._told = stopped.reason, str(stopped)
        return stopped

    def _until(self, holds: Callable[[Status], bool], patience: float, what: str) -> Status:
        """Wait for a status for which something holds, and return it."""

        def fits() -> bool:
            return self._gone or (self._status is not None and holds(self._status))

        with self._news:
            if not self._news.wait_for(fits, patience):
                raise ConnectionLost(f"the drive process does not {what} within {patience:g} s")
            if self._status is None or (self._gone and not holds(self._status)):
                raise ConnectionLost(f"the drive process is gone; it was to {what}")
            return self._status

    def _send(self, message: bytes) -> None:
        try:
            self._line.send(message, socket.MSG_DONTWAIT)
        except BlockingIOError:  # hundreds of messages wait: it would be waited for without end
            raise ConnectionLost("the drive process hangs: it hears nothing") from None
        except OSError as error:
            raise ConnectionLost(f"the drive process is gone: {error}") from None

    def _listen(self) -> None:
        """Take in what the drive process says, until it ends."""
        while True:
            try:
                message = self._line.recv(LARGEST)
            except OSError:
                message = b""
            if not message:
                break
            with suppress(ServoStop):
                kind, body = opened(message)
                if kind is Kind.STATUS:
                    status = Status.of(body)
                    with self._news:
                        begins = self._status is None or self._status.phase is not Phase.CONNECTING
                        self._openings += status.phase is Phase.CONNECTING and begins
                        self._status = status
                        self._statuses.append(status)
                        self._news.notify_all()
        with self._news:
            self._gone = True
            self._news.notify_all()

    def _take_in(self) -> None:
        """Add what was said since to the history."""
        with self._news:
            news = list(self._statuses)
            self._statuses.clear()
        for status in news:
            if not (np.isfinite(status.state_time) and np.isfinite(status.joints[:2]).all()):
                continue  # nothing was read yet, or what the drive stops for
            self._state = state = _state(status)
            if self._history is None:
                least = self.options.least_acceleration * self.arm.joint_acceleration
                self._history = MotionHistory(state, least)
            if state.time > self._history.time:
                self._history.measured(state)
            self._history.sent(status.joints[2], status.time)


def _state(status: Status) -> RobotState:
    return RobotState(status.state_time, status.joints[0].copy(), status.joints[1].copy(), status.mode)


def _started(setup: DriveSetup) -> tuple[socket.socket, subprocess.Popen[bytes]]:
    """Return the line to a new drive process, and the process."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    ours.settimeout(None)
    paths = os.pathsep.join(path or os.getcwd() for path in sys.path)
    with theirs:
        process = subprocess.Popen(  # noqa: S603 - this interpreter, this package
            [sys.executable, "-P", "-m", "omniservo.drive.main", str(theirs.fileno())],
            stdin=subprocess.PIPE,
            pass_fds=[theirs.fileno()],
            env=os.environ | {"PYTHONPATH": paths},
            start_new_session=True,  # an interrupt is for this process, which has the arm braked
        )
    if process.stdin is not None:
        with suppress(BrokenPipeError), process.stdin as told:
            told.write(pickle.dumps(setup))
    return ours, process
