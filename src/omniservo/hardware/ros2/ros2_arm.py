"""An arm under ROS 2: joint states in, commands out, no ROS installed."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from omniservo.errors import ConnectionLost, InputError, InvalidData, NotInControl, ServoStop
from omniservo.geometry.arrays import FloatArray, finite_array, finite_number
from omniservo.hardware.clock_map import ClockMap
from omniservo.hardware.ros2.commands import HOLD, ArmCommands, TrajectoryCommands
from omniservo.hardware.ros2.endpoints import why_apart
from omniservo.hardware.ros2.joint_states import JointStates, refuse_names
from omniservo.hardware.ros2.network import DdsNetwork
from omniservo.hardware.ros2.node import Publisher, RosNode
from omniservo.hardware.ros2.reference_motion import ReferenceMotion
from omniservo.robots import ArmMode, RobotState
from omniservo.ros_messages.messages import JointStateMessage

STANDING = 0.02
"""An arm that moves faster before the first command is moved by somebody else [rad/s]."""

FIRST_ZEROS = 0.25
"""So long zeros are sent before the first motion [s]: a publisher knows its subscriber before it is known."""

AT_REST = 0.5
"""So long after it came to rest [s] a motion begins where the joints are, not where they were commanded."""

TAKEN_BACK = 0.2
"""The commanded position is taken back towards the measured one no faster than it was commanded to move, and
this [rad/s]."""

STALE = 0.04
"""After so long without a state [s] messages that name some joints only are an error [s]."""

_LOOK = 0.01
"""So often [s] it is looked who else commands the arm, which takes 3 µs; till then that program moves it."""
_TICK = 0.005


class Ros2Arm:
    """An `ArmConnection` over the topics of ros2_control or MoveIt Servo.

    Commands count from where the joints were *commanded* to be (a position that lags behind would slow each
    command down), as long as that is no farther from where they are than drives lag: 0.02 rad and the way of
    0.2 s. Beyond that they are taken back by and by, see `TAKEN_BACK`: one wrong reading is no step, unless
    it is half a turn away.

    Args:
        joint_names: the wanted joints, in the order of all arrays; found by name.
        accelerations: (n,) at which joints may brake [rad/s²].
        commands: the topic that commands the arm.
        joint_states: the topic of its state.
        network: where it is.
        patience: how long a first state, and a subscriber of commands, is waited for [s].
        listen_only: no command is ever sent; then ``watchdog`` is None.

    Raises:
        InputError: a name that the arm has not, a topic of another type, incompatible QoS, a controller that
            does not stop by itself, Cyclone DDS is not installed.
        ConnectionLost: no joint state, or no one who hears commands, within ``patience``.
        NotInControl: somebody else publishes commands, or the arm moves already.
    """

    def __init__(
        self,
        joint_names: Sequence[str],
        accelerations: npt.ArrayLike,
        commands: ArmCommands | None = None,
        *,
        joint_states: str = "/joint_states",
        network: DdsNetwork | None = None,
        patience: float = 5.0,
        listen_only: bool = False,
    ) -> None:
        self._names = tuple(joint_names) if not isinstance(joint_names, str) else (joint_names,)
        refuse_names(self._names)
        self._accelerations = finite_array("accelerations", accelerations, (len(self._names),))
        if (self._accelerations <= 0.0).any():
            raise InputError(f"accelerations: {self._accelerations.tolist()} given; legal: all > 0 rad/s²")
        self._patience = finite_number("patience", patience, above=0.0)
        self._commands = commands or TrajectoryCommands()
        self._listen_only = listen_only
        self._watchdog = None if listen_only else self._commands.proven_watchdog(self._names)
        self._states = JointStates(self._names)
        self._state: RobotState | None = None
        self._motion: ReferenceMotion | None = None
        self._rest_sent = False
        self._looked = -np.inf
        self._fault: ServoStop | None = None
        self._not_in_control = ""
        self._lock = threading.RLock()
        self._closing = threading.Event()
        self._node = RosNode(network or DdsNetwork())
        self._thread = threading.Thread(target=self._run, name="ros2-arm", daemon=True)
        try:
            self._heard = self._node.subscribe(joint_states, JointStateMessage)
            self._sent = (
                None if listen_only else self._node.publish(self._commands.topic, self._commands.kind)
            )
            self._thread.start()
            self._open()
        except BaseException:
            self.close()
            raise

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The order of the joints in all arrays."""
        return self._names

    @property
    def watchdog(self) -> float | None:
        """The arm itself begins to brake so long after the last command [s]; None where only listening."""
        return self._watchdog

    @property
    def clock(self) -> ClockMap | None:
        """From the stamps of joint states to this machine's time; None: they have none."""
        return self._states.clock if self._states.stamped else None

    def read(self) -> RobotState:
        """Return the newest state, whatever its age.

        Raises:
            ConnectionLost: no one publishes joint states any more.
            ClockFault: the robot's clock was set.
            InvalidData: the topic's messages do not name all joints any more.
        """
        with self._lock:
            self._refuse_fault()
            state = self._state
            if state is None:
                raise ConnectionLost(f"{self._heard.topic}: no joint state")
            if self._states.passed_over and time.monotonic() - state.time > STALE:
                raise InvalidData(f"{self._heard.topic}: {self._states.passed_over}")
            if not self._not_in_control:
                return state
            lost, why = ArmMode.NOT_IN_CONTROL, self._not_in_control
            return RobotState(state.time, state.joint_positions, state.joint_velocities, lost, why)

    def command(self, joint_velocities: npt.ArrayLike) -> None:
        """Move with these joint velocities (n,) [rad/s]; without another command the arm begins to brake.

        Raises:
            InputError: wrong shape, NaN or infinity, or the arm is only listened to.
            NotInControl: somebody else publishes commands, or no one subscribes to them.
            ConnectionLost: no one publishes joint states any more.
        """
        velocities = finite_array("joint_velocities", joint_velocities, (len(self._names),))
        with self._lock:
            if self._listen_only:
                raise InputError("listen_only: this connection sends no command")
            self._refuse_fault()
            if self._not_in_control:
                raise NotInControl(self._not_in_control)
            self._begin(velocities, HOLD)

    def stop(self) -> None:
        """Brake to standstill as fast as the accelerations allow; nothing where nothing was commanded.

        Nor is anything sent to an arm that somebody else commands by now, once its last motion is over.

        Raises:
            ConnectionLost: no one publishes joint states any more; it is sent all the same.
        """
        with self._lock:
            now, motion = time.monotonic(), None if self._closing.is_set() else self._motion
            if motion is not None and (now < motion.end or not self._not_in_control):
                self._begin(motion.at(now)[1], 0.0)
            self._refuse_fault()

    def fall_silent(self) -> None:
        """Send nothing more until `command` or `stop`, as if this program were killed."""
        with self._lock:
            if self._motion is not None and not self._commands.ends_by_itself:
                self._motion = replace(self._motion, hold=np.inf)  # for all that this program does about it

    def close(self) -> None:
        """Brake what moves, wait until it was sent, leave the domain; a second call does nothing."""
        if self._closing.is_set():
            return
        with self._lock:
            motion = self._motion
        if motion is not None:
            with contextlib.suppress(ServoStop):
                self.stop()
            if not self._commands.ends_by_itself:
                self._wait_for(lambda: self._rest_sent, motion.braking + 1.0)
        self._closing.set()
        if self._thread.ident is not None:
            self._thread.join()
        self._node.close()

    def _refuse_fault(self) -> None:
        if self._closing.is_set():
            raise ConnectionLost("the connection was closed")
        if self._fault is not None:
            raise type(self._fault)(str(self._fault))

    def _begin(self, velocities: FloatArray, hold: float) -> None:
        """Go on from where the joints were commanded to be, with other velocities."""
        now, state = time.monotonic(), self._state
        if state is None:
            raise ConnectionLost(f"{self._heard.topic}: no joint state")
        measured = state.joint_positions + state.joint_velocities * min(max(now - state.time, 0.0), 0.1)
        reference = measured
        if self._motion is not None and now < self._motion.end + AT_REST:
            speeds, commanded = np.abs(self._motion.velocities), self._motion.at(now)[0]
            lag, back = 0.02 + 0.2 * speeds, (speeds + TAKEN_BACK) * (now - self._motion.begin)
            reference = np.clip(commanded, measured - lag, measured + lag)
            # No step of the controller's positions, whatever one reading says; but a joint that its driver
            # gives half a turn away was wrapped there, and a controller would turn it all the way back.
            near = np.abs(measured - commanded) < np.pi
            reference = np.where(near, np.clip(reference, commanded - back, commanded + back), reference)
        self._motion = ReferenceMotion(now, reference, velocities, hold, self._accelerations)
        self._rest_sent = False
        self._send(now)

    def _send(self, now: float) -> None:
        motion, state = self._motion, self._state
        if self._sent is None or motion is None or state is None:
            return
        stamp = now - self._states.clock.offset if self._states.stamped else 0.0
        message = self._commands.message(motion, now, stamp, state.joint_positions, self._names)
        self._sent.write(message)

    def _run(self) -> None:
        """Take joint states, send braking step by step where that is needed, and look who else is there.

        What fails in one of these stops neither the others nor the thread: braking goes on after a fault.
        """
        while not self._closing.is_set():
            self._heard.wait(_TICK)
            for work in (self._take, self._brake_on, self._look):
                try:
                    work()
                except Exception as error:
                    wrong = f"{self._heard.topic}: {error}"
                    with self._lock:
                        self._fault = self._fault or (
                            error if isinstance(error, ServoStop) else InvalidData(wrong)
                        )

    def _take(self) -> None:
        messages, arrival = self._heard.take(), time.monotonic()
        with self._lock:
            for message in messages:
                self._state = self._states.take(message, arrival) or self._state

    def _brake_on(self) -> None:
        """Send the braking of the moment, until rest was sent, however late that is."""
        with self._lock:
            now, motion = time.monotonic(), self._motion
            if self._commands.ends_by_itself or motion is None or self._rest_sent:
                return
            if now >= motion.begin + motion.hold:
                self._send(now)
                self._rest_sent = now >= motion.end

    def _look(self) -> None:
        """Find out now and then whether the arm's publisher is still there, and who else commands it."""
        now = time.monotonic()
        if now < self._looked + _LOOK:
            return
        self._looked = now
        reason = self._why_not_in_control()
        gone = self._state is not None and self._heard.matched == 0
        with self._lock:
            self._not_in_control = reason
            if gone and self._fault is None:
                self._fault = ConnectionLost(f"{self._heard.topic}: its publisher is gone")

    def _why_not_in_control(self) -> str:
        sent = self._sent
        if sent is None:
            return ""
        topic = sent.topic
        with self._lock:
            others = [each for each in self._node.endpoints.publishers(topic) if each.key != sent.key]
        if others:
            return f"{topic}: {len(others)} other publisher(s) of commands; end that program first"
        return "" if sent.matched else f"{topic}: nobody subscribes to it: is the controller active?"

    def _open(self) -> None:
        """Wait for a first state, then for proof that commands arrive."""
        begin, named = time.monotonic(), None
        while self._state is None:
            self._refuse_fault()
            self._closing.wait(_TICK)
            now = time.monotonic()
            named = named or (now if self._states.heard else None)
            if now - begin > self._patience or (named and now - named > min(1.0, self._patience)):
                raise self._no_state()
        sent = self._sent
        if sent is None:
            return
        if not self._wait_for(lambda: sent.matched > 0, self._patience):
            raise self._no_subscriber()
        with self._lock:
            self._not_in_control = self._why_not_in_control()
        self._prove(sent)

    def _prove(self, sent: Publisher[Any]) -> None:
        """Send zeros, which the subscriber must acknowledge."""
        speed = float(np.abs(self.read().joint_velocities).max())
        if speed > STANDING:
            raise NotInControl(f"{self._heard.topic}: the arm moves by {speed:.3f} rad/s before any command")
        begin = time.monotonic()
        while time.monotonic() < begin + FIRST_ZEROS:
            self.command(np.zeros(len(self._names)))
            self._closing.wait(0.01)
        if not sent.acknowledged(self._patience):
            raise ConnectionLost(f"{sent.topic}: commands are not acknowledged by their subscriber")

    def _no_state(self) -> InputError | ConnectionLost:
        where = f"{self._heard.topic} in {self._node.network}"
        if self._states.heard:
            wrong = f"{self._states.passed_over}; " if self._states.passed_over else ""
            return InputError(f"{where}: {wrong}{self._states.missing()}")
        if self._heard.refused:
            return InputError(f"{where}: messages that cannot be read: {self._heard.refusal}")
        return self._apart("publishes", self._heard.topic, JointStateMessage.ros_type)

    def _no_subscriber(self) -> InputError | ConnectionLost:
        return self._apart("subscribes to", self._commands.topic, self._commands.kind.ros_type)

    def _apart(self, role: str, topic: str, ros_type: str) -> InputError | ConnectionLost:
        with self._lock:
            graph = self._node.endpoints
            pubs, subs = graph.publishers(), graph.subscribers()
        theirs, ours = (pubs, subs) if role == "publishes" else (subs, pubs)
        mine = self._heard.key if role == "publishes" or self._sent is None else self._sent.key
        own = next((each for each in ours if each.key == mine), None)
        found = [each for each in theirs if each.topic == topic]
        why = why_apart(topic, ros_type, own, found, theirs, role)
        what = "joint state" if role == "publishes" else "subscriber of commands"
        words = f"no {what} in {self._patience:g} s in {self._node.network}: {why or f'{topic} is silent'}"
        return InputError(words) if found and why else ConnectionLost(words)

    def _wait_for(self, condition: Callable[[], bool], patience: float) -> bool:
        end = time.monotonic() + patience
        while not condition():
            if time.monotonic() > end:
                return False
            self._closing.wait(_TICK)
        return True
