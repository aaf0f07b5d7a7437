"""One step along a camera path, compiled: predicted, corrected, differentiated, and judged."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.held import held
from omniservo.geometry.kernel import inlined, kernel, leaf
from omniservo.geometry.linear_systems import factor_cholesky, solve_factored, symmetric_eigen
from omniservo.robots.kinematics.chain import (
    LENGTH_SCALE,
    SINGULAR_VALUE,
    Chain,
    least_motion,
    locate,
    miss,
    turned,
    write_gram,
)

TAKEN, SINGULAR, LEAP, LOST = range(4)
"""What became of a step. LEAP: a joint is too far from where its speed leads, or the camera half way from its
path. LOST: Newton's iteration did not arrive."""

VALUE, SLOPE, LEAST = range(3)
"""Places in ``values``: the smallest singular value, its derivative dσ/dw, and the least of the step."""

_BETWEEN = 5e-7
"""[m], [rad] pose error half way between samples"""
_EXACT = 1e-10
"""twist, linear part over LENGTH_SCALE, at which Newton's iteration has arrived"""
_ITERATIONS = 8
_FAR = 1.0
"""[rad] a correction that is larger leads elsewhere"""
_FLOWN = 1e-7
"""[rad] to where a step of seven joints has settled within the arm's self-motion"""
_CORRECTIONS = 4

FADED = 0.25
"""w from which on nothing is left of a departure"""

_LEAP = 0.1
"""[rad] farther from where its speed leads a joint never is on a step that is taken"""

_TINY = 1e-9
"""Singular values below it are taken for it where a state is required all the same."""


class Rule(NamedTuple):
    """What the slope of a joint path depends on, beside the pose."""

    to_camera: FloatArray
    """(6, 6) camera twist from flange twist, metres over `LENGTH_SCALE`"""
    push: FloatArray
    """(1,) speed away from a limit that is reached, in half ranges per unit w; 0: six joints"""
    line: FloatArray
    """(2, n) joints at w = 0 and 1 that what the camera leaves free goes along, and"""
    pull: FloatArray
    """(1,) what part of the way back to that line it goes per unit w; 0: there is none"""
    departure: FloatArray
    """(n,) dq/dw that what the camera leaves free has beside all that at w = 0; it fades away"""


class JointState(NamedTuple):
    """The joints at a place of the path."""

    joints: FloatArray
    """(3, n) q [rad], dq/dw, d²q/dw²"""
    values: FloatArray
    """(3,) of the smallest singular value, see `VALUE` and the rest"""


class Aim(NamedTuple):
    """Where the camera path leads a step."""

    goal: FloatArray
    """(4, 4) base_T_flange at its end"""
    motion: FloatArray
    """(2, 6) the camera's twist per unit w there and its derivative, metres over `LENGTH_SCALE`"""
    middle_goal: FloatArray
    """(4, 4) base_T_flange half way"""


@kernel
def advance(
    chain: Chain, rule: Rule, w: float, step: float, begin: JointState, aim: Aim, end: JointState
) -> int:
    """Take a step of w from one state to the next; return what became of it.

    Args:
        chain: of n joints.
        rule: of the slope.
        w: where the first of them is.
        step: of w; 0: from joints near the path onto it, if they can be led there.
        begin: the first of them; its LEAST is not read.
        aim: what the path wants.
        end: out; of LOST, what is there means nothing, and of joints that leap the values are not written.
    """
    chain, rule, now, ahead = held(chain), held(rule), begin.joints, end.joints
    n = now.shape[1]
    J, foretold, middle = np.empty((6, n)), np.empty(n), np.empty(n)
    for j in range(n):
        foretold[j] = now[0, j] + step * now[1, j]
        ahead[0, j] = foretold[j] + 0.5 * step * step * now[2, j]
    if not settle(chain, aim.goal, ahead[0], J):
        if step > 0.0:
            return LOST
        for j in range(n):
            ahead[0, j] = now[0, j]
        locate(chain, ahead[0], LENGTH_SCALE, np.empty((3, 4)), J)
    for j in range(n):
        if step > 0.0 and not abs(ahead[0, j] - foretold[j]) <= _LEAP:
            return LEAP
    regular = _differentiate(chain, rule, w + step, J, aim.motion, ahead)
    if regular and step > 0.0 and rule.push[0] > 0.0:
        _follow_flow(chain, rule, w, step, now, aim, ahead, J)
    _look_at_singularity(rule, J, ahead[1], end.values)
    end.values[LEAST] = _least_between(step, begin.values, end.values)
    if not regular or end.values[LEAST] < SINGULAR_VALUE:
        return SINGULAR
    if step == 0.0:
        return TAKEN
    for j in range(n):
        middle[j] = 0.5 * (now[0, j] + ahead[0, j]) + step * (
            (5.0 / 32.0) * (now[1, j] - ahead[1, j]) + (step / 64.0) * (now[2, j] + ahead[2, j])
        )
    twist = np.empty(6)
    miss(chain, middle, aim.middle_goal, twist, J)
    return TAKEN if _is_near(rule.to_camera, twist) else LEAP


