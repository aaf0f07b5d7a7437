"""An arm of Universal Robots, driven through its Real-Time Data Exchange."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from threading import Lock, Thread

import numpy as np
import numpy.typing as npt

from omniservo.errors import (
    ClockFault,
    ConnectionLost,
    InputError,
    NotFinite,
    NotInControl,
    ServoStop,
    spelled,
    spelled_name,
)
from omniservo.geometry.arrays import FloatArray, finite_array, finite_number
from omniservo.hardware.clock_map import ClockMap
from omniservo.hardware.rtde.arm_modes import ControllerState
from omniservo.hardware.rtde.control_program import (
    BEAT,
    ECHO,
    NUMBER,
    VELOCITIES,
    ProgramSender,
    control_program,
    remote_control,
)
from omniservo.hardware.rtde.packets import PacketError, PacketKind
from omniservo.hardware.rtde.rtde_stream import RtdeStream
from omniservo.robots import ArmMode, RobotState

UR_JOINTS = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
"""the joints in the controller's order; with or without `_joint` behind, and one prefix before all of them"""

RTDE_PORT, SCRIPT_PORT, DASHBOARD_PORT = 30004, 30002, 29999
"""of every controller"""

SILENCE = 2.0
"""A controller that sends nothing for so long is gone [s]."""

GOODBYE = 0.2
"""So long is waited at closing until the program has ended [s]."""

UNANSWERED = 0.1
"""The program whose steps stand still for so long of the controller's time runs no more [s]."""

MODES = ("robot_mode", "safety_mode", "safety_status_bits", "runtime_state")
"""the fields of `ControllerState`, as RTDE calls them"""

OUTPUTS = (
    "timestamp",
    "actual_q",
    "actual_qd",
    *MODES,
    "target_speed_fraction",
    ECHO,
    BEAT,
)
"""what is read of every state"""

_LARGEST = 2**31 - 1


