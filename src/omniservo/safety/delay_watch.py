"""Whether the images still lie to the joints in time as was measured before the run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.cameras.models import CentralModel
from omniservo.errors import ClockFault
from omniservo.geometry.arrays import FloatArray
from omniservo.robots import Arm
from omniservo.safety.motion_history import MotionHistory
from omniservo.safety.safety_options import SafetyOptions
from omniservo.safety.seen_points import SeenPoints

TOLERANCE = 0.01
"""An offset that is wrong by less does no harm [s]."""

SIGMAS = 3.0
"""and so many standard deviations, the measured offset's included, are chance."""

SPACING = 0.03
"""Images nearer to each other than this are left out [s]; twice as far each time that `KEPT` are there."""

KEPT = 48
"""images at most"""

LEAST_KEPT = 5
"""images before anything is said"""

MOST_POINTS = 20
"""that are evaluated"""

LEAST_POINTS = 4
"""that must have been seen in `LEAST_KEPT` images each"""

IN_A_ROW = 3
"""so many estimates must contradict what was measured, alike"""

MOUNT_TURN, MOUNT_PLACE, SCALE = np.deg2rad(1.0), 0.01, 0.01
"""Standard deviations of what the mount is off (rad, m, each axis), and of the focal length's share."""

_GRID = 21
"""places of the arm around an image's stamp, between which it moves straight"""

_STEP = 1e-3
"""[s] of the derivative with respect to the offset"""

_LEAST_PIXEL = 0.05
"""of noise [px]"""

_RAYLEIGH = 1.18
"""The median distance from the mean is so many times the standard deviation of a coordinate."""

_HUBER = 2.5
"""Residuals beyond so many times their noise count less."""

_ITERATIONS = 3

_GLOBALS = 8
"""the offset, the mount's six, the scale"""


@dataclass(frozen=True, eq=False)
class _Seen:
    """One image."""

    time: float
    pixels: FloatArray
    """(n, 2) [px], NaN where a point was not seen"""
    flanges: FloatArray
    """(_GRID, 3, 4) axes and place of the flange in the base frame, from ``time_offset`` before the stamp to
    as long after; an image was exposed before it is here, so what is expected of later does not matter"""


