"""How far perspective moves a patch that is laid on another by an affinity."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from omniservo.geometry.arrays import FloatArray
from omniservo.perception.tangent_patches import TangentFrames

NEIGHBOURS = 48
"""of a match at most, that tell the perspective round it; with fewer, near ones, patches' own noise counts"""
LEAST_NEIGHBOURS = 6
ACROSS = 0.05
"""Neighbours on one plane lie no farther beside where the affinity leads, as a share of the way …"""
MOST_CHANGE = 0.5
"""… and no farther before or behind it."""
OFF = 0.03
"""Changes of scale that are off the others' by so much count a quarter."""
REACH = 8.0
"""[windows] Neighbours count the less the farther they are, and none beyond: the surface bends."""
NOISE = 0.03
"""standard deviation of the change of scale that a neighbour far from the window shows"""
PRIOR = np.array([0.4, 0.4, 0.03, 0.03, 0.03])
"""standard deviations of c [1/rad], and of what is wrong with the affinity: a scale, and two stretches"""
SHARE = 0.5
"""of w²: a patch's gradients lie nearer to its middle than its window; fitted to rendered planes"""
ITERATIONS = 10


def perspective_bias(
    one: TangentFrames, other: TangentFrames, places: FloatArray, affinities: FloatArray, windows: FloatArray
) -> FloatArray:
    """Return how far aligned patches (n, 2) lie from where their middles are, on the goal's planes.

    A plane of the world maps from one tangent plane to another by x → p + A x/(1 + c·x). An affinity leaves
    −(A x)(c·x), whose mean over a window of variance w² is −w² A c: all patches of that plane are found off
    alike, by a share of that. c stands in how the scale changes from a patch to its neighbours,
    ‖A x‖/‖y − p‖ − 1 = c·x: least squares with the weights of Geman and McClure, and with what may be wrong
    with A. Neighbours that A does not lead to are of another surface.

    Args:
        one: (n) planes at the patches' middles in the initial image.
        other: (n) planes of the goal image.
        places: (n, 2) p, where the middles were found on these.
        affinities: (n, 2, 2) A.
        windows: (n,) w [rad].
    """
    count = min(NEIGHBOURS, len(one) - 1)
    if count < LEAST_NEIGHBOURS:
        return np.zeros((len(one), 2))
    near = np.asarray(cKDTree(one.bearings).query(one.bearings, k=count + 1)[1])[:, 1:]
    found = other.directions(places[:, None])[:, 0]
    x, y = (
        np.stack([frames.places(bearings[near[:, k]]) for k in range(count)], axis=1)
        for frames, bearings in ((one, one.bearings), (other, found))
    )
    y = y - places[:, None]
    led, way = np.einsum("nij,nkj->nki", affinities, x), np.linalg.norm(y, axis=2)
    with np.errstate(divide="ignore", invalid="ignore"):
        change = np.linalg.norm(led, axis=2) / way - 1.0
        across = np.abs(led[..., 0] * y[..., 1] - led[..., 1] * y[..., 0]) / way**2
    usable = (across < ACROSS) & (np.abs(change) < MOST_CHANGE) & ((x**2).sum(axis=2) > 0.0)
    x, change = np.where(usable[..., None], x, 1.0), np.where(usable, change, 0.0)
    u, v, square = x[..., 0], x[..., 1], (x**2).sum(axis=2)
    terms = np.stack([u, v, np.ones_like(u), (u**2 - v**2) / square, 2.0 * u * v / square], axis=-1)
    distance = square / windows[:, None] ** 2
    sure = usable * np.maximum(1.0 - distance / REACH**2, 0.0) ** 2 / (1.0 + 2.0 / distance)
    weight, fit = sure, np.zeros((len(one), len(PRIOR)))
    for _ in range(ITERATIONS):
        left = np.einsum("nk,nki,nkj->nij", weight, terms, terms) + np.diag((NOISE / PRIOR) ** 2)
        right = np.einsum("nk,nk,nki->ni", weight, change, terms)
        fit = np.linalg.solve(left, right[..., None])[..., 0]
        off = np.abs(change - np.einsum("nki,ni->nk", terms, fit))
        weight = sure / (1.0 + (off / OFF) ** 2) ** 2
    told = (sure > 0.0).sum(axis=1, keepdims=True) >= LEAST_NEIGHBOURS
    curved = np.einsum("nij,nj->ni", affinities, fit[:, :2])
    bias: FloatArray = np.where(told, -SHARE * windows[:, None] ** 2 * curved, 0.0)
    return bias