class RtdeArm:
    """An `ArmConnection` to a controller of Universal Robots (software 3.10, 5.4 or later).

    Opening connects, agrees on what is exchanged, waits for the first state and, where the arm may move,
    sends the controller a program of 30 lines (`control_program`) that turns registers into `speedj`. Nothing
    moves before the first `command`. From the first command after standing the controller stops program and
    arm once nothing was commanded for ``watchdog``; `stop` brakes and ends that watch. A program that has
    ended is not sent again: open a new connection.

    Args:
        address: host, or host:port.
        joint_names: the order of all arrays; see `UR_JOINTS`.
        watchdog: in which the next command must come while it moves [s].
        acceleration: of the leading joint, for commands and braking [rad/s²].
        send_program: whether the program is sent; else the pendant must run it, and is waited for nowhere.
        patience: for connection, first state and the program's beginning, each [s].
        script_port: where programs are sent to.
        dashboard_port: that says why a program does not begin.

    Raises:
        InputError: unknown joints, no one there, another protocol, or a program that does not begin.
        ConnectionLost: the connection was lost before the first state.
        NotInControl: another client writes the registers.
    """

    def __init__(
        self,
        address: str,
        joint_names: Sequence[str] = UR_JOINTS,
        *,
        watchdog: float = 0.1,
        acceleration: float = 10.0,
        send_program: bool = True,
        patience: float = 5.0,
        script_port: int = SCRIPT_PORT,
        dashboard_port: int = DASHBOARD_PORT,
    ) -> None:
        self._host, port = host_and_port(address)
        self._names = tuple(joint_names)
        self._order = joint_order(self._names)
        self._watchdog = finite_number("watchdog", watchdog, minimum=0.02, maximum=1.0)
        self._acceleration = finite_number("acceleration", acceleration, above=0.0, maximum=40.0)
        self._patience = finite_number("patience", patience, above=0.0)
        self._ports = script_port, dashboard_port
        self._clock, self._number, self._lock = ClockMap(), 0, Lock()
        self._state: RobotState | None = None
        self._fault: ServoStop | None = None
        self._echo, self._beat, self._beat_stamp = 0, -1, -np.inf
        self._says = ControllerState(*[-1] * len(MODES))
        self._fraction = 1.0
        self._written, self._longest_gap = -np.inf, 0.0
        self._closed, self._sent_program = False, False
        self.notices: list[str] = []
        """what a user should know, a sentence each"""
        self._stream = RtdeStream(self._host, port, self._patience)
        self._thread = Thread(target=self._listen, name="RTDE", daemon=True)
        try:
            self._outputs = self._stream.outputs(OUTPUTS)
            self._inputs = self._stream.inputs((NUMBER, *VELOCITIES))
            self._stream.start()
            self._thread.start()
            self._await(lambda: self._state is not None, "no joint state")
            self._write(0, np.zeros(6))  # whatever an earlier client left there
            if send_program:
                self._send_program()
        except BaseException:
            self.close()
            raise

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The order of the joints in all arrays."""
        return self._names

    @property
    def watchdog(self) -> float:
        """The controller begins to stop the arm so long after the last command [s]."""
        return self._watchdog

    @property
    def clock(self) -> ClockMap:
        """From the controller's time stamps to this machine's clock."""
        return self._clock

    @property
    def commands_acted_on(self) -> int:
        """How many of our commands the controller's program has acted on: the newest one's number."""
        return self._echo

    @property
    def commands_sent(self) -> int:
        """The number of the newest command; 0 after `stop`."""
        return self._number

    def read(self) -> RobotState:
        """Return the newest joint state, whatever its age, without waiting.

        Raises:
            ConnectionLost: the connection is known to be gone.
            NotFinite: the controller sent a joint that is no number.
            ClockFault: the controller's clock was set.
        """
        self._raise_fault()
        if self._state is None:
            raise ConnectionLost(f"{self._stream.where}: no joint state yet")
        return self._state

    def command(self, joint_velocities: npt.ArrayLike) -> None:
        """Move with these joint velocities (6,) [rad/s], in the order of `joint_names`; does not wait.

        Raises:
            InputError: wrong shape, NaN or infinity.
            ConnectionLost: the connection is gone.
        """
        velocities = finite_array("joint_velocities", joint_velocities, (6,))
        self._raise_fault()
        self._write(self._number % _LARGEST + 1, velocities)

    def stop(self) -> None:
        """Brake to standstill with the stated acceleration; silence after it is no fault.

        Raises:
            ConnectionLost: the connection is gone.
            NotFinite, ClockFault: as `read`; it was sent all the same.
        """
        try:
            if not self._closed:
                self._write(0, np.zeros(6))
        finally:
            self._raise_fault()

    def close(self) -> None:
        """Brake, end the program that was sent, and the connection; a second call does nothing."""
        if self._closed:
            return
        self._closed = True
        if self._thread.ident is not None:
            with suppress(ConnectionLost):
                self._write(-1 if self._sent_program else 0, np.zeros(6))
            end = time.monotonic() + GOODBYE
            while self._sent_program and self._says.plays and self._fault is None and time.monotonic() < end:
                time.sleep(1e-3)
            self._stream.hang_up()
            self._thread.join()
        self._stream.close()

    def _write(self, number: int, velocities: FloatArray) -> None:
        ordered = np.empty(6)
        ordered[self._order] = velocities
        with self._lock:
            now, is_watched = time.monotonic(), self._number > 0
            self._longest_gap = max(self._longest_gap, now - self._written) if is_watched else 0.0
            self._number, self._written = number, now
            self._stream.send(PacketKind.DATA, self._inputs.pack((number, *ordered.tolist())))

    def _raise_fault(self) -> None:
        if self._closed:
            raise ConnectionLost(f"{self._stream.where}: closed")
        if self._fault is not None:
            raise type(self._fault)(str(self._fault))

    def _listen(self) -> None:
        """Take in what the controller sends, until the connection ends."""
        try:
            while True:
                for kind, body in self._stream.receive(SILENCE):
                    if kind == PacketKind.DATA:
                        self._take_in(body, time.monotonic())
        except (ConnectionLost, ClockFault, NotFinite) as fault:
            self._fault = fault
        except PacketError as error:
            self._fault = ConnectionLost(f"{self._stream.where}: {error}")
        except Exception as error:  # whatever it was: without this thread nothing is known of the arm
            self._fault = ConnectionLost(f"{self._stream.where}: {error!r}")

    def _take_in(self, body: bytes, arrival: float) -> None:
        values = dict(zip(OUTPUTS, self._outputs.unpack(body), strict=True))
        stamp = values["timestamp"][0]
        joints, velocities = np.array(values["actual_q"]), np.array(values["actual_qd"])
        if not (np.isfinite(joints).all() and np.isfinite(velocities).all()):
            raise NotFinite(f"{self._stream.where}: a joint state that is not finite")
        self._echo, beat = int(values[ECHO][0]), int(values[BEAT][0])
        if beat != self._beat:
            # the first one is the register's old content, which is no step
            self._beat_stamp = stamp if self._beat >= 0 else -np.inf
            self._beat = beat
        says = ControllerState(*(int(values[name][0]) for name in MODES))
        self._says, self._fraction = says, values["target_speed_fraction"][0]
        mode = says.mode(stamp - self._beat_stamp <= UNANSWERED)
        time_here = self._clock.monotonic(stamp, arrival)
        before = self._state
        if mode == ArmMode.READY:
            why = ""
        elif before is None or before.mode == ArmMode.READY:
            why = self._why_it_ended(arrival)
        else:  # what came later is not the reason
            why = before.mode_reason
        self._state = RobotState(time_here, joints[self._order], velocities[self._order], mode, why)

    def _why_it_ended(self, now: float) -> str:
        """Say what the controller reports, and how late our commands were: its watchdog looks at those."""
        with self._lock:
            if self._number <= 0:
                return str(self._says)
            gap = max(self._longest_gap, now - self._written)
        busy = ": this computer was too busy" if gap > self._watchdog else ""
        return f"{self._says}; longest gap between commands {gap:.3f} s, watchdog {self._watchdog:g} s{busy}"

    def _send_program(self) -> None:
        """Let the controller run our program, unless the arm cannot move or another program runs."""
        if not self._says.may_start:
            self.notices.append(f"the program was not sent: {self._says}")
            return
        if self._says.plays:
            self._end_earlier_program()
        if self._fraction < 1.0:
            self.notices.append(
                f"the pendant's speed slider stands at {self._fraction:.0%}: it may scale commands"
            )
        script_port, dashboard_port = self._ports
        program = control_program(self._watchdog, self._acceleration)
        sender = ProgramSender(self._host, script_port, program, self._patience)
        self._sent_program = True
        try:
            self._await(lambda: self.read().mode == ArmMode.READY, "the program that was sent does not run")
        except InputError as error:
            remote = remote_control(self._host, dashboard_port)
            why = (
                "the pendant is in local control: switch it to Remote Control"
                if remote is False
                else self._says
            )
            raise InputError(f"{error}: {why}") from None
        finally:
            sender.close()

    def _end_earlier_program(self) -> None:
        """End a program of ours that a client which is gone has left; refuse to end any other."""
        begin = self.read().time
        self._await(lambda: self.read().time - begin > UNANSWERED, "no further joint state")
        if self.read().mode != ArmMode.READY:
            raise NotInControl(f"{self._stream.where}: another program runs; stop it on the pendant")
        self._write(-1, np.zeros(6))
        self._await(lambda: not self._says.plays, "an earlier program does not end")
        self._write(0, np.zeros(6))

    def _await(self, condition: Callable[[], bool], otherwise: str) -> None:
        """Wait until the condition holds; raise what the listening thread met, or InputError."""
        end = time.monotonic() + self._patience
        while not condition():
            self._raise_fault()
            if time.monotonic() > end:
                raise InputError(f"{self._stream.where}: {otherwise} in {self._patience:g} s")
            time.sleep(1e-3)


def host_and_port(address: str) -> tuple[str, int]:
    """Return host and port of an address, `host` or `host:port`; without one the port is `RTDE_PORT`.

    Raises:
        InputError: it is neither.
    """
    host, colon, number = address.rpartition(":") if address.count(":") == 1 else (address, "", "")
    if colon and not (number.isascii() and number.isdigit() and 0 < int(number) < 2**16):
        raise InputError(f"address {spelled(address)}: a port from 1 to 65535 follows the colon")
    if not host or any(character.isspace() for character in host):
        raise InputError(f"address {spelled(address)}: legal are host and host:port")
    return host, int(number) if colon else RTDE_PORT


def joint_order(names: Sequence[str]) -> list[int]:
    """Return for each name which joint of the controller it is, of 0 to 5.

    Raises:
        InputError: not the six joints of `UR_JOINTS`, each once, with one prefix.
    """
    bare = [name.removesuffix("_joint") for name in names]
    order = [next((k for k, own in enumerate(UR_JOINTS) if name.endswith(own)), -1) for name in bare]
    prefixes = {name.removesuffix(UR_JOINTS[k]) for name, k in zip(bare, order, strict=True) if k >= 0}
    clean = all(prefix == "" or not prefix[-1].isalnum() for prefix in prefixes)
    if sorted(order) != list(range(len(UR_JOINTS))) or len(prefixes) != 1 or not clean:
        unknown = [name for name, k in zip(names, order, strict=True) if k < 0] or names
        given = ", ".join(map(spelled_name, unknown))
        raise InputError(
            f"joint_names {given}: this arm has {', '.join(UR_JOINTS)}; a robot file's joints say what it "
            "calls each"
        )
    return order
