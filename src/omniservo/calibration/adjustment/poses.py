"""A target's pose from bearings, past 90° as well as before it: no image plane is needed.

b ∥ H x̃ for a planar target, x̃ = (x, y, 1) on it and H = s [r1 r2 t]; b ∥ P X̃ with P = s [R t] otherwise.
The sum of the squared parts of Hx̃ across b is hᵀ M h with M = Σ (I − bbᵀ) ⊗ x̃x̃ᵀ; h is the eigenvector of
the smallest eigenvalue, its sign the one that puts the target along the bearings rather than against them.
"""

from __future__ import annotations

import numpy as np

from omniservo.calibration.adjustment.lens import unproject
from omniservo.calibration.adjustment.refine import State, refine_poses
from omniservo.calibration.adjustment.views import Views, flatness
from omniservo.geometry.arrays import BoolArray, FloatArray


class Targets:
    """The targets of some views, each moved to its centre, turned flat and scaled to unit size."""

    def __init__(self, views: Views) -> None:
        self.views = views
        self.centres = np.empty((views.count, 3))
        self.axes = np.empty((views.count, 3, 3))
        self.sizes = np.empty(views.count)
        self.flat = np.empty(views.count, dtype=np.bool_)
        self.coordinates = np.empty((len(views.points), 3))
        for i in range(views.count):
            rows = views.rows(i)
            self.centres[i], self.axes[i], self.flat[i] = flatness(views.points[rows])
            local = (views.points[rows] - self.centres[i]) @ self.axes[i]
            self.sizes[i] = np.sqrt((local**2).sum(1).mean())
            self.coordinates[rows] = local / self.sizes[i]
        self.lifted = np.concatenate([self.coordinates, np.ones((len(self.coordinates), 1))], 1)

    def maps(self, bearings: FloatArray, weights: FloatArray) -> FloatArray:
        """Return the linear maps (V, 3, 4) from (x, y, z, 1) to bearings; z's column is 0 where flat."""
        across = np.eye(3) - bearings[:, :, None] * bearings[:, None, :]
        across = (across * weights[:, None, None]).reshape(-1, 9)
        result = np.zeros((self.views.count, 3, 4))
        for flat in (True, False):
            chosen = np.flatnonzero(self.flat == flat)
            if not len(chosen):
                continue
            used = np.array([0, 1, 3] if flat else [0, 1, 2, 3])
            lifted, n = self.lifted[:, used], len(used)
            sums = np.empty((len(chosen), 9, n * n))
            for place, view in enumerate(chosen):
                rows = self.views.rows(int(view))
                pairs = lifted[rows, :, None] * lifted[rows, None, :]
                sums[place] = across[rows].T @ pairs.reshape(-1, n * n)
            M = sums.reshape(-1, 3, 3, n, n).transpose(0, 1, 3, 2, 4).reshape(-1, 3 * n, 3 * n)
            found = np.linalg.eigh(M)[1][:, :, 0].reshape(-1, 3, n)
            result[np.ix_(chosen, np.arange(3), used)] = found
        ahead = weights * (self.sent(result) * bearings).sum(1)
        signs = np.where(np.add.reduceat(ahead, self.views.ends[:-1]) < 0.0, -1.0, 1.0)
        return result * signs[:, None, None]

    def sent(self, maps: FloatArray) -> FloatArray:
        """Return where the maps (V, 3, 4) send the corners (N, 3)."""
        return np.asarray((maps[self.views.row_view] @ self.lifted[:, :, None])[:, :, 0])

    def poses(self, maps: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the nearest rigid poses R (V, 3, 3), t (V, 3) [m] of linear maps (V, 3, 4)."""
        linear = np.array(maps[:, :, :3])
        U, sizes, Vt = np.linalg.svd(linear)
        # a flat target's third axis is the cross product of the others, so that R is right-handed
        flip = np.where(np.linalg.det(U @ Vt) < 0.0, -1.0, 1.0)
        U[:, :, 2] *= flip[:, None]
        R = U @ Vt
        scale = np.where(self.flat, sizes[:, :2].mean(1), sizes.mean(1))
        t = maps[:, :, 3] / np.maximum(scale, 1e-300)[:, None] * self.sizes[:, None]
        rotations = R @ np.swapaxes(self.axes, 1, 2)
        return rotations, t - (rotations @ self.centres[:, :, None])[:, :, 0]


def poses_from_corners(views: Views, theta: FloatArray, scale_px: float) -> State:
    """Return the poses that the corners have under the camera θ, robustly.

    Two rounds of the linear map, the second with Cauchy's weights; then every pose is refined in pixels, also
    from its mirror image about the line of sight, the other minimum that a small or distant plane has.
    """
    targets = Targets(views)
    bearings, seen = unproject(theta, views.pixels)
    maps = targets.maps(bearings, seen.astype(np.float64))
    errors = misfit(targets, maps, bearings)
    typical = views.median(errors)[views.row_view] + 1e-12
    maps = targets.maps(bearings, seen / (1.0 + (errors / (3.0 * typical)) ** 2))
    first = State(theta, *targets.poses(maps))
    refined, cost = refine_poses(views, first, scale_px=scale_px)
    other, other_cost = refine_poses(views, _tilted_back(views, refined), scale_px=scale_px)
    better = other_cost < cost
    return State(
        theta,
        np.where(better[:, None, None], other.rotations, refined.rotations),
        np.where(better[:, None], other.translations, refined.translations),
    )


def misfit(targets: Targets, maps: FloatArray, bearings: FloatArray) -> FloatArray:
    """Return the angles (N,) [rad] between bearings and what the linear maps send there; up to π."""
    sent = targets.sent(maps)
    return np.asarray(np.arctan2(np.linalg.norm(np.cross(bearings, sent), axis=1), (bearings * sent).sum(1)))


def linear_fit_px(views: Views, theta: FloatArray, keep: BoolArray) -> FloatArray:
    """Return how far each view's corners (V,) are from the best homography under θ: the median [px]."""
    targets = Targets(views)
    bearings, seen = unproject(theta, views.pixels)
    maps = targets.maps(bearings, (seen & keep).astype(np.float64))
    return views.median(misfit(targets, maps, bearings)) * float(np.abs(theta[:2]).mean())


def _tilted_back(views: Views, state: State) -> State:
    """Return every target turned about its centre so that its tilt to the line of sight is reversed.

    The normal n and the direction b to the centre: turned by twice the rotation that takes n to ±b.
    """
    centres = np.add.reduceat(views.points, views.ends[:-1]) / np.diff(views.ends)[:, None]
    seen = (state.rotations @ centres[:, :, None])[:, :, 0] + state.translations
    b = seen / np.linalg.norm(seen, axis=1, keepdims=True)
    local = np.stack([flatness(views.points[views.rows(i)])[1][:, 2] for i in range(views.count)])
    n = (state.rotations @ local[:, :, None])[:, :, 0]
    b = b * np.where((n * b).sum(1, keepdims=True) < 0.0, -1.0, 1.0)
    # the product of the reflections across n and across b turns by twice the angle between them
    mirror_b, mirror_n = _half_turn(b), _half_turn(n)
    rotations = mirror_b @ mirror_n @ state.rotations
    translations = seen - (rotations @ centres[:, :, None])[:, :, 0]
    return State(state.theta, rotations, translations)


def _half_turn(axes: FloatArray) -> FloatArray:
    return 2.0 * axes[:, :, None] * axes[:, None, :] - np.eye(3)
