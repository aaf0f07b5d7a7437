"""How far one run of an arm deviated from its planned joint path."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import RigidTransform

from omniservo.errors import InputError
from omniservo.geometry.arrays import FloatArray, finite_array, finite_number
from omniservo.robots.collision.arm_bodies import ArmBodies

_NEAR = 0.15
"""[m]"""


def strayed(
    bodies: ArmBodies,
    flange_T_camera: RigidTransform,
    planned: npt.ArrayLike,
    executed: npt.ArrayLike,
    image_px: float,
) -> FloatArray:
    """Return the most that a run deviated from its path: (k,), in the order of `TrackingTube.shape`.

    Each executed configuration is compared with the place of the path where the bodies are nearest to it
    (least Σ ‖Δx‖² of the corners of boxes about their shapes), not with where the time law would have it:
    being late is no deviation from a path that is clear for all w. Between rows the path is taken to be
    straight. A link deviates by the farthest of its corners; no point of a shape goes farther, ‖A x + b‖
    being convex in x. Two links of the arm with more than one joint between them deviate by what the run
    takes of the gap between them, where that is planned to be below 0.15 m.

    Args:
        bodies: the arm, with what it carries.
        flange_T_camera: where the camera sits.
        planned: (k, n) the path, in order, k ≥ 2 [rad].
        executed: (m, n) configurations of the run, m ≥ 1 [rad].
        image_px: the most that a point in the image deviated [px].

    Raises:
        InputError: wrong shape, NaN or infinity.
    """
    arm = bodies.arm
    path = finite_array("planned", planned, (None, arm.dof))
    run = finite_array("executed", executed, (None, arm.dof))
    if len(path) < 2 or not len(run):
        raise InputError(f"planned, executed: {len(path)} and {len(run)} rows; at least 2 and 1 are needed")
    most = np.zeros(arm.dof + len(bodies.tube_parts) + 2)
    most[-1] = finite_number("image_px", image_px, minimum=0.0)
    nearest = _nearest(bodies, path, run)
    most[: arm.dof] = np.abs(run - nearest).max(axis=0)
    shapes = [bodies.shapes_of(link) for link in bodies.links]
    parts = most[arm.dof : -2]
    for q, near in zip(run, nearest, strict=True):
        before, gaps = bodies.corners(near), _own_gaps(bodies, _NEAR)
        moved = np.linalg.norm(bodies.corners(q) - before, axis=2).max(axis=1)
        for i, of_link in enumerate(shapes):
            parts[i] = max(parts[i], float(moved[of_link].max()))
        after = {pair: bodies.measure(pair) for pair in gaps}
        for pair, gap in gaps.items():
            i = bodies.tube_parts.index(bodies.part_of(pair))
            parts[i] = max(parts[i], gap - after[pair])
        places = ((arm.base_T_flange(at) * flange_T_camera).translation for at in (near, q))
        apart = np.subtract(*places)
        most[-2] = max(most[-2], float(np.linalg.norm(apart)))
    return most


def _own_gaps(bodies: ArmBodies, within: float) -> dict[int, float]:
    """Return the gaps of the arm's own parts that are close, by pair [m]."""
    own = bodies.own_pairs
    close = own[bodies.lower_gaps(own) < within].tolist()
    return {pair: gap for pair in close if (gap := bodies.measure(pair)) < within}


def _nearest(bodies: ArmBodies, path: FloatArray, run: FloatArray) -> FloatArray:
    """Return the joints (m, n) on the polyline (k, n) where the bodies are nearest to those of the run."""
    places, at_run = (np.array([bodies.corners(q).ravel() for q in rows]) for rows in (path, run))
    begin, way = places[:-1], np.diff(places, axis=0)
    length = np.maximum((way**2).sum(axis=1), 1e-300)
    found = np.empty_like(run)
    for i, corners in enumerate(at_run):
        beyond = corners - begin
        along = np.clip((beyond * way).sum(axis=1) / length, 0.0, 1.0)
        k = int(np.argmin(((beyond - along[:, None] * way) ** 2).sum(axis=1)))
        found[i] = path[k] + along[k] * (path[k + 1] - path[k])
    return found
