"""One branch followed along the camera's path: predicted, corrected, in steps as short as it needs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import RigidTransform

from omniservo.geometry.arrays import FloatArray, finite_array
from omniservo.robots.arm import LENGTH_SCALE, SINGULAR_VALUE, Arm
from omniservo.robots.joint_path import FailureKind
from omniservo.robots.twist_growth import twist_growth
from omniservo.robots.twist_matrix import twist_matrix

PosePath: TypeAlias = Callable[..., Any]
"""``path(w, order)``: order 0: RigidTransform of the camera; 1: its twist (…, 6) [m], [rad] per unit w in its
own frame; 2: that twist's derivative. `omniservo.planning.CameraPath` is one."""

_LONGEST = 1.0 / 16.0
_SHORTEST = 2.0**-14
_BETWEEN = 5e-7
"""[m], [rad] pose error half way between samples"""
_EXACT = 1e-10
"""twist, linear part over LENGTH_SCALE, at which Newton's iteration has arrived"""
_ITERATIONS = 8
_FLOWN = 1e-7
"""[rad] to where a step of seven joints has settled within the arm's self-motion"""
_AHEAD = 16
"""places that are looked up together"""

_LEAP = 0.1
"""[rad] farther from where its speed leads a joint never is on a step that is taken"""
_PUSH = 1.0
"""Speed away from a limit that is reached, in half ranges per unit of the camera's way (7 joints)."""


