"""How a command is slowed down, approached, and where the robot would stand if it braked: joint by joint."""

from __future__ import annotations

import numpy as np

from omniservo.geometry.arrays import FloatArray


def slowed(velocities: FloatArray, limits: FloatArray) -> FloatArray:
    """Return finite velocities (n,) scaled as a whole so that none exceeds its limit (n,)."""
    excess = max((np.abs(velocities) / limits).tolist())
    if excess <= 1.0:
        return velocities
    scaled: FloatArray = np.clip(velocities / excess, -limits, limits)  # against the quotient's rounding
    return scaled


def approached(last: FloatArray, wanted: FloatArray, change: FloatArray) -> FloatArray:
    """Return the velocities (n,) nearest to ``wanted`` that differ from ``last`` by at most ``change`` (n,).

    Along ``wanted``, slower, where any such is in reach, so that the direction of motion is kept; else on the
    straight line from ``last`` to ``wanted``, on which all joints turn over together.
    """
    gap = wanted - last
    if np.count_nonzero(np.abs(gap) <= change) == len(gap):  # all() takes several times as long
        return wanted
    moving = wanted != 0.0
    ends = np.stack([last[moving] - change[moving], last[moving] + change[moving]]) / wanted[moving]
    least = float(max(0.0, ends.min(axis=0).max(initial=0.0)))
    most = float(min(1.0, ends.max(axis=0).min(initial=1.0)))
    if least <= most and (np.abs(last[~moving]) <= change[~moving]).all():
        near = most * wanted
    else:
        with np.errstate(divide="ignore", invalid="ignore"):
            part = float(np.min(np.where(gap != 0.0, change / np.abs(gap), np.inf)))
        near = last + part * gap
    kept: FloatArray = np.clip(near, last - change, last + change)
    return kept


def braked(last: FloatArray, change: FloatArray) -> FloatArray:
    """Return ``last`` (n,) led towards 0 by at most ``change`` (n,), every joint as fast as it can."""
    slower: FloatArray = np.sign(last) * np.maximum(np.abs(last) - change, 0.0)
    return slower


def stopping_distance(velocities: FloatArray, acceleration: FloatArray, reaction: float) -> FloatArray:
    """Return how far each joint still turns, q̇ T + q̇|q̇|/(2a): kept for the reaction time, then braked."""
    distance: FloatArray = velocities * reaction + velocities * np.abs(velocities) / (2.0 * acceleration)
    return distance
