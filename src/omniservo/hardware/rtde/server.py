"""A stand-in for a controller of Universal Robots, in front of any arm: for rehearsals and tests."""

from __future__ import annotations

import socket
import struct
import time
from collections.abc import Mapping
from contextlib import suppress
from threading import Event, Lock, Thread
from typing import NamedTuple

from omniservo.errors import InputError, OmniservoError
from omniservo.hardware.link_faults import FaultyLine, LinkFaults
from omniservo.hardware.listener import Listener
from omniservo.hardware.rtde.arm_modes import UrRobotMode, UrRuntimeState, UrSafetyMode
from omniservo.hardware.rtde.packets import (
    FORMATS,
    IN_USE,
    NOT_FOUND,
    PROTOCOL_VERSION,
    PacketBuffer,
    PacketError,
    PacketKind,
    Recipe,
    packet,
)
from omniservo.hardware.rtde.rtde_stream import RATE
from omniservo.hardware.rtde.stand_in_programs import Registers, StandInProgram, program_of
from omniservo.hardware.rtde.variables import input_type, output_type
from omniservo.robots import ArmDriver, ArmMode, RobotState

SOFTWARE = (5, 12, 0, 1101319)
"""what the stand-in says that it runs"""

MOST_PROGRAM = 2**20
"""longest program that is taken in [bytes]"""

_MODES = {
    ArmMode.READY: (UrRobotMode.RUNNING, UrSafetyMode.NORMAL, 0b1),
    ArmMode.PROTECTIVE_STOP: (UrRobotMode.RUNNING, UrSafetyMode.PROTECTIVE_STOP, 0b100),
    ArmMode.EMERGENCY_STOP: (UrRobotMode.POWER_OFF, UrSafetyMode.ROBOT_EMERGENCY_STOP, 0b1100_0000),
    ArmMode.NOT_IN_CONTROL: (UrRobotMode.IDLE, UrSafetyMode.NORMAL, 0b1),
}


class UrPorts(NamedTuple):
    """Where a controller listens; 0 takes a free port."""

    rtde: int = 30004
    """of Real-Time Data Exchange"""
    scripts: tuple[int, ...] = (30001, 30002, 30003)
    """where programs come in"""
    dashboard: int = 29999
    """of the dashboard server"""


FREE_PORTS = UrPorts(0, (0,), 0)
"""ports that are free, for tests"""