@dataclass(frozen=True, eq=False)
class State:
    """The arm at one w."""

    w: float
    q: FloatArray
    """(n,) [rad]"""
    slope: FloatArray
    """(n,) dq/dw"""
    bend: FloatArray
    """(n,) d²q/dw²"""
    singular_value: float
    singular_slope: float
    """its derivative with respect to w"""
    weakest: FloatArray
    """(n,) unit motion that moves the camera least of those that do"""


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
        self._to_camera = twist_matrix(flange_T_camera, LENGTH_SCALE)
        self._known: dict[float, tuple[FloatArray, FloatArray, FloatArray]] = {}
        grid = np.linspace(0.0, 1.0, round(2 / _LONGEST) + 1)
        self._look_up(grid)
        ways = [float(np.linalg.norm(self._known[float(w)][1])) for w in grid]
        self._half = 0.5 * np.diff(arm.joint_range, axis=1)[:, 0]
        self._push = _PUSH * float(np.mean(ways)) if arm.dof > 6 else 0.0

    def goal(self, w: float) -> FloatArray:
        """Return base_T_flange (4, 4) at w."""
        return self._at(w)[0]

    def follow(self, q: FloatArray) -> tuple[list[State], Stop | None]:
        """Return the states from w = 0 on, from joints at or near the path's start, and what ends them."""
        now = self._start(q)
        states = [now]
        if now.singular_value < SINGULAR_VALUE:
            return states, _singular(now, now.singular_value)
        step = _LONGEST
        while now.w < 1.0:
            taken = self._step(now, step)
            if isinstance(taken, State):
                now = taken
                states.append(now)
                if step < _LONGEST and (now.w / (2.0 * step)).is_integer():
                    step *= 2.0
            elif step <= _SHORTEST:
                return states, taken
            else:
                step *= 0.5
        return states, None

    def _start(self, q: FloatArray) -> State:
        settled = self._settle(q, 0.0)
        return self._state(0.0, *(settled if settled is not None else (q, self._arm.flange_jacobian(q))))

    def _step(self, now: State, step: float) -> State | Stop:
        w = now.w + step
        foretold = now.q + step * now.slope
        settled = self._settle(foretold + 0.5 * step**2 * now.bend, w)
        if settled is None:
            return self._jump(now, step)
        q, jacobian = settled
        if np.abs(q - foretold).max() > _LEAP:
            return _leap(q - foretold, w)
        ahead = self._state(w, q, jacobian)
        if (least := _least_between(now, ahead)) < SINGULAR_VALUE:
            return _singular(ahead, least)
        if self._push:
            ahead = self._along_the_flow(now, ahead)
        middle = 0.5 * (now.q + ahead.q) + step * (
            (5.0 / 32.0) * (now.slope - ahead.slope) + (step / 64.0) * (now.bend + ahead.bend)
        )
        off, _ = self._arm.miss(middle, self.goal(now.w + 0.5 * step))
        off = self._to_camera @ off
        if max(LENGTH_SCALE * np.linalg.norm(off[:3]), np.linalg.norm(off[3:])) > _BETWEEN:
            return _leap(ahead.q - foretold, w)
        return ahead

    def _along_the_flow(self, now: State, ahead: State) -> State:
        """Return ``ahead`` moved within the self-motion to where the flow q′(w, q) leads, to fourth order."""
        step = ahead.w - now.w
        for _ in range(4):
            led = now.q + step * (0.5 * (now.slope + ahead.slope) + (step / 12.0) * (now.bend - ahead.bend))
            jacobian = self._arm.flange_jacobian(ahead.q)
            change = led - ahead.q
            change -= np.linalg.lstsq(jacobian, jacobian @ change)[0]
            if np.abs(change).max() < _FLOWN:
                break
            settled = self._settle(ahead.q + change, ahead.w)
            if settled is None:
                break
            ahead = self._state(ahead.w, *settled)
        return ahead

    def _settle(self, q: FloatArray, w: float) -> tuple[FloatArray, FloatArray] | None:
        """Return the nearest joints on the pose by Newton's iteration, and the Jacobian; None: not found."""
        goal = self.goal(w)
        for _ in range(_ITERATIONS):
            twist, jacobian = self._arm.miss(q, goal)
            if abs(twist).max() < _EXACT:
                jacobian[:3] *= LENGTH_SCALE
                return q, jacobian
            try:
                change = jacobian.T @ np.linalg.solve(jacobian @ jacobian.T, twist)
            except np.linalg.LinAlgError:
                return None
            q = q + change
            if abs(change).max() > 1.0:
                return None
        return None

    def _state(self, w: float, q: FloatArray, flange_jacobian: FloatArray) -> State:
        """Return slope and bend at q: J q′ = ξ with the least motion beside the push z off the limits.

        q′ = z + Jᵀλ, JJᵀλ = ξ − Jz; derived once more: q″ = z′ + J̇ᵀλ + Jᵀλ′, Jq″ = ξ′ − J̇q′. By column,
        J̇ᵢ = [Jᵢ, Σ_{k>i} q′ₖ Jₖ] (Lie bracket of twists in the moving frame).
        """
        _, twist, growth = self._at(w)
        flange_jacobian[:3] /= LENGTH_SCALE
        J = self._to_camera @ flange_jacobian
        left, values, right = np.linalg.svd(J, full_matrices=False)
        least = max(float(values[-1]), 1e-9)
        inverse = (left / np.maximum(values, least) ** 2) @ left.T
        off = (q - self._arm.joint_range.mean(axis=1)) / self._half
        push = -self._push * self._half * off**5
        weights = inverse @ (twist - J @ push)
        slope = push + J.T @ weights
        push_growth = -5.0 * self._push * off**4 * slope
        J_growth = twist_growth(J, slope)
        wanted = growth - J_growth @ slope - J @ (push_growth + J_growth.T @ weights)
        bend = push_growth + J_growth.T @ weights + J.T @ (inverse @ wanted)
        return State(
            w, q, slope, bend, float(values[-1]), float(left[:, -1] @ J_growth @ right[-1]), right[-1]
        )

    def _jump(self, now: State, step: float) -> Stop:
        twist, jacobian = self._arm.miss(now.q + step * now.slope, self.goal(now.w + step))
        return _leap(np.linalg.lstsq(jacobian, twist)[0], now.w + step)

    def _at(self, w: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        if w not in self._known:  # steps are dyadic: those ahead will be asked for, and many cost as one
            ahead = w + np.arange(_AHEAD) / w.as_integer_ratio()[1]
            self._look_up(ahead[ahead <= 1.0])
        return self._known[w]

    def _look_up(self, w: FloatArray) -> None:
        """Compute base_T_flange, the camera's twist and its derivative, metres over a length."""
        poses = self._base_T_initial @ self._path(w).as_matrix() @ self._camera_T_flange
        finite_array("path(w)", poses, (len(w), 4, 4))
        scale = np.array([1.0 / LENGTH_SCALE] * 3 + [1.0] * 3)
        twists, growths = (
            scale * finite_array(f"path(w, {order})", self._path(w, order), (len(w), 6)) for order in (1, 2)
        )
        for i, value in enumerate(w.tolist()):
            self._known[value] = poses[i], twists[i], growths[i]


def _least_between(now: State, ahead: State) -> float:
    """Return the least singular value of a step, by both tangents where it falls and rises."""
    ends = min(now.singular_value, ahead.singular_value)
    fall, rise = now.singular_slope, ahead.singular_slope
    if not fall < 0.0 < rise:
        return ends
    step = ahead.w - now.w
    share = (ahead.singular_value - rise * step - now.singular_value) / (fall - rise)
    return min(ends, now.singular_value + fall * share)


def _singular(state: State, value: float) -> Stop:
    joint = int(np.argmax(np.abs(state.weakest)))
    return Stop("singular", joint, state.w, SINGULAR_VALUE - value)


def _leap(change: npt.NDArray[np.floating[Any]], w: float) -> Stop:
    joint = int(np.argmax(np.abs(change)))
    return Stop("jump", joint, w, float(abs(change[joint])))