@kernel
def settle(chain: Chain, goal: FloatArray, q: FloatArray, J: FloatArray) -> bool:
    """Lead the joints q (n,) onto the goal by Newton's iteration, least motion; False: it does not arrive.

    Writes the flange's Jacobian (6, n) there, linear rows over `LENGTH_SCALE`.
    """
    twist, change = np.empty(6), np.empty(q.shape[0])
    for _ in range(_ITERATIONS):
        miss(chain, q, goal, twist, J)
        if _largest(twist) < _EXACT:
            return True
        if not least_motion(J, 0.0, twist, change):
            return False
        for j in range(q.shape[0]):
            q[j] += change[j]
        if not _largest(change) <= _FAR:
            return False
    return False


@kernel
def _differentiate(
    chain: Chain,
    rule: Rule,
    w: float,
    flange_J: FloatArray,
    motion: FloatArray,
    state: FloatArray,
) -> bool:
    """Write slope and bend at q; False, and zeros, where JJᵀ has no inverse.

    J q′ = ξ with the least motion beside the wish z of the joints. z is the push off the limits, where there
    is a line l(w), l′ + k(l − q), and a departure d that fades: f(w) d, f = (1 − u)²(1 + 2u) with u = w over
    `FADED`, then 0. q′ = z + Jᵀλ, JJᵀλ = ξ − Jz; derived once more: q″ = z′ + J̇ᵀλ + Jᵀλ′, Jq″ = ξ′ − J̇q′.
    """
    n = state.shape[1]
    J, grown = np.empty((6, n)), np.empty((6, n))
    turned(rule.to_camera, flange_J, J)
    factor, weights, wish, wish_growth = np.empty((6, 6)), np.empty(6), np.empty(n), np.empty(n)
    q, slope, bend = state[0], state[1], state[2]
    write_gram(J, 0.0, factor)
    if not factor_cholesky(factor, 6, 0.0):
        for j in range(n):
            slope[j] = bend[j] = 0.0
        return False
    fade, fading = _faded(min(w / FADED, 1.0))
    for j in range(n):
        half = 0.5 * (chain.ranges[j, 1] - chain.ranges[j, 0])
        off = (q[j] - 0.5 * (chain.ranges[j, 0] + chain.ranges[j, 1])) / half
        along = rule.line[1, j] - rule.line[0, j]
        aside = rule.line[0, j] + w * along - q[j]
        wish[j] = along + rule.pull[0] * aside - rule.push[0] * half * off**5 + fade * rule.departure[j]
        wish_growth[j] = -rule.pull[0] - 5.0 * rule.push[0] * off**4
    for i in range(6):
        weights[i] = motion[0, i]
        for j in range(n):
            weights[i] -= J[i, j] * wish[j]
    solve_factored(factor, 6, weights)
    for j in range(n):
        slope[j] = wish[j]
        for i in range(6):
            slope[j] += J[i, j] * weights[i]
    grow_twists(J, slope, grown)
    for j in range(n):
        along = rule.line[1, j] - rule.line[0, j]
        bend[j] = wish_growth[j] * slope[j] + rule.pull[0] * along + fading * rule.departure[j]
        for i in range(6):
            bend[j] += grown[i, j] * weights[i]
    for i in range(6):
        weights[i] = motion[1, i]
        for j in range(n):
            weights[i] -= grown[i, j] * slope[j] + J[i, j] * bend[j]
    solve_factored(factor, 6, weights)
    for j in range(n):
        for i in range(6):
            bend[j] += J[i, j] * weights[i]
    return True


@inlined
def _look_at_singularity(rule: Rule, flange_J: FloatArray, slope: FloatArray, values: FloatArray) -> None:
    """Write the smallest singular value, and its derivative uᵀJ̇v where the joints move by slope (n,)."""
    n = slope.shape[0]
    J, grown = np.empty((6, n)), np.empty((6, n))
    turned(rule.to_camera, flange_J, J)
    sigma, left = singular_values(J)
    grow_twists(J, slope, grown)
    values[VALUE], values[SLOPE] = sigma[0], 0.0
    for j in range(n):
        across, along = 0.0, 0.0
        for i in range(6):
            across += left[i, 0] * grown[i, j]
            along += left[i, 0] * J[i, j]
        values[SLOPE] += across * along / max(sigma[0], _TINY)