class UrStandIn:
    """Presents an arm of six joints, in the controller's order, as a controller of Universal Robots would.

    It speaks RTDE, takes in programs and answers a few questions of the dashboard. It knows two programs by
    their text, ours and that of the client library `ur_rtde` (joint speeds only), and no URScript. Joints
    accelerate as the arm behind it does, not as a program says. Delays, losses and the clock of ``faults``
    are those of states and inputs; agreeing on them is never disturbed.

    Args:
        arm: what moves; its time stamps are `time.monotonic()`.
        host: own address that is listened at.
        ports: see UrPorts.
        faults: see LinkFaults.

    Raises:
        InputError: a port cannot be had.
    """

    def __init__(
        self,
        arm: ArmDriver,
        host: str = "127.0.0.1",
        ports: UrPorts = FREE_PORTS,
        faults: LinkFaults | None = None,
    ) -> None:
        self._arm, self._faults = arm, faults or LinkFaults()
        self._begin = time.monotonic()
        self._clock = FaultyLine[None](self._faults, self._begin)
        self._registers = Registers()
        self._program: StandInProgram | None = None
        self._program_begin = 0.0
        self._clients: list[_Client] = []
        self._lock, self._closing = Lock(), Event()
        self.remote_control = True
        """whether the pendant lets programs of other computers in; may be set"""
        self.speed_fraction = 1.0
        """where the pendant's speed slider is said to stand; may be set, and scales nothing"""
        self.refused: list[str] = []
        """programs and commands that are not known"""
        self._listeners: list[Listener] = []
        try:
            for port, handle in (
                (ports.rtde, self._serve_rtde),
                (ports.dashboard, self._serve_dashboard),
                *((port, self._take_programs) for port in ports.scripts),
            ):
                self._listeners.append(Listener(host, port, handle))
        except InputError:
            self._close_listeners()
            raise
        rtde, dashboard, *scripts = (each.port for each in self._listeners)
        self.address = f"{host}:{rtde}"
        """of RTDE"""
        self.ports = UrPorts(rtde, tuple(scripts), dashboard)
        """that are listened at"""
        self._thread = Thread(target=self._run, name="UR stand-in", daemon=True)
        self._thread.start()

    def __enter__(self) -> UrStandIn:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def program_runs(self) -> bool:
        """Whether a program runs."""
        return self._program is not None

    def close(self) -> None:
        """Stop the arm, end all connections, and listen no more."""
        self._closing.set()
        self._thread.join()
        self._close_listeners()

    def _close_listeners(self) -> None:
        for listener in self._listeners:
            listener.close()

    def _run(self) -> None:
        """Do a control period after the other."""
        period, due = 1.0 / RATE, time.monotonic()
        try:
            while not self._closing.is_set():
                now = time.monotonic()
                with self._lock:
                    self._step(now)
                    for client in self._clients:
                        client.pass_on(now)
                due = max(due + period, time.monotonic() - 5.0 * period)
                time.sleep(max(due - time.monotonic(), 0.0))
        except OmniservoError:  # the arm is gone, and the controller with it
            for client in self._clients:
                client.hang_up()
        finally:
            self._program = None
            with suppress(OmniservoError):
                self._arm.stop()

    def _step(self, now: float) -> None:
        for client in self._clients:
            client.take_in(now, self._registers)
        self._clients = [each for each in self._clients if not each.has_left]
        state = self._arm.read()
        if self._program is not None:
            self._step_program(self._program, state.mode, now)
        values = self._values(state)
        for client in self._clients:
            client.send(now, values)

    def _step_program(self, program: StandInProgram, mode: ArmMode, now: float) -> None:
        speeds = program.step(self._registers) if mode == ArmMode.READY else None
        if program.watched is not None:
            name, limit = program.watched
            last = max(self._registers.written.get(name, 0.0), self._program_begin)
            if now - last > limit:
                speeds = None
        if speeds is None:
            self._program = None
            self._arm.stop()
        else:
            self._arm.command(speeds)

    def _values(self, state: RobotState) -> dict[str, tuple[float, ...]]:
        """Return the numbers of all outputs that are not 0."""
        robot, safety, bits = _MODES[state.mode]
        runs = self._program is not None
        joints = tuple(state.joint_positions.tolist())
        velocities = tuple(state.joint_velocities.tolist())
        return {name: (value,) for name, value in self._registers.values.items()} | {
            "timestamp": (self._clock.stamp(state.time),),
            "actual_q": joints,
            "target_q": joints,
            "actual_qd": velocities,
            "target_qd": velocities,
            "robot_mode": (robot,),
            "safety_mode": (safety,),
            "safety_status": (safety,),
            "safety_status_bits": (bits,),
            "robot_status_bits": (int(robot != UrRobotMode.POWER_OFF) | runs << 1,),
            "runtime_state": (UrRuntimeState.PLAYING if runs else UrRuntimeState.STOPPED,),
            "speed_scaling": (1.0,),
            "target_speed_fraction": (self.speed_fraction,),
        }

    def _serve_rtde(self, line: socket.socket) -> None:
        client = _Client(line, self._faults, self._begin)
        buffer = PacketBuffer()
        with self._lock:
            self._clients.append(client)
        try:
            while part := line.recv(0x10000):
                for kind, body in buffer.feed(part):
                    with self._lock:
                        client.answer(kind, body, self._clients)
        except PacketError:
            pass  # who speaks something else is not spoken with
        finally:
            client.line_is_closed = True

    def _take_programs(self, line: socket.socket) -> None:
        text = b""
        while part := line.recv(0x10000):
            text = (text + part)[-MOST_PROGRAM:]
            if not text.rstrip().endswith(b"end"):
                continue
            with self._lock:
                if self.remote_control:
                    found = program_of(text.decode("utf-8", "replace"), self._registers, self.refused)
                    self._program, self._program_begin = found, time.monotonic()
            text = b""

    def _serve_dashboard(self, line: socket.socket) -> None:
        line.sendall(b"Connected: Universal Robots Dashboard Server\n")
        with line.makefile("rb") as questions:
            while question := questions.readline(256).decode("ascii", "replace").strip():
                if question == "stop":
                    with self._lock:
                        self._program = None
                        self._arm.stop()
                answers = {
                    "PolyscopeVersion": "URSoftware {}.{}.{}.{} (Jan 01 2022)".format(*SOFTWARE),
                    "is in remote control": str(self.remote_control).lower(),
                    "running": f"Program running: {str(self.program_runs).lower()}",
                    "robotmode": f"Robotmode: {_MODES[self._arm.read().mode][0].name}",
                    "safetystatus": f"Safetystatus: {_MODES[self._arm.read().mode][1].name}",
                    "get robot model": "UR5",
                    "get serial number": "20195500001",
                    "stop": "Stopped",
                }
                line.sendall(answers.get(question, f"could not understand: '{question}'").encode() + b"\n")


