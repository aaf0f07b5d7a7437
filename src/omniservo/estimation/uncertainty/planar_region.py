"""How far the motion before a plane may be from its optimum: what the homography's own region decomposes to.

The pixels tell the homography H = R + t mᵀ, and its law is normal even where little of the image is seen. The
motion is a root of it: where H is near a rotation, or its two motions near each other, the linear image of
that law is far too small. So H is moved to the tips of its region, by the quantile of 95% and by 5 σ, and
decomposed; an ellipsoid that leaves out a motion found so is stretched to it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.special import chdtri, fdtri

from omniservo.estimation.refinement.planar_motion import PlanarMotion, decompose_homography
from omniservo.estimation.uncertainty.likelihood_region import LEVEL, stretch_weights
from omniservo.geometry.arrays import FloatArray

SURE = 5.0
"""[σ]: tips are at the border of the 95% region, and so far away"""

MOTION = 5
"""unknowns (δ, τ) of the 8; the others are the plane's"""


def planar_stretches(
    motion: PlanarMotion,
    others: Sequence[PlanarMotion],
    rays: FloatArray,
    across: FloatArray,
    spread: FloatArray,
    freedom: float,
) -> FloatArray:
    """Return rows (k, 6 + 3n) that stretch the law of x = (t, δ, h₁ … hₙ), in lengths of t.

    Args:
        motion: the optimum.
        others: motions that the pixels do not tell from it.
        rays: (n, 3) goal bearings at the optimum.
        across: (3, 2) the tangent plane of t.
        spread: (8, 8) covariance of (δ, τ, dm), σ² of the pixels in it.
        freedom: degrees of freedom of σ; infinite where it is known.
    """
    here, inner = motion.points(rays).ravel(), spread[:MOTION, :MOTION]
    rows = []
    usual = chdtri(MOTION, 1.0 - LEVEL) if math.isinf(freedom) else MOTION * fdtri(MOTION, freedom, LEVEL)
    tips = []
    for most in (float(usual), SURE**2):
        listed = (*others, *_tips(motion, rays, across, spread, math.sqrt(most)))
        rotations = np.array([found.rotation for found in listed]).reshape(-1, 3, 3)
        turns = Rotation.from_matrix(motion.rotation.T @ rotations).as_rotvec()
        for found, turn in zip(listed, turns, strict=True):
            shift = across.T @ (found.translation - motion.translation)
            tips.append((np.concatenate((turn, shift)), found, math.sqrt(most)))
    weights = stretch_weights(inner, np.array([offset / size for offset, _, size in tips]), 1.0)
    for weight, (offset, found, size) in zip(weights, tips, strict=True):
        if weight > 0.0:
            moved = np.concatenate((across @ offset[3:], offset[:3], found.points(rays).ravel() - here))
            rows.append(math.sqrt(weight) / size * moved)
    return np.array(rows).reshape(-1, 6 + len(here))


def _tips(
    motion: PlanarMotion, rays: FloatArray, across: FloatArray, spread: FloatArray, size: float
) -> list[PlanarMotion]:
    """Return the motions that H leads to, ``size`` σ away along the axes of the motion and of all eight."""
    rotation, translation, normal = motion
    values, axes = np.linalg.eigh(spread[:MOTION, :MOTION])
    steps = [(spread[:, :MOTION] @ axes / np.sqrt(np.maximum(values, 1e-300))).T]
    values, axes = np.linalg.eigh(spread)
    steps.append((axes * np.sqrt(np.maximum(values, 0.0))).T)
    whole, found = rotation + np.outer(translation, normal), []
    for step in size * np.concatenate(steps):
        skew = np.cross(np.eye(3), step[:3])  # [δ]×
        moved = rotation @ skew + np.outer(across @ step[3:MOTION], normal)
        moved += np.outer(translation, step[MOTION:])
        for sign in (1.0, -1.0):
            near = decompose_homography(whole + sign * moved, rays)
            if near:
                found.append(max(near, key=lambda m: _likeness(m, motion)))
    return found


def _likeness(one: PlanarMotion, other: PlanarMotion) -> float:
    return float(np.trace(one.rotation.T @ other.rotation) + 2.0 * one.translation @ other.translation)
