"""Hundreds of runs of each fault over real processes on the wall clock: does the arm rest in time, for good?

Run: ``chrt -r 10 python -m benchmarks.process_faults --each 500 --at-once 3 --out runs/faults.jsonl``.
The file gets a line for every run as it ends, and the same command goes on where it was interrupted;
``--table FILE…`` prints the table alone, ``--kind NAME`` runs one fault.

A run is three processes: the arm (`benchmarks.mapped_arm`), the drive (`omniservo.drive`), and the leader, in
which `servo` follows a path of 14 cm in 2.5 s on projected points, and which does not give up: after a stop
it goes on sending twists. All are forks of one loaded process, so a run costs no import; where the names of
joints are the fault, or a second program that commands the arm, it is behind ROS 2 topics in place of a
mapped file. The fault comes at a random 0.2 to 1 s of the motion and stays until the arm has rested for
0.3 s, and no longer waits for images; then data are sound again, stopped processes go on, and 0.4 s later it
is judged:

- **late**: not at rest (a joint faster than 0.01 rad/s) within 0.15 s, the life of a command, and the time in
  which the arm brakes from the fastest that it was since the fault; for want of images within 0.25 s, their
  greatest age, in place of 0.15 s: there the servo slows down on its path, as gently as that allows;
- **after**: commands of motion that reached the arm after it was told to stop, or after it rested;
- **resumed**: it moved again;
- **waited**: so long the three processes were ready and did not get a processor, between fault and rest.

Joint states whose names come in another order are no fault: the run must go on, to the goal.
A run that ended before its fault is repeated.
"""

from __future__ import annotations

import argparse
import gc
import json
import os
import signal
import socket
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import closing, suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from benchmarks.mapped_arm import (
    AFTER,
    ALL_FROZEN,
    BRAKING,
    DRIVE,
    FAULT,
    FAULTS,
    IMAGES_FROZEN,
    IMAGES_STALE,
    MOUNT,
    MOVED,
    NAMES_REORDERED,
    NEWEST,
    RENAMED,
    RESTED,
    RUN,
    SECOND,
    SINCE,
    STATE,
    STOPPED,
    MappedArm,
    fault,
    mapped,
    scene,
    serve,
)
from benchmarks.real_loop import MappedCamera, Points, in_simulated_time, mapped_file, tracker_of, until

from omniservo.drive import ArmOpener, DriveClient, drive_client
from omniservo.drive.arm_opener import DriveSetup
from omniservo.drive.drive_loop import DriveLoop
from omniservo.errors import OmniservoError
from omniservo.geometry.arrays import FloatArray
from omniservo.hardware import LinkFaults
from omniservo.hardware.ros2.commands import TrajectoryCommands
from omniservo.robots import Arm, RobotState
from omniservo.ros_messages.messages import (
    DurationMessage,
    JointStateMessage,
    JointTrajectoryMessage,
    JointTrajectoryPointMessage,
    RosMessage,
)
from omniservo.safety import SafetyOptions, VisibilityFilter, servo
from omniservo.servoing import RestToRestLaw

OPTIONS = SafetyOptions(patience=0.6)
"""As ever, but images are not waited for longer than the faults stay."""
ROS_OPTIONS = replace(OPTIONS, joint_age=0.25, reaction=0.25)
"""of an arm behind ROS 2, whose joint states pass more threads: a busy machine makes them late by itself"""
PACE = RestToRestLaw(2.5)
IN_TIME = 0.15
"""the life of a command [s]"""
STALE = 0.6
"""Stale images are so old [s]."""
SIGNALS = {
    f"{who} {what}": (who, getattr(signal, what))
    for who in ("leader", "drive")
    for what in ("SIGKILL", "SIGTERM", "SIGSTOP")
}
KINDS = (*SIGNALS, *FAULTS)
HARMLESS = (NAMES_REORDERED,)
WAITED_FOR = (IMAGES_FROZEN, IMAGES_STALE)
"""The arm stands and waits for images; the fault stays until that is over."""
OVER_ROS = (NAMES_REORDERED, RENAMED, SECOND)
DOMAIN = 60
"""of DDS, of the first of the runs that are made at once"""