@leaf
def _faded(u: float) -> tuple[float, float]:
    """Return f = (1 − u)²(1 + 2u), and df/dw."""
    return (1.0 - u) ** 2 * (1.0 + 2.0 * u), -6.0 * u * (1.0 - u) / FADED


@kernel
def singular_values(J: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the singular values (6,) of J (6, n), ascending, and the left vectors (6, 6), one a column.

    σ² are eigenvalues of JJᵀ: with ‖J‖ < 10 and σ ≥ 1e-3, right to 1e-11.
    """
    gram = np.empty((6, 6))
    write_gram(J, 0.0, gram)
    values, left = symmetric_eigen(gram)
    for i in range(6):
        values[i] = math.sqrt(max(values[i], 0.0))
    return values, left


@kernel
def grow_twists(J: FloatArray, slope: FloatArray, grown: FloatArray) -> None:
    """Write dJ/dw (6, n) along q′ = slope (n,), of a Jacobian in the frame of the body that it moves.

    By column, J̇ᵢ = [Jᵢ, Σ_{k>i} q′ₖ Jₖ]: the bracket of twists (linear, angular) in the moving frame.
    """
    after = np.zeros(6)
    for j in range(J.shape[1] - 1, -1, -1):
        u, v, w, a, b, c = J[0, j], J[1, j], J[2, j], J[3, j], J[4, j], J[5, j]
        grown[0, j] = b * after[2] - c * after[1] + v * after[5] - w * after[4]
        grown[1, j] = c * after[0] - a * after[2] + w * after[3] - u * after[5]
        grown[2, j] = a * after[1] - b * after[0] + u * after[4] - v * after[3]
        grown[3, j] = b * after[5] - c * after[4]
        grown[4, j] = c * after[3] - a * after[5]
        grown[5, j] = a * after[4] - b * after[3]
        for i in range(6):
            after[i] += slope[j] * J[i, j]


@inlined
def _follow_flow(
    chain: Chain,
    rule: Rule,
    w: float,
    step: float,
    now: FloatArray,
    aim: Aim,
    ahead: FloatArray,
    J: FloatArray,
) -> None:
    """Move ``ahead`` within the arm's self-motion to where the flow q′(w, q) leads, to fourth order.

    J is the flange's Jacobian there, and comes along.
    """
    n = now.shape[1]
    moved_J, twist, change, across = np.empty((6, n)), np.empty(6), np.empty(n), np.empty(n)
    moved = np.empty((3, n))
    for _ in range(_CORRECTIONS):
        for j in range(n):
            bent = (step / 12.0) * (now[2, j] - ahead[2, j])
            change[j] = now[0, j] - ahead[0, j] + step * (0.5 * (now[1, j] + ahead[1, j]) + bent)
        for i in range(6):
            twist[i] = 0.0
            for j in range(n):
                twist[i] += J[i, j] * change[j]
        if not least_motion(J, 0.0, twist, across):
            return
        for j in range(n):
            change[j] -= across[j]
            moved[0, j] = ahead[0, j] + change[j]
        if _largest(change) < _FLOWN or not settle(chain, aim.goal, moved[0], moved_J):
            return
        if not _differentiate(chain, rule, w + step, moved_J, aim.motion, moved):
            return
        for j in range(n):
            ahead[0, j], ahead[1, j], ahead[2, j] = moved[0, j], moved[1, j], moved[2, j]
            for i in range(6):
                J[i, j] = moved_J[i, j]


@leaf
def _least_between(step: float, now: FloatArray, ahead: FloatArray) -> float:
    """Return the least singular value of a step, by both tangents where it falls and rises."""
    ends = min(now[VALUE], ahead[VALUE])
    fall, rise = now[SLOPE], ahead[SLOPE]
    if not (fall < 0.0 and rise > 0.0):
        return float(ends)
    share = (ahead[VALUE] - rise * step - now[VALUE]) / (fall - rise)
    return float(min(ends, now[VALUE] + fall * share))


@leaf
def _is_near(to_camera: FloatArray, twist: FloatArray) -> bool:
    """Return whether the camera is within `_BETWEEN` of where the flange's twist (6,) leads it."""
    linear, angular = 0.0, 0.0
    for i in range(3):
        v, w = 0.0, 0.0
        for k in range(6):
            v += to_camera[i, k] * twist[k]
            w += to_camera[3 + i, k] * twist[k]
        linear += v * v
        angular += w * w
    return LENGTH_SCALE * math.sqrt(linear) <= _BETWEEN and math.sqrt(angular) <= _BETWEEN


@leaf
def _largest(vector: FloatArray) -> float:
    """Return the largest magnitude; infinity where a number is not finite."""
    most = 0.0
    for i in range(vector.shape[0]):
        if not abs(vector[i]) < math.inf:
            return math.inf
        most = max(most, abs(vector[i]))
    return most
