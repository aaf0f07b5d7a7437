"""One branch followed along the camera's path: predicted, corrected, in steps as short as it needs."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.geometry.arrays import FloatArray, finite_array
from omniservo.robots.arm import LENGTH_SCALE, SINGULAR_VALUE, Arm
from omniservo.robots.joint_path import FailureKind
from omniservo.robots.step_kernels import LEAST, LOST, SINGULAR, TAKEN, Rule, advance
from omniservo.robots.twist_matrix import twist_matrix

PosePath: TypeAlias = Callable[..., Any]
"""``path(w, order)``: order 0: RigidTransform of the camera; 1: its twist (…, 6) [m], [rad] per unit w in its
own frame; 2: that twist's derivative. `omniservo.planning.CameraPath` is one."""

_LONGEST = 1.0 / 16.0
_SHORTEST = 2.0**-14
_AHEAD = 64
"""places that are looked up together"""

_PUSH = 1.0
"""Speed away from a limit that is reached, in half ranges per unit of the camera's way (7 joints)."""

PULL = 10.0
"""Parts of the way back to the line of an aim, per unit w: most of it within a quarter of the path"""


@dataclass(frozen=True, eq=False)
class State:
    """The arm at one w."""

    w: float
    joints: FloatArray
    """(3, n): q [rad], dq/dw, d²q/dw²"""
    values: FloatArray
    """(3,) see `step_kernels.VALUE` and the rest"""


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
        """See `omniservo.robots.follow_path.follow_path`."""
        self._arm, self._path = arm, path
        self._base_T_initial = base_T_initial.as_matrix()
        self._camera_T_flange = flange_T_camera.inv().as_matrix()
        self._known: dict[float, tuple[FloatArray, FloatArray]] = {}
        grid = np.linspace(0.0, 1.0, round(4 / _LONGEST) + 1)
        self._look_up(grid)
        way = float(np.mean([np.linalg.norm(self._known[w][1][0]) for w in grid[::2].tolist()]))
        push = np.array([_PUSH * way if arm.dof > 6 else 0.0])
        none = np.zeros((2, arm.dof))
        self._rule = Rule(twist_matrix(flange_T_camera, LENGTH_SCALE), push, none, np.zeros(1))

    def goal(self, w: float) -> FloatArray:
        """Return base_T_flange (4, 4) at a w that a step has led to, or has tried to, or at 0."""
        return self._known[w][0]

    def lead(self, start: FloatArray, aim: FloatArray) -> None:
        """Let what the camera leaves free of seven joints go the straight way from ``start`` to ``aim``."""
        self._rule = self._rule._replace(line=np.array([start, aim]), pull=np.array([PULL]))

    def follow(self, q: FloatArray) -> tuple[list[State], Stop | None]:
        """Return the states from w = 0 on, from joints at or near the path's start, and what ends them."""
        result, now = self._advance(State(0.0, _standing(q), np.array([np.inf, 0.0, 0.0])), 0.0)
        states, step = [now], _LONGEST
        if result == SINGULAR:
            return states, self._stop(result, now, now)
        while now.w < 1.0:
            result, ahead = self._advance(now, step)
            if result == TAKEN:
                now = ahead
                states.append(now)
                if step < _LONGEST and (now.w / (2.0 * step)).is_integer():
                    step *= 2.0
            elif step <= _SHORTEST:
                return states, self._stop(result, now, ahead)
            else:
                step *= 0.5
        return states, None

    def _advance(self, now: State, step: float) -> tuple[int, State]:
        half, w = now.w + 0.5 * step, now.w + step
        joints, values = np.empty_like(now.joints), np.empty(3)
        if half not in self._known or w not in self._known:
            self._look_up(_ahead(now.w, step))
        (middle, _), (goal, motion) = self._known[half], self._known[w]
        result = advance(
            self._arm.chain,
            self._rule,
            now.w,
            step,
            now.joints,
            now.values,
            goal,
            motion,
            middle,
            joints,
            values,
        )
        return result, State(w, joints, values)

    def _stop(self, result: int, now: State, ahead: State) -> Stop:
        """Return what a failed step from one state to the next says."""
        if result == SINGULAR:
            J = self._rule.to_camera @ self._arm.scaled_flange_jacobian(ahead.joints[0])
            weakest = np.linalg.svd(J, full_matrices=False)[2][-1]
            lack = SINGULAR_VALUE - float(ahead.values[LEAST])
            return Stop("singular", int(np.argmax(np.abs(weakest))), ahead.w, lack)
        foretold = now.joints[0] + (ahead.w - now.w) * now.joints[1]
        change = ahead.joints[0] - foretold
        if result == LOST:
            twist, jacobian = self._arm.miss(foretold, self.goal(ahead.w))
            change = np.linalg.lstsq(jacobian, twist)[0]
        joint = int(np.argmax(np.abs(change)))
        return Stop("jump", joint, ahead.w, float(abs(change[joint])))

    def _look_up(self, w: FloatArray) -> None:
        """Compute base_T_flange (4, 4), and the camera's twist with its derivative (2, 6), at w (m,)."""
        poses = self._base_T_initial @ self._path(w).as_matrix() @ self._camera_T_flange
        finite_array("path(w)", poses, (len(w), 4, 4))
        scale = np.array([1.0 / LENGTH_SCALE] * 3 + [1.0] * 3)
        orders = [finite_array(f"path(w, {order})", self._path(w, order), (len(w), 6)) for order in (1, 2)]
        motions = scale * np.stack(orders, axis=1)
        self._known.update(zip(w.tolist(), zip(poses, motions, strict=True), strict=True))


def _ahead(w: float, step: float) -> FloatArray:
    """Return the places that steps from w on will ask for, if they are like this one or shorter from here.

    Steps are dyadic, so places come back, and many that are looked up together cost as much as one.
    """
    like = w + 0.5 * step * np.arange(1, _AHEAD)
    shorter = w + step * 0.5 ** np.arange(2, round(math.log2(step / _SHORTEST)) + 2)
    return np.concatenate([like[like <= 1.0], shorter])


def _standing(q: FloatArray) -> FloatArray:
    joints = np.zeros((3, len(q)))
    joints[0] = q
    return joints
