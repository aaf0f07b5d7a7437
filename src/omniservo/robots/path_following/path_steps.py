"""One branch followed along the camera's path: predicted, corrected, in steps as short as it needs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.geometry.arrays import FloatArray, finite_array
from omniservo.robots.arm import LENGTH_SCALE, SINGULAR_VALUE, Arm
from omniservo.robots.kinematics.twist_matrix import twist_matrix
from omniservo.robots.path_following.joint_path import FailureKind
from omniservo.robots.path_following.march_kernel import LONGEST, MORE, States, Table, march, set_off
from omniservo.robots.path_following.step_kernels import LEAST, LOST, SINGULAR, TAKEN, Rule

_SCALE = np.array([1.0 / LENGTH_SCALE] * 3 + [1.0] * 3)


class PosePath(Protocol):
    """A camera's way: `omniservo.planning.CameraPath` is one."""

    def sampled(self, w: FloatArray, /) -> tuple[FloatArray, FloatArray]:
        """Return poses and motions at w (m,) in [0, 1].

        initial_T_camera (m, 4, 4); and the camera's twist [m], [rad] per unit w in its own frame, with its
        derivative, (m, 2, 6).
        """
        ...


_FINER = 16
"""A table of places nearer together begins with so many in a step,"""

_PLACES = 129
"""and has so many."""

_PUSH = 1.0
"""Speed away from a limit that is reached, in half ranges per unit of the camera's way (7 joints)."""

PULL = 10.0
"""Parts of the way back to the line of an aim, per unit w: most of it within a quarter of the path"""


@dataclass(frozen=True)
class Stop:
    """Why a step cannot be taken, however short."""

    kind: FailureKind
    joint: int
    w: float
    amount: float


class PathSteps:
    """Camera path and arm joined; its poses are computed once for all branches."""

    def __init__(
        self, arm: Arm, path: PosePath, base_T_initial: RigidTransform, flange_T_camera: RigidTransform
    ) -> None:
        """See `omniservo.robots.path_following.follow_path.follow_path`."""
        self._arm, self._path = arm, path
        self._base_T_initial = base_T_initial.as_matrix()
        self._camera_T_flange = np.linalg.inv(flange_T_camera.as_matrix())
        self._whole = self._table(0.0, LONGEST / 8.0)
        way = float(np.linalg.norm(self._whole.motions[::4, 0], axis=1).mean())
        push = np.array([_PUSH * way if arm.dof > 6 else 0.0])
        none = np.zeros((2, arm.dof))
        to_camera = twist_matrix(flange_T_camera, LENGTH_SCALE)
        self._rule = Rule(to_camera, push, none, np.zeros(1), np.zeros(arm.dof))

    @property
    def first_goal(self) -> FloatArray:
        """base_T_flange (4, 4) where the path begins."""
        first: FloatArray = self._whole.goals[0]
        return first

    def lead(self, start: FloatArray, aim: FloatArray) -> None:
        """Let what the camera leaves free of seven joints go the straight way from ``start`` to ``aim``."""
        self._rule = self._rule._replace(line=np.array([start, aim]), pull=np.array([PULL]))

    def leave(self, start: FloatArray, velocity: FloatArray) -> None:
        """Let seven joints leave ``start`` with dq/dw = ``velocity``, as far as the camera lets them."""
        _, begun = self._begun(start)
        self._rule = self._rule._replace(departure=velocity - begun.joints[0, 1])

    def _begun(self, q: FloatArray) -> tuple[int, States]:
        """Return how the joints begin that stand at or near the path's start, in the first of many states."""
        table, room = self._whole, _room(len(q))
        result = set_off(self._arm.chain, self._rule, table, q, room)
        return result, room

    def follow(self, q: FloatArray) -> tuple[States, Stop | None]:
        """Return the states from w = 0 on, from joints at or near the path's start, and what ends them."""
        (result, room), table = self._begun(q), self._whole
        states = [_rows(room, 0, 1)]
        if result == SINGULAR:
            return states[0], self._stop(result, states[0], states[0])
        step = np.array([LONGEST])
        while True:
            result, count = march(self._arm.chain, self._rule, table, room, step)
            states.append(_rows(room, 1, count))
            if result != MORE:
                break
            now = _rows(room, count - 1, count)
            w, room = float(now.w[0]), _room(len(q))
            for own, last in zip(room, now, strict=True):
                own[0] = last[0]
            table = self._table(w, float(step[0]) / _FINER)
        whole = States(*(np.concatenate(parts) for parts in zip(*states, strict=True)))
        if result == TAKEN:
            return whole, None
        return whole, self._stop(result, _rows(room, count - 1, count), _rows(room, count, count + 1))

    def _stop(self, result: int, now: States, ahead: States) -> Stop:
        """Return what a failed step from one state to the next says."""
        w = float(ahead.w[0])
        if result == SINGULAR:
            J = self._rule.to_camera @ self._arm.scaled_flange_jacobian(ahead.joints[0, 0])
            weakest = np.linalg.svd(J, full_matrices=False)[2][-1]
            lack = SINGULAR_VALUE - float(ahead.values[0, LEAST])
            return Stop("singular", int(np.argmax(np.abs(weakest))), w, lack)
        foretold = now.joints[0, 0] + (w - now.w[0]) * now.joints[0, 1]
        change = ahead.joints[0, 0] - foretold
        if result == LOST:
            twist, jacobian = self._arm.miss(foretold, self._look_up(np.array([w]))[0][0])
            change = np.linalg.lstsq(jacobian, twist)[0]
        joint = int(np.argmax(np.abs(change)))
        return Stop("jump", joint, w, float(abs(change[joint])))

    def _table(self, w: float, apart: float) -> Table:
        """Return the path at places from w on, up to its end."""
        places: FloatArray = w + apart * np.arange(_PLACES, dtype=np.float64)
        return Table(np.array([w, apart]), *self._look_up(places[places <= 1.0]))

    def _look_up(self, w: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return base_T_flange (m, 4, 4), and the camera's twist with its derivative (m, 2, 6), at w (m,)."""
        poses, motions = self._path.sampled(w)
        poses = finite_array("path: poses", poses, (len(w), 4, 4))
        motions = finite_array("path: motions", motions, (len(w), 2, 6))
        return self._base_T_initial @ poses @ self._camera_T_flange, _SCALE * motions


def _room(dof: int) -> States:
    return States(np.zeros(_PLACES), np.empty((_PLACES, 3, dof)), np.empty((_PLACES, 3)))


def _rows(states: States, begin: int, end: int) -> States:
    return States(*(array[begin:end] for array in states))