class DelayWatch:
    """Estimates from a run's images how far their stamps are off the joints', and refuses a contradiction.

    Minimises over the offset Δ

        Σ ρ(‖p_ij − c − (1 + f)(π((T(q(t_i + Δ)) M)⁻¹ X_j) − c)‖² / s²) + priors,

    T the camera's pose by the measured joints, M what the mount is off, f what the focal length is off, X_j
    the points, which may be off by ``structure_error`` of their distance. A wrong mount, lens or structure
    shifts a point by a share of how far the camera went, a wrong offset by a share of how fast it goes: so
    what starts or stops tells which. s is the residuals' own noise; Δ's standard deviation is
    that of the points' separate contributions, so that what is common to a point's images counts once.

    Nothing is watched where no offset was measured (``offset_sigma`` None).

    Args:
        camera: takes the images.
        arm: carries it.
        flange_T_camera: how it sits there.
        options: offset_sigma, time_offset (the largest Δ), structure_error.
    """

    def __init__(
        self, camera: CentralModel, arm: Arm, flange_T_camera: RigidTransform, options: SafetyOptions
    ) -> None:
        self._camera, self._arm, self._options = camera, arm, options
        self._mount = flange_T_camera
        self._centre = 0.5 * np.array([camera.width - 1.0, camera.height - 1.0])
        self._grid = np.linspace(-options.time_offset, options.time_offset, _GRID)
        priors = [options.time_offset, *3 * [MOUNT_TURN], *3 * [MOUNT_PLACE], SCALE]
        self._prior = np.array(priors) ** -2.0
        """(8,) one over the variance of the offset, the mount's turn and place, and the scale"""
        self._seen: list[_Seen] = []
        self._rows = np.empty(0, dtype=np.intp)
        self._points: FloatArray | None = None
        """(n, 3) in the base frame as first estimated [m]"""
        self._loose = np.empty(0)
        """(n,) one over the variance of each of their coordinates [1/m²]"""
        self._spacing, self._alike = SPACING, 0
        self.offset, self.sigma = 0.0, np.inf
        """as estimated last, beyond what was measured, with its standard deviation [s]"""

    def check(
        self,
        found: SeenPoints,
        history: MotionHistory,
    ) -> None:
        """Take an image in, with the joints up to now.

        Raises:
            ClockFault: the images ask for another offset than the one that was measured.
        """
        measured = self._options.offset_sigma
        if measured is None or (self._seen and found.time - self._seen[-1].time < self._spacing):
            return
        if self._points is None:
            self._begin(found, history)
        pixels = np.where(found.valid[:, None], found.pixels, np.nan)[self._rows]
        joints = history.expected(found.time + self._grid)
        self._seen.append(_Seen(found.time, pixels, np.array([self._arm.locate(q)[0] for q in joints])))
        if len(self._seen) >= LEAST_KEPT:
            self._judge(measured)
        if len(self._seen) > KEPT:
            self._seen, self._spacing = self._seen[::2], 2.0 * self._spacing

    def _begin(
        self,
        found: SeenPoints,
        history: MotionHistory,
    ) -> None:
        rows = np.flatnonzero(found.valid)
        self._rows = rows[np.unique(np.linspace(0, len(rows) - 1, MOST_POINTS).astype(np.intp))]
        base_T_camera = self._arm.base_T_flange(history.expected(np.array(found.time))) * self._mount
        seen_from = found.initial_T_camera.inv().apply(found.points[self._rows])
        self._points = base_T_camera.apply(seen_from)
        off = max(self._options.structure_error, 0.01) * np.linalg.norm(seen_from, axis=1)
        self._loose = 1.0 / np.maximum(off, 1e-6) ** 2

    def _judge(self, measured_sigma: float) -> None:
        """Raise where `IN_A_ROW` estimates contradict what was measured."""
        before = self.offset
        self.offset, self.sigma = self._estimate()
        beyond = abs(self.offset) > TOLERANCE + SIGMAS * float(np.hypot(self.sigma, measured_sigma))
        self._alike = (self._alike if before * self.offset > 0.0 else 0) + 1 if beyond else 0
        if self._alike >= IN_A_ROW:
            raise ClockFault(
                f"images and joints agree where {1e3 * self.offset:+.0f} ± {1e3 * self.sigma:.0f} ms are "
                f"added to the images' times beyond what was measured (± {1e3 * measured_sigma:.1f} ms): "
                "another camera setting or line since; measure it again: omniservo robot delay"
            )

    def _estimate(self) -> tuple[float, float]:
        """Return the offset and its standard deviation [s]."""
        pixels = np.array([image.pixels for image in self._seen])  # (k, n, 2)
        often = np.isfinite(pixels[..., 0]).sum(axis=0) >= LEAST_KEPT
        if self._points is None or often.sum() < LEAST_POINTS:
            return 0.0, np.inf
        pixels, first, loose = pixels[:, often], self._points[often], self._loose[often]
        moved, shared, sigma = np.zeros_like(first), np.zeros(_GLOBALS), np.inf
        for _ in range(_ITERATIONS):
            rest, by_shared, by_points = self._linear(pixels, first + moved, shared)
            size = np.linalg.norm(rest, axis=2)
            if not size.any():
                return 0.0, np.inf
            noise = max(float(np.median(size[size > 0.0])) / _RAYLEIGH, _LEAST_PIXEL)
            weights = np.minimum(1.0, _HUBER * noise / np.maximum(size, 1e-9)) / noise**2
            shared, moved, sigma = self._solved((rest, by_shared, by_points), weights, loose, shared, moved)
            shared[0] = np.clip(shared[0], self._grid[0], self._grid[-1])
        return float(shared[0]), sigma

    def _linear(
        self, pixels: FloatArray, points: FloatArray, shared: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return residuals (k, n, 2) [px] and how predictions change; 0 where a point is not seen.

        They change with what is shared, (k, n, 2, 8), and with the points, (k, n, 2, 3).
        """
        off = np.eye(4)
        off[:3, :3], off[:3, 3] = Rotation.from_rotvec(shared[1:4]).as_matrix(), shared[4:7]
        mount = self._mount.as_matrix() @ off
        turns, places = self._poses(mount, shared[0])
        there = np.einsum("kji,knj->kni", turns, points - places[:, None])
        later = self._poses(mount, shared[0] + _STEP)
        ahead = np.einsum("kji,knj->kni", later[0], points - later[1][:, None])
        expected, slopes, valid = self._camera.project_jacobian(there)
        known = valid & np.isfinite(pixels[..., 0]) & np.isfinite(expected).all(axis=2)
        slopes = np.where(known[..., None, None], slopes, 0.0)
        out = np.where(known[..., None], expected - self._centre, 0.0)
        rest = np.where(known[..., None], pixels - self._centre, 0.0) - (1.0 + shared[-1]) * out
        slopes = (1.0 + shared[-1]) * slopes
        by_turn = np.cross(there[..., None, :], np.eye(3)).swapaxes(-1, -2)  # ∂(y × m)/∂m
        shared_slopes = np.concatenate(
            (
                slopes @ ((ahead - there) / _STEP)[..., None],
                slopes @ by_turn,
                -slopes,
                out[..., None],
            ),
            axis=-1,
        )
        return rest, shared_slopes, slopes @ turns.swapaxes(-1, -2)[:, None]

    def _poses(self, mount: FloatArray, offset: float) -> tuple[FloatArray, FloatArray]:
        """Return base_T_camera of every image as turns (k, 3, 3) and places (k, 3) [m].

        Args:
            mount: (4, 4) flange_T_camera.
            offset: of the images' time stamps [s].
        """
        place = (offset - self._grid[0]) / (self._grid[1] - self._grid[0])
        k = int(np.clip(place, 0, _GRID - 2))
        share = place - k
        flanges = np.array([image.flanges[k : k + 2] for image in self._seen])
        poses = ((1.0 - share) * flanges[:, 0] + share * flanges[:, 1]) @ mount
        return poses[..., :3], poses[..., 3]

    def _solved(
        self,
        linear: tuple[FloatArray, FloatArray, FloatArray],
        weights: FloatArray,
        loose: FloatArray,
        shared: FloatArray,
        moved: FloatArray,
    ) -> tuple[FloatArray, FloatArray, float]:
        """Return what is shared (8,) and the points' moves (n, 3) after a step, and the offset's deviation.

        The points are eliminated first, each by itself.
        """
        r, g, d = linear
        own = np.einsum("kn,knia,knib->nab", weights, d, d) + loose[:, None, None] * np.eye(3)
        cross = np.einsum("kn,knia,knib->nab", weights, g, d)
        own_pull = np.einsum("kn,knia,kni->na", weights, d, r) - loose[:, None] * moved
        carried = cross @ np.linalg.inv(own)  # (n, 8, 3)
        each = np.einsum("kn,knia,kni->na", weights, g, r) - np.einsum("nab,nb->na", carried, own_pull)
        whole = np.einsum("kn,knia,knib->ab", weights, g, g) + np.diag(self._prior)
        inverse = np.linalg.inv(whole - np.einsum("nab,ncb->ac", carried, cross))
        step = inverse @ (each.sum(axis=0) - self._prior * shared)
        moves = np.linalg.solve(own, (own_pull - np.einsum("nab,a->nb", cross, step))[..., None])[..., 0]
        # What is left of each point says how far the points agree on the offset.
        each = each - each.mean(axis=0)
        spread = float(np.sum((each @ inverse[0]) ** 2)) * len(each) / max(len(each) - 1, 1)
        return shared + step, moved + moves, float(np.sqrt(spread + inverse[0, 0]))