@dataclass(frozen=True)
class Row:
    """What became of a run."""

    run: int
    kind: str
    moved: float
    """from the fault to rest [s]"""
    within: float
    """in which it is to rest [s]"""
    after: int
    resumed: bool
    reason: str
    """how `servo` ended in the leader; empty: the leader did not live to say so"""
    waited: float
    """for a processor [s]"""
    load: float

    @property
    def fails(self) -> bool:
        """Whether it is not as it must be."""
        if self.kind in HARMLESS:
            return self.reason != "goal"
        return self.moved > self.within or self.after > 0 or self.resumed


def child(work: Callable[..., None], *arguments: object) -> int:
    """Do some work in a fork of this process, and return its number."""
    pid = os.fork()
    if pid == 0:
        try:
            signal.signal(signal.SIGTERM, signal.SIG_DFL)
            work(*arguments)
        finally:
            os._exit(0)
    return pid


@dataclass
class Forked:
    """A child as `subprocess.Popen` would show it."""

    pid: int

    def wait(self, timeout: float = 60.0) -> None:
        """Wait until it has ended."""
        until(lambda: os.waitpid(self.pid, os.WNOHANG)[0] != 0, timeout)

    def kill(self) -> None:
        """End it."""
        with suppress(ProcessLookupError):
            os.kill(self.pid, signal.SIGKILL)


def drive(ours: socket.socket, line: socket.socket, setup: DriveSetup) -> None:
    """Be the drive process, as `omniservo.drive.main` is."""
    ours.close()
    os.setsid()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit())
    DriveLoop(line, setup).run()


