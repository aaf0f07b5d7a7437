"""Whether every joint of an arm answers what it is sent: alone, in its direction, and as far."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.errors import ServoStop
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import FloatArray
from omniservo.hardware import ArmConnection
from omniservo.robots import Arm, ArmBodies, arm_clearance
from omniservo.robots.path_following.joint_segment import joint_segment
from omniservo.safety import refuse_unready
from omniservo.tasks.task import WorkspaceSection

TURN = math.radians(0.5)
"""by which every joint turns, and back [rad]"""

SECONDS = 1.0
"""that it takes each way: it speeds up and slows down as sin², at 1°/s at most"""

ROOM = 4.0
"""So many times `TURN` is proven free either way before a joint is moved."""

FAR = 2.0
"""A joint that turned by so many times `TURN` is stopped."""

LEAST, MOST = 0.6, 1.6
"""A joint must turn by so many times what it was sent."""

ASIDE = 0.3
"""No other joint may turn by more than this share of `TURN`."""

UNITS = 10.0
"""A joint that turns by so many times too much or too little is taken for one in another unit."""

STILL = math.radians(0.1)
"""A joint slower than this stands [rad/s]."""

PATIENCE = 1.0
"""So long joints may go on after they were stopped [s]."""

_PERIOD = 5e-3


@with_field_docs
@dataclass(frozen=True)
class JointAnswer:
    """How a joint answered."""

    joint: str
    sent: float
    """[rad]"""
    turned: float
    """[rad]"""


@dataclass(frozen=True)
class JointTrial:
    """An arm whose joints are tried one by one, where it stands.

    Args:
        arm: as its file has it.
        connection: to it.
        flange_T_camera: the mount.
        workspace: of the camera's centre, stated in the base frame; None: any.
        clock: the connection's time [s].
        sleep: lets the given time pass [s].
    """

    arm: Arm
    connection: ArmConnection
    flange_T_camera: RigidTransform
    workspace: WorkspaceSection | None = None
    clock: Callable[[], float] = time.monotonic
    sleep: Callable[[float], None] = time.sleep

    def run(self, approve: Callable[[str], None]) -> tuple[tuple[JointAnswer, ...], list[str]]:
        """Turn every joint a little and back, the last one first; return the answers, and what is wrong.

        A joint is moved only where `ROOM` is free either way: joint limits, workspace, and the parts of the
        arm, proven for every angle between. What answers wrongly is left where it is, and a joint that goes
        too far ends the trial.

        Args:
            approve: called with what the arm is about to do; raises where it may not.

        Raises:
            NoSolutionError: it may not move.
            ServoStop: the connection was lost, the arm takes no commands any more, or does not stand.
        """
        bodies = ArmBodies(self.arm)
        begin = self.connection.read().joint_positions
        barred = [why for joint in range(self.arm.dof) if (why := self._barred(bodies, begin, joint))]
        if barred:
            return (), barred
        approve(
            f"turn each of {self.arm.dof} joints in turn by {math.degrees(TURN):g} deg and back, "
            f"{self.arm.joint_names[-1]} first"
        )
        answers: list[JointAnswer] = []
        findings: list[str] = []
        for joint in reversed(range(self.arm.dof)):
            if why := self._barred(bodies, self.connection.read().joint_positions, joint):
                return tuple(answers), [*findings, why]
            sent, moved = self._turn(joint, 1.0)
            answers.append(JointAnswer(self.arm.joint_names[joint], sent, float(moved[joint])))
            wrong = _wrong(self.arm.joint_names, joint, sent, moved)
            findings += [wrong] if wrong else []
            if np.abs(moved).max() > FAR * TURN:
                break
            if not wrong:
                self._turn(joint, -1.0)
        return tuple(answers), findings

    def _barred(self, bodies: ArmBodies, joints: FloatArray, joint: int) -> str:
        """Return why a joint has no room to turn; "" where it has."""
        ends = np.array([joints, joints])
        ends[:, joint] += np.array([-ROOM, ROOM]) * TURN
        why = ""
        if not all(self.arm.within_limits(end) for end in ends):
            why = "it would leave the arm file's range"
        elif not all(self._is_inside(end) for end in ends):
            why = "the camera's centre would leave the workspace"
        else:
            path = joint_segment(self.arm, ends[0], ends[1], self.flange_T_camera)
            found = arm_clearance(bodies, path, clearance=0.0)
            why = found.reason
        room = f"{self.arm.joint_names[joint]} has no {math.degrees(ROOM * TURN):g} deg of room either way"
        return f"{room}: {why}; bring the arm elsewhere" if why else ""

    def _is_inside(self, joints: FloatArray) -> bool:
        if self.workspace is None:
            return True
        centre = (self.arm.base_T_flange(joints) * self.flange_T_camera).translation
        low, high = np.array([self.workspace.min, self.workspace.max])
        inside = self.workspace.transform.inv().apply(centre)
        return bool((low <= inside).all() and (inside <= high).all())

    def _turn(self, joint: int, sign: float) -> tuple[float, FloatArray]:
        """Turn a joint; return by how much it was sent, and by how much all joints turned (n,) [rad]."""
        connection = self.connection
        before = connection.read().joint_positions
        speeds, sent, speed = np.zeros(self.arm.dof), 0.0, 0.0
        begin = last = self.clock()
        try:
            while (passed := self.clock() - begin) < SECONDS:
                state = connection.read()
                refuse_unready(state)
                if np.abs(state.joint_positions - before).max() > FAR * TURN:
                    break
                speeds[joint] = sign * (2.0 * TURN / SECONDS) * math.sin(math.pi * passed / SECONDS) ** 2
                connection.command(speeds)
                now = self.clock()
                sent, last, speed = sent + speed * (now - last), now, float(speeds[joint])
                self.sleep(_PERIOD)
        finally:
            connection.stop()
        sent += speed * (self.clock() - last)
        return sent, self._standing() - before

    def _standing(self) -> FloatArray:
        """Return the joints (n,) [rad] once they stand.

        Raises:
            ServoStop: they do not.
        """
        stopped = self.clock()
        while self.clock() < stopped + PATIENCE:
            state = self.connection.read()
            if state.time > stopped and (np.abs(state.joint_velocities) < STILL).all():
                return state.joint_positions
            self.sleep(_PERIOD)
        raise ServoStop(f"the arm was stopped, and does not stand {PATIENCE:g} s later")


def _wrong(names: tuple[str, ...], joint: int, sent: float, moved: FloatArray) -> str:
    """Return what is wrong with an answer; "" if nothing."""
    name, turned = names[joint], float(moved[joint])
    told = f"{name} was sent by {math.degrees(sent):+.2f} deg and turned by {math.degrees(turned):+.2f} deg"
    others = np.abs(np.delete(moved, joint))
    if others.max(initial=0.0) > ASIDE * TURN:
        rest = np.where(np.arange(len(moved)) == joint, 0.0, np.abs(moved))
        other = int(np.argmax(rest))
        return f"{told}, and {names[other]} by {math.degrees(moved[other]):+.2f} deg: names swapped?"
    share = turned / sent if sent else 0.0
    if share < -LEAST / UNITS:
        return f"{told}: it turns the other way"
    if share < 1.0 / UNITS:
        return f"{told}: it takes no commands, or in another unit (degrees for radians?)"
    if share > UNITS:
        return f"{told}: another unit (radians for degrees, mm for m?)"
    return "" if LEAST <= share <= MOST else f"{told}: another scale"
