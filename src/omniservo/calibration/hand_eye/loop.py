"""The loop base → flange → camera → board, linearised in each view.

    π(X⁻¹ (A Δ)⁻¹ Z p) = u + noise,   X = flange_T_camera, Z = base_T_board, A = base_T_flange as reported,

where Δ = (d_t, d_r) is what the robot's report is off by: the true pose has the translation t_A + R_A d_t and
the rotation R_A exp(d_r). X and Z move likewise: t + x_t, R exp(x_r). Every one of these moves the board in
the camera by a twist, p ↦ p + v + ω × p, so a view says what it has to say in six numbers.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.cameras.models import CentralModel
from omniservo.estimation.uncertainty.camera_moves import CameraMoves
from omniservo.geometry.arrays import FloatArray, IntArray

_CAUCHY = 3.0
"""[σ] from which on a corner counts less: Cauchy's loss"""


@dataclass(frozen=True, eq=False)
class SeenViews:
    """What n images show of the board, and where the robot says that they were taken."""

    base_T_flange: RigidTransform
    """n poses"""
    pixels: FloatArray
    """(N, 2) corners of all views, one view after the other [px]"""
    points: FloatArray
    """(N, 3) on the board [m]"""
    ends: IntArray
    """(n + 1,): view i has the rows ends[i]:ends[i+1]"""

    def rows(self, camera_T_board: RigidTransform) -> FloatArray:
        """Return the board's points (N, 3) in the camera, from its pose in each view."""
        counts = np.diff(self.ends)
        R = np.repeat(camera_T_board.as_matrix()[..., :3, :3], counts, axis=0)
        t = np.repeat(camera_T_board.translation, counts, axis=0)
        return np.asarray((R @ self.points[:, :, None])[:, :, 0] + t)

    def sums(self, values: FloatArray) -> FloatArray:
        """Return each view's sum (n, …) of the values (N, …) of its rows."""
        return np.add.reduceat(values, self.ends[:-1])


@dataclass(frozen=True, eq=False)
class LoopState:
    """Both unknown poses, and what each reported robot pose is off by."""

    flange_T_camera: RigidTransform
    base_T_board: RigidTransform
    offsets: FloatArray
    """(n, 6) Δ of each view: d_t [m], d_r [rad]"""

    def camera_T_board(self, base_T_flange: RigidTransform) -> RigidTransform:
        """Return the board's n poses in the camera that the loop gives."""
        offset = RigidTransform.from_components(
            self.offsets[:, :3], Rotation.from_rotvec(self.offsets[:, 3:])
        )
        return (base_T_flange * offset * self.flange_T_camera).inv() * self.base_T_board

    def stepped(self, step: FloatArray, offsets: FloatArray) -> LoopState:
        """Return the state after a step (12,) of X and Z, with these offsets."""
        return LoopState(_moved(self.flange_T_camera, step[:6]), _moved(self.base_T_board, step[6:]), offsets)


BOARD_SIZE = 12
"""The place of the logarithm of the board's size among the unknowns: behind the step of X and Z"""


@dataclass(frozen=True, eq=False)
class LinearLoop:
    """What n views say: q = M θ + Δ + ε, ε ~ N(0, C), with θ the step (12,) of X and Z.

    q is the Δ with which the view's own reprojection error is least.
    """

    q: FloatArray
    """(n, 6)"""
    M: FloatArray
    """(n, 6, 12)"""
    C: FloatArray
    """(n, 6, 6)"""
    by_scale: FloatArray
    """(n, 6) the column of M that the logarithm of the board's size would have"""
    by_pixel: FloatArray
    """(N, 6, 2) what a displaced corner does to its view's q [1/px]"""
    by_camera: FloatArray
    """(f, n, 6) what independent errors of the camera do to q, the same in all views; f = 0: it is exact"""

    def with_scale(self) -> LinearLoop:
        """Return the same with the board's size, in place `BOARD_SIZE`, as a 13th unknown."""
        return replace(self, M=np.concatenate([self.M, self.by_scale[:, :, None]], axis=2))

    def with_camera(self, camera: CentralModel, views: SeenViews, state: LoopState) -> LinearLoop:
        """Return the same with the errors that the camera states of itself."""
        points = views.rows(state.camera_T_board(views.base_T_flange))
        moves = CameraMoves.of(camera, points[:, None], views.pixels).pixels
        each = np.einsum("nic,fnc->nfi", self.by_pixel, moves, optimize=True)
        return replace(self, by_camera=np.swapaxes(views.sums(each), 0, 1))