class _Client:
    """One connection by RTDE: its recipes, and what travels to and from it."""

    def __init__(self, line: socket.socket, faults: LinkFaults, begin: float) -> None:
        self._line = line
        self._inputs: dict[int, tuple[list[str], Recipe]] = {}
        self._outputs: tuple[list[str], Recipe] = [], Recipe(1, [])
        self._period, self._due, self._started = 1.0 / RATE, 0.0, False
        self.line_is_closed = False
        """whether nothing more can come; what came is taken in yet"""
        self._out, self._in = (FaultyLine[bytes](faults, begin) for _ in range(2))

    @property
    def has_left(self) -> bool:
        """Whether the connection ended, and all that came by it was taken in."""
        return self.line_is_closed and self._in.next_due() is None

    @property
    def written(self) -> set[str]:
        """Names of the inputs that this client writes."""
        return {name for names, _ in self._inputs.values() for name in names}

    def answer(self, kind: PacketKind, body: bytes, clients: list[_Client]) -> None:
        """Take in a packet, and answer it where that is the protocol."""
        if kind == PacketKind.DATA:
            self._in.put(body, time.monotonic())
        elif kind == PacketKind.VERSION:
            self._reply(kind, struct.pack(">?", body == struct.pack(">H", PROTOCOL_VERSION)))
        elif kind == PacketKind.CONTROLLER:
            self._reply(kind, struct.pack(">4I", *SOFTWARE))
        elif kind == PacketKind.OUTPUTS:
            self._reply(kind, self._agree_on_outputs(body))
        elif kind == PacketKind.INPUTS:
            others = [each for each in clients if each is not self and not each.line_is_closed]
            taken = {name for each in others for name in each.written}
            self._reply(kind, self._agree_on_inputs(body, taken))
        elif kind in (PacketKind.START, PacketKind.PAUSE):
            self._started = kind == PacketKind.START
            self._reply(kind, b"\1")

    def take_in(self, now: float, registers: Registers) -> None:
        """Write into the registers what has arrived by ``now`` [s]."""
        for body in self._in.due(now):
            names, recipe = self._inputs.get(body[0] if body else 0, ([], None))
            if recipe is None:
                continue
            try:
                values = recipe.unpack(body)
            except PacketError as error:
                self._say(str(error))
                continue
            for name, numbers in zip(names, values, strict=True):
                registers.write(name, numbers[0])

    def send(self, now: float, values: Mapping[str, tuple[float, ...]]) -> None:
        """Send a state, if one is due by ``now`` [s]; what ``values`` lacks is 0."""
        if self._started and now >= self._due:
            self._due = max(self._due + self._period, now - self._period)
            names, recipe = self._outputs
            numbers = [number for name in names for number in values.get(name, _zeros(name))]
            self._out.put(packet(PacketKind.DATA, recipe.pack(numbers)), now)

    def pass_on(self, now: float) -> None:
        """Let what has travelled long enough by ``now`` [s] reach the client."""
        for data in self._out.due(now):
            self._write(data)

    def hang_up(self) -> None:
        """End the connection."""
        self._started = False
        with suppress(OSError):
            self._line.shutdown(socket.SHUT_RDWR)

    def _agree_on_outputs(self, body: bytes) -> bytes:
        rate = struct.unpack(">d", body[:8])[0] if len(body) >= 8 else 0.0
        names = _names(body[8:])
        types = [output_type(name) for name in names]
        known = NOT_FOUND not in types and bool(names) and 0.0 < rate <= RATE
        if known:
            self._period, self._outputs = 1.0 / rate, (names, Recipe(1, types))
        return bytes([known]) + ",".join(types).encode()

    def _agree_on_inputs(self, body: bytes, taken: set[str]) -> bytes:
        names = _names(body)
        types = [IN_USE if name in taken else input_type(name) for name in names]
        number = 0
        if not {IN_USE, NOT_FOUND} & set(types) and names and len(self._inputs) < 255:
            number = len(self._inputs) + 1
            self._inputs[number] = names, Recipe(number, types)
        return bytes([number]) + ",".join(types).encode()

    def _reply(self, kind: PacketKind, body: bytes) -> None:
        self._write(packet(kind, body))

    def _say(self, words: str) -> None:
        """Send a warning in words."""
        text, source = words.encode()[:255], b"stand-in"
        self._reply(PacketKind.TEXT, bytes([len(text)]) + text + bytes([len(source)]) + source + b"\2")

    def _write(self, data: bytes) -> None:
        """Write a whole packet, or end the connection of a client that does not read."""
        try:
            if self._line.send(data, socket.MSG_DONTWAIT) != len(data):
                self.hang_up()
        except OSError:
            self.hang_up()


def _names(body: bytes) -> list[str]:
    return [name for name in body.decode("ascii", "replace").split(",") if name]


def _zeros(name: str) -> tuple[int, ...]:
    return (0,) * int(FORMATS[output_type(name)][:-1] or 1)
