"""Step after step along a camera path, compiled, as far as a table of its poses reaches."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.held import held
from omniservo.geometry.kernel import kernel
from omniservo.robots.kinematics.chain import Chain
from omniservo.robots.path_following.step_kernels import TAKEN, Aim, JointState, Rule, advance

LONGEST = 1.0 / 16.0
"""step of w"""

SHORTEST = 2.0**-14
"""A step that fails, so short, ends a branch."""

MORE = 100
"""What `march` returns where the table, or the room for states, ends before the path does."""


class Table(NamedTuple):
    """A camera path at places that are evenly apart, base_T_flange and the camera's motion."""

    span: FloatArray
    """(2,) the first w, and what lies between two"""
    goals: FloatArray
    """(m, 4, 4) base_T_flange"""
    motions: FloatArray
    """(m, 2, 6) the camera's twist per unit w and its derivative, metres over `LENGTH_SCALE`"""


class States(NamedTuple):
    """Where a branch has been, and is."""

    w: FloatArray
    """(k,)"""
    joints: FloatArray
    """(k, 3, n): q [rad], dq/dw, d²q/dw²"""
    values: FloatArray
    """(k, 3) see `step_kernels.VALUE` and the rest"""


@kernel
def set_off(chain: Chain, rule: Rule, table: Table, q: FloatArray, states: States) -> int:
    """Lead joints ``q`` (n,) at or near the path's start onto it, the first of the states; see `advance`."""
    standing = np.zeros((3, q.shape[0]))
    for j in range(q.shape[0]):
        standing[0, j] = q[j]
    return advance(
        held(chain),
        held(rule),
        0.0,
        0.0,
        JointState(standing, np.array([np.inf, 0.0, 0.0])),
        Aim(table.goals[0], table.motions[0], table.goals[0]),
        JointState(states.joints[0], states.values[0]),
    )


@kernel
def march(chain: Chain, rule: Rule, table: Table, states: States, step: FloatArray) -> tuple[int, int]:
    """Go on from the first state; return why it ends, and how many states there are then.

    A step that is not taken is halved, and doubled again where its places allow that.

    Args:
        chain: of n joints.
        rule: of the slope.
        table: of places; steps are dyadic, and so are its own.
        states: the first one given, those behind it out; of a step that is not taken, however short, the one
            behind the last is what was tried.
        step: (1,) of w, changed.

    Returns:
        TAKEN: w = 1 is reached. MORE: another table, or more room, is needed from the last state on. Else why
        a step cannot be taken.
    """
    chain, rule, last = held(chain), held(rule), 0
    origin, apart, m = table.span[0], table.span[1], table.goals.shape[0]
    while states.w[last] < 1.0:
        w = states.w[last]
        half, end = (w + 0.5 * step[0] - origin) / apart, (w + step[0] - origin) / apart
        middle, ahead = int(half), int(end)
        if middle != half or ahead != end or ahead >= m or last + 1 >= states.w.shape[0]:
            return MORE, last + 1
        states.w[last + 1] = w + step[0]
        result = advance(
            chain,
            rule,
            w,
            step[0],
            JointState(states.joints[last], states.values[last]),
            Aim(table.goals[ahead], table.motions[ahead], table.goals[middle]),
            JointState(states.joints[last + 1], states.values[last + 1]),
        )
        if result == TAKEN:
            last += 1
            doubled = states.w[last] / (2.0 * step[0])
            if step[0] < LONGEST and doubled == np.floor(doubled):
                step[0] *= 2.0
        elif step[0] <= SHORTEST:
            return result, last + 1
        else:
            step[0] *= 0.5
    return TAKEN, last + 1