def linearise(camera: CentralModel, views: SeenViews, state: LoopState, sigma_px: float) -> LinearLoop | None:
    """Return what the views say near ``state``, or None where one of them does not see the board there.

    Corners count by Cauchy's loss with the standard deviation ``sigma_px`` of a coordinate.
    """
    camera_T_board = state.camera_T_board(views.base_T_flange)
    points = views.rows(camera_T_board)
    pixels, by_point, valid = camera.project_jacobian(points)
    if not valid.all():
        return None
    errors = (pixels - views.pixels) / sigma_px
    weights = 1.0 / (1.0 + (errors**2).sum(axis=1) / _CAUCHY**2)
    J = np.concatenate([by_point, np.cross(points[:, None, :], by_point)], axis=2) / sigma_px
    weighted = np.swapaxes(J, 1, 2) * weights[:, None, None]
    spread = np.linalg.inv(views.sums(weighted @ J))
    best = -spread @ views.sums(weighted @ errors[:, :, None])
    by_X, by_Z, by_offset = _twists(state, camera_T_board)
    back = np.linalg.inv(by_offset)
    by_pixel = np.repeat(back @ spread, np.diff(views.ends), axis=0) @ weighted / sigma_px
    return LinearLoop(
        q=state.offsets + (back @ best)[:, :, 0],
        M=back @ np.concatenate([by_X, by_Z], axis=2),
        C=back @ spread @ np.swapaxes(back, 1, 2),
        # seen at the same pixels, a larger board is further away; the loop knows how far it is
        by_scale=(back[:, :, :3] @ -camera_T_board.translation[:, :, None])[:, :, 0],
        by_pixel=by_pixel,
        by_camera=np.empty((0, len(state.offsets), 6)),
    )


def _twists(state: LoopState, camera_T_board: RigidTransform) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return by which twist (v, ω) of the board in the camera X, Z and Δ move it, (n, 6, 6) each."""
    n = len(state.offsets)
    camera_R_flange = state.flange_T_camera.as_matrix()[..., :3, :3].T
    camera_R_board = camera_T_board.as_matrix()[..., :3, :3]
    by_X, by_Z, by_offset = np.zeros((3, n, 6, 6))
    by_X[:, :3, :3], by_X[:, 3:, 3:] = -camera_R_flange, -np.eye(3)
    by_Z[:, :3, :3] = camera_R_board @ state.base_T_board.as_matrix()[..., :3, :3].T
    by_Z[:, :3, 3:] = _cross_matrices(camera_T_board.translation) @ camera_R_board
    by_Z[:, 3:, 3:] = camera_R_board
    by_offset[:, :3, :3] = -camera_R_flange @ Rotation.from_rotvec(-state.offsets[:, 3:]).as_matrix()
    by_offset[:, :3, 3:] = (
        _cross_matrices(camera_R_flange @ state.flange_T_camera.translation) @ camera_R_flange
    )
    by_offset[:, 3:, 3:] = -camera_R_flange
    return by_X, by_Z, by_offset


def _moved(pose: RigidTransform, step: FloatArray) -> RigidTransform:
    """Return the pose with t + step_t and R exp(step_r)."""
    turn = Rotation.from_rotvec(step[3:])
    return RigidTransform.from_components(pose.translation + step[:3], pose.rotation * turn)


def _cross_matrices(a: FloatArray) -> FloatArray:
    """Return the matrices (…, 3, 3) with which a (…, 3) is multiplied: matrix @ b = a × b."""
    return np.cross(a[..., None, :], np.eye(3), axisb=-1).swapaxes(-1, -2)
