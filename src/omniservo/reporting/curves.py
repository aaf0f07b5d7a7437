"""A run as curves: what was planned over w and what the arm did, in the same quantities."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.reporting.image_distance import image_distance
from omniservo.results.run_log import RunLog
from omniservo.results.run_result import RunResult
from omniservo.tasks import Task

SAMPLES = 401
"""of a planned curve"""


@dataclass(frozen=True)
class Curve:
    """k moments of a camera's motion; n target points, m planning obstacles."""

    time: FloatArray
    """(k,) [s]; NaN for a planned curve"""
    w: FloatArray
    """(k,) path parameter; NaN where nothing was planned"""
    positions: FloatArray
    """(k, 3) camera centre, initial camera frame [m]"""
    rotations: FloatArray
    """(k, 3) rotation vector of initial_R_camera [rad]"""
    pixels: FloatArray
    """(k, n, 2) [px]; NaN where not seen"""
    plane: FloatArray
    """(k, n, 2) on the virtual plane, X/Z and Y/Z; NaN where not seen or Z ≤ 0"""
    points_left_out: int
    """how many of the k·n points are seen but have Z ≤ 0, where the virtual plane ends"""
    clearances: FloatArray
    """(k, m) distance of the camera centre to each obstacle's surface [m]"""
    visibility: FloatArray
    """(k,) smallest distance of a point to the image's limits [px]; NaN where one cannot be seen at all"""

    def __len__(self) -> int:
        return len(self.time)

    @property
    def poses(self) -> RigidTransform:
        """initial_T_camera at every moment."""
        return RigidTransform.from_components(self.positions, Rotation.from_rotvec(self.rotations))


def planned_curve(result: RunResult) -> Curve | None:
    """Return the planned path, seen with the estimated points; None where nothing was planned.

    Where the run switched to another path it goes on with that; obstacles are as known then.
    """
    if result.way is None:
        return None
    w = np.linspace(0.0, 1.0, SAMPLES)
    poses = result.way.poses(w)
    log = result.log
    times = np.interp(w, log.column("w"), log.column("time")) if log.rows else np.zeros(SAMPLES)
    seen_from = poses.inv()
    points = np.stack([seen_from.apply(h) for h in result.points], axis=1)
    pixels, valid = result.task.camera.project(points)
    pixels = np.where(valid[..., None], pixels, np.nan)
    return Curve(
        time=np.full(SAMPLES, np.nan),
        w=w,
        positions=poses.translation,
        rotations=poses.rotation.as_rotvec(),
        pixels=pixels,
        plane=_on_plane(points, valid),
        points_left_out=int(np.sum(valid & (points[..., 2] <= 0.0))),
        clearances=obstacle_distances(result.task, times, poses.translation),
        visibility=_worst(image_distance(result.task.camera, pixels)),
    )


def executed_curve(result: RunResult) -> Curve:
    """Return what the arm did: points as detected; poses and visibility are true, or as measured."""
    log, count = result.log, len(result.followed)
    positions = log.executed("position")
    pixels = _column(log, "pixels", (count, 2))
    bearings, valid = result.task.camera.unproject(pixels)
    valid &= np.isfinite(pixels).all(axis=-1)
    return Curve(
        time=_column(log, "time", ()),
        w=_column(log, "w", ()),
        positions=positions,
        rotations=log.executed("rotation"),
        pixels=pixels,
        plane=_on_plane(bearings, valid),
        points_left_out=int(np.sum(valid & (bearings[..., 2] <= 0.0))),
        clearances=obstacle_distances(result.task, _column(log, "time", ()), positions),
        visibility=_worst(image_distance(result.task.camera, log.executed("pixels").reshape(-1, count, 2))),
    )


def _column(log: RunLog, name: str, shape: tuple[int, ...]) -> FloatArray:
    """Return a field of all rows, (steps, *shape), also of a run that was stopped before its first step."""
    return log.column(name).reshape(len(log.rows), *shape)


def _on_plane(directions: FloatArray, valid: BoolArray) -> FloatArray:
    """Return X/Z, Y/Z (…, 2) of directions (…, 3), NaN where not valid or Z ≤ 0."""
    z = np.where(valid & (directions[..., 2] > 0.0), directions[..., 2], np.nan)
    return np.asarray(directions[..., :2] / z[..., None], dtype=np.float64)


def obstacle_distances(task: Task, times: FloatArray, positions: FloatArray) -> FloatArray:
    """Return the distance of each position (k, 3) to each of m planning obstacles (k, m) [m].

    Obstacles are where they are known to be at ``times`` (k,) [s].
    """
    found = np.empty((len(positions), len(task.planning.obstacles)))
    for begin in (-np.inf, *sorted(move.time for move in task.moves)):
        rows = times >= begin
        for i, section in enumerate(task.known_obstacles(begin)):
            found[rows, i] = section.obstacle.distance(positions[rows])
    return found


def _worst(distances: FloatArray) -> FloatArray:
    """Return the smallest of each row (k, n); NaN where a point is where the camera sees nothing at all."""
    return np.asarray(distances.min(axis=1, initial=np.inf), dtype=np.float64)