def started(setup: DriveSetup) -> tuple[socket.socket, Forked]:
    """Return the line to a new drive process, and the process: forked, not loaded anew."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    ours.settimeout(None)
    with theirs:
        return ours, Forked(child(drive, ours, theirs, setup))


class FaultyCamera(MappedCamera):
    """Gives no image, or old ones, while FAULT says so."""

    def __init__(self, shared: FloatArray, points: Points) -> None:
        super().__init__(shared, LinkFaults(), points)

    def newest(self) -> int:
        """Return how many frames have come."""
        now = fault(self._shared)
        if now in (IMAGES_FROZEN, ALL_FROZEN):
            return self._number
        late = round(STALE * 30.0) if now == IMAGES_STALE else 0
        return max(super().newest() - late, self._number)


def opener(file: str, domain: int) -> ArmOpener:
    """Return how the drive opens the arm: mapped, or of a DDS domain."""
    if not domain:
        return ArmOpener(MappedArm, {"file": file})
    from omniservo.hardware.ros2.network import DdsNetwork
    from omniservo.hardware.ros2.ros2_arm import Ros2Arm

    arm, here = Arm.rx60(), DdsNetwork.localhost(domain)
    return ArmOpener(
        Ros2Arm,
        {"joint_names": arm.joint_names, "accelerations": arm.joint_acceleration, "network": here},
    )


def lead(file: str, domain: int) -> None:
    """Follow the path, and go on sending twists whatever happens."""
    shared, points = mapped(file), Points()
    drive_client._started = started
    options, camera = ROS_OPTIONS if domain else OPTIONS, FaultyCamera(shared, points)
    client = DriveClient(opener(file, domain), Arm.rx60(), MOUNT, camera=camera, options=options)
    client.enable()
    shared[DRIVE] = client.process_id
    until(lambda: client.image() is not None, 5.0)
    tracker = tracker_of(points, 0.0, PACE)
    end = servo(client, tracker, points, VisibilityFilter(scene().camera), time_limit=6.0)
    Path(f"{file}.end").write_text("goal" if end is None else end.reason, encoding="utf-8")
    while end is not None:
        with suppress(OmniservoError):
            client.image()
            client.carry([0.03, 0.0, 0.0, 0.0, 0.0, 0.0])
        time.sleep(0.02)


class Followed(MappedArm):
    """What a controller sends its own drives to hold a place is no command of ours."""

    def count(self, wanted: FloatArray) -> None:
        """Count nothing."""

    def stop(self) -> None:
        """Stand."""
        self.command(np.zeros(6))


def serve_named(file: str, domain: int) -> None:
    """Serve the mapped arm under ROS 2, with the names that FAULT says."""
    from omniservo.hardware.ros2.network import DdsNetwork
    from omniservo.hardware.ros2.server import Ros2Server

    shared = mapped(file)

    class Server(Ros2Server):
        def _state_message(self, state: RobotState, stamp: float) -> JointStateMessage:
            message = super()._state_message(state, stamp)
            now = fault(shared)
            if now == RENAMED:
                message.name[0] += "_of_another"
            if now == NAMES_REORDERED:
                order = [3, 0, 5, 1, 4, 2]
                message.name = [message.name[k] for k in order]
                message.position, message.velocity = message.position[order], message.velocity[order]
            return message

        def _command(self, message: RosMessage, now: float) -> str:
            if isinstance(message, JointTrajectoryMessage) and shared[RESTED]:
                shared[AFTER] += any(np.any(point.velocities) for point in message.points)
            return super()._command(message, now)

    with closing(Server(Followed(file), Arm.rx60().joint_names, network=DdsNetwork.localhost(domain))):
        serve(file)


def command_too(file: str, domain: int) -> None:
    """Be a second program that commands the arm, over the same topic: to stand where it is now."""
    from omniservo.hardware.ros2.network import DdsNetwork
    from omniservo.hardware.ros2.node import RosNode

    shared, commands = mapped(file), TrajectoryCommands()
    node = RosNode(DdsNetwork.localhost(domain))
    publisher = node.publish(commands.topic, JointTrajectoryMessage)
    while shared[RUN] and not shared[RESTED]:
        point = JointTrajectoryPointMessage(
            np.array(shared[STATE + 1 : STATE + 7]),
            np.zeros(6),
            time_from_start=DurationMessage(0, 50_000_000),
        )
        publisher.write(JointTrajectoryMessage(joint_names=list(Arm.rx60().joint_names), points=[point]))
        shared[FAULT], shared[SINCE] = 1 + FAULTS.index(SECOND), shared[SINCE] or time.monotonic()
        time.sleep(0.05)
    node.close()


def waiting(pids: list[int]) -> float:
    """Return how long processes were ready and did not run since they began [s]."""
    total = 0.0
    for pid in pids:
        with suppress(OSError):
            total += 1e-9 * int(Path(f"/proc/{pid}/schedstat").read_text().split()[1])
    return total


def ended(pid: int) -> bool:
    """Tell whether a process is no more, or waits for its parent to notice; 0 is none."""
    try:
        return not pid or Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except OSError:
        return True


def fault_run(number: int, kind: str, domain: int) -> Row | None:
    """Return what became of a run; None: it ended before the fault."""
    domain = domain if kind in OVER_ROS else 0
    with mapped_file() as (shared, file):
        arm = child(serve_named, file, domain) if domain else child(serve, file)
        until(lambda: shared[NEWEST] > 1, 20.0)
        leader = child(lead, file, domain)
        try:
            return _faulted(number, kind, shared, (arm, leader), domain, file)
        finally:
            os.kill(leader, signal.SIGKILL)
            os.waitpid(leader, 0)
            until(lambda: ended(int(shared[DRIVE])), 10.0)
            shared[RUN] = 0.0
            os.waitpid(arm, 0)


def _faulted(
    number: int, kind: str, shared: FloatArray, pids: tuple[int, int], domain: int, file: str
) -> Row | None:
    def rests(seconds: float) -> bool:
        return time.monotonic() - shared[MOVED] > seconds

    end = Path(f"{file}.end")
    if not until(lambda: shared[DRIVE] and not rests(0.05), 30.0):
        return None
    time.sleep(float(np.random.default_rng((number, KINDS.index(kind))).uniform(0.2, 1.0)))
    if rests(0.05) or end.exists():
        return None
    arm, leader = pids
    three = [arm, leader, int(shared[DRIVE])]
    waited = waiting(three)
    shared[STOPPED] = 0.0
    if kind == SECOND:
        three.append(child(command_too, file, domain))
        until(lambda: shared[SINCE] > 0.0, 5.0)
    elif kind in SIGNALS:
        shared[SINCE] = time.monotonic()
        who, what = SIGNALS[kind]
        os.kill(three[1] if who == "leader" else three[2], what)
    else:
        shared[SINCE] = time.monotonic()
        shared[FAULT] = 1 + FAULTS.index(kind)
    begin = float(shared[SINCE])
    rested = until(lambda: rests(0.3), 10.0)
    moved, waited = float(shared[MOVED]) - begin, waiting(three) - waited
    if moved <= 0.0:
        return None
    if kind in WAITED_FOR:
        until(end.exists, 5.0)
    shared[RESTED] = 1.0
    shared[FAULT] = 0.0  # fresh data resume nothing
    for pid in three[1:3]:
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGCONT)
    time.sleep(0.4)
    if kind == SECOND:
        os.waitpid(three[3], 0)
    resumed = not rested or not rests(0.4)
    if kind in HARMLESS:
        until(end.exists, 5.0)
    reason = end.read_text(encoding="utf-8") if end.exists() else ""
    within = (OPTIONS.image_age if kind in WAITED_FOR else IN_TIME) + float(shared[BRAKING])
    numbers = (round(moved, 4), round(within, 4), int(shared[AFTER]), resumed, reason, round(waited, 4))
    return Row(number, kind, *numbers, os.getloadavg()[0])


def rows_of(files: list[Path]) -> list[Row]:
    """Return the rows of files; a last line that was cut off is left out."""
    lines = [
        line
        for file in files
        if file.exists()
        for line in file.read_text(encoding="utf-8").splitlines(keepends=True)
    ]
    return [Row(**json.loads(line)) for line in lines if line.endswith("\n")]


def run_rows(asked: list[tuple[int, str]], out: Path, domain: int) -> None:
    """Run rows, each added to the file as it ends."""
    for number, kind in asked:
        row = None
        for _ in range(3):
            row = row or fault_run(number, kind, domain)
        if row is not None:
            with out.open("a", encoding="utf-8") as stream:
                stream.write(json.dumps(asdict(row)) + "\n")


def table(rows: list[Row]) -> Iterator[str]:
    """Yield the table by fault."""
    heads = ("fault", "runs", "how `servo` ended", "at rest after, median / most [s]", "most beyond [s]",
             "late", "commands after", "resumed", "waited, most [s]")  # fmt: skip
    yield "| " + " | ".join(heads) + " |"
    yield "|---" * len(heads) + "|"
    by_kind: dict[str, list[Row]] = defaultdict(list)
    for row in rows:
        by_kind[row.kind].append(row)
    for kind in KINDS:
        if found := by_kind.get(kind):
            yield _line(kind, found)


def _line(kind: str, rows: list[Row]) -> str:
    moved = np.array([row.moved for row in rows])
    beyond = max(row.moved - row.within for row in rows)
    ends = sorted({row.reason or "–" for row in rows})
    cells = [
        kind, len(rows), ", ".join(ends), f"{np.median(moved):.3f} / {moved.max():.3f}", f"{beyond:+.3f}",
        sum(row.moved > row.within for row in rows), sum(row.after > 0 for row in rows),
        sum(row.resumed for row in rows), f"{max(row.waited for row in rows):.3f}",
    ]  # fmt: skip
    return "| " + " | ".join(map(str, cells)) + " |"


def main() -> None:
    """Run the rows that are not there yet, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--each", type=int, default=3, help="runs of each fault")
    parser.add_argument("--at-once", type=int, default=2)
    parser.add_argument("--kind", choices=KINDS, action="append")
    parser.add_argument("--out", type=Path, default=Path("runs/process-faults.jsonl"))
    parser.add_argument("--table", type=Path, nargs="+", help="run nothing: the table of these files")
    given = parser.parse_args()
    if given.table is None:
        given.out.parent.mkdir(parents=True, exist_ok=True)
        known = {(row.run, row.kind) for row in rows_of([given.out])}
        every = [(n, kind) for n in range(given.each) for kind in given.kind or KINDS]
        asked = [each for each in every if each not in known]
        in_simulated_time(LinkFaults(), 0.0)  # loads and compiles what all forks share
        gc.freeze()
        workers = [
            child(run_rows, asked[k :: given.at_once], given.out, DOMAIN + k) for k in range(given.at_once)
        ]
        for pid in workers:
            os.waitpid(pid, 0)
    rows = rows_of(given.table or [given.out])
    for line in table(rows):
        print(line)
    for row in rows:
        if row.fails:
            print(row)


if __name__ == "__main__":
    main()
