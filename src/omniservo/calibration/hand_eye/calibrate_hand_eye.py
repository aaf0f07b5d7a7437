"""Hand-eye calibration: flange_T_camera from robot poses and what the camera saw of a board at each."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import RigidTransform

from omniservo.calibration.hand_eye.evidence import (
    LEAST_VIEWS,
    Refusal,
    judge_fit,
    judge_rotations,
    judge_start,
    too_few,
)
from omniservo.calibration.hand_eye.hand_eye import DISPUTED, HandEye, HandEyeView
from omniservo.calibration.hand_eye.loop import BOARD_SIZE, LoopState, linearise
from omniservo.calibration.hand_eye.robot_noise import LoopSolution, solve_loop
from omniservo.calibration.hand_eye.robot_poses import checked_poses
from omniservo.calibration.hand_eye.seen_view import SeenView, together, usable_views
from omniservo.calibration.hand_eye.start import HandEyeStart, start
from omniservo.calibration.hand_eye.wrong_views import robust_step
from omniservo.cameras.models import CentralModel
from omniservo.geometry.arrays import BoolArray, FloatArray, owned
from omniservo.renamed import renamed_arguments

_ROBUST_STEPS = 6
_STEPS = 30
_ENOUGH = 5e-3
"""converged: a step is smaller than this part of its standard deviation"""

_LEAST_NOISE_PX = 1e-3


@dataclass(frozen=True, eq=False)
class _Fit:
    views: list[SeenView]
    state: LoopState
    solution: LoopSolution
    noise_px: float
    sized: LoopSolution
    """the same with the board's size as a 13th unknown"""

    @property
    def log_scale(self) -> tuple[float, float]:
        """Of the board's size over the stated one, and its standard deviation."""
        variance = self.sized.covariance[BOARD_SIZE, BOARD_SIZE]
        return float(self.sized.step[BOARD_SIZE]), math.sqrt(variance)

    @property
    def covariance(self) -> FloatArray:
        """(12, 12) of both poses; where the board's size is disputed it reaches to the other size's."""
        log_scale, sigma = self.log_scale
        if abs(log_scale) <= DISPUTED * sigma:
            return self.solution.covariance
        off = self.sized.step[:BOARD_SIZE] - self.solution.step
        return self.solution.covariance + np.outer(off, off)


@renamed_arguments(base_T_tool="base_T_flange")
def calibrate_hand_eye(
    camera: CentralModel,
    base_T_flange: RigidTransform | Sequence[RigidTransform] | npt.ArrayLike,
    image_points: Sequence[npt.ArrayLike],
    object_points: Sequence[npt.ArrayLike],
    *,
    turns: Sequence[RigidTransform] = (),
) -> HandEye:
    """Return flange_T_camera and base_T_board that explain the corners of a board that stands still.

    In every view, camera_T_board = flange_T_camera⁻¹ · (base_T_flange Δ)⁻¹ · base_T_board, with Δ the robot's
    own error. The start is a closed form of AX = XB (Park & Martin 1994; Daniilidis 1999) that most views
    agree with. Then

        Σ ρ(‖π(camera_T_board p) − u‖²/σ²) + Σ ‖d_t‖²/σ_t² + ‖d_r‖²/σ_r²

    is minimised over both poses and all Δ = (d_t, d_r), ρ being Cauchy's loss. The sizes σ_t, σ_r of the
    robot's errors come from the views (`robot_noise`), and so does the covariance: views, not corners, are
    independent, and what the camera states of its own error is the same in all of them. Views that no such
    error explains are left out, with the reason.

    Args:
        camera: took the images.
        base_T_flange: n poses as the robot reports them: RigidTransform, several in a row, or (n, 4, 4) [m].
        image_points: of each view (k, 2) [px]; an empty one where the board was not found.
        object_points: of each view (k, 3) [m] the same points on the board.
        turns: motions of the board onto itself, where its first corner was chosen for each view alone.

    Raises:
        InputError: lists of different lengths, other shapes, numbers that are not finite, a matrix that is no
            pose, a corner outside the camera's domain; the message names view and row.
    """
    started = time.perf_counter()
    poses = checked_poses(base_T_flange)
    views, reasons = usable_views(camera, poses, image_points, object_points, turns)
    found = _fit(camera, views, reasons, turns)
    seconds = time.perf_counter() - started
    if isinstance(found, Refusal):
        return _without_pose(found, views, reasons, seconds)
    return _result(camera, found, views, reasons, seconds)


def _fit(
    camera: CentralModel, views: list[SeenView], reasons: list[str], turns: Sequence[RigidTransform]
) -> _Fit | Refusal:
    """Return the adjusted loop; views that are wrong get a reason."""
    refusal = too_few(len(views), reasons) or judge_rotations([view.base_T_flange for view in views])
    if refusal is not None:
        return refusal
    base_T_flange = RigidTransform.concatenate([view.base_T_flange for view in views])
    first = start(base_T_flange, [view.poses for view in views])
    refusal = judge_start(first, base_T_flange, [view.poses for view in views])
    if refusal is not None:
        return refusal
    views = [view.with_pose(int(k), turns) for view, k in zip(views, first.chosen, strict=True)]
    noise_px = max(float(np.median([view.noise_px for view in views])), _LEAST_NOISE_PX)
    found = _agreed(camera, views, first, noise_px)
    if isinstance(found, Refusal):
        return found
    state, wrong = found
    wrong &= len(views) > LEAST_VIEWS  # of the least number none can be spared: a wrong one shows in the σ
    for view, is_wrong in zip(views, wrong, strict=True):
        if is_wrong:
            reasons[view.number] = (
                "its pose and its picture do not belong together: the other views agree without it"
            )
    views = [view for view, is_wrong in zip(views, wrong, strict=True) if not is_wrong]
    refusal = too_few(len(views), reasons) or judge_rotations([view.base_T_flange for view in views])
    return refusal or _adjusted(camera, views, replace(state, offsets=state.offsets[~wrong]), noise_px)


def _agreed(
    camera: CentralModel, views: list[SeenView], first: HandEyeStart, noise_px: float
) -> tuple[LoopState, BoolArray] | Refusal:
    """Return what most views agree with, and which (n,) are wrong beside that.

    Each is linearised where it saw the board itself: the loop may put a wrong view's board out of sight.
    """
    seen = together(views)
    own = RigidTransform.concatenate([view.poses[0] for view in views])
    X, Z = first.flange_T_camera, first.base_T_board
    for _ in range(_ROBUST_STEPS):
        offset = seen.base_T_flange.inv() * Z * (X * own).inv()
        state = LoopState(X, Z, np.hstack([offset.translation, offset.rotation.as_rotvec()]))
        linear = linearise(camera, seen, state, noise_px)
        if linear is None:
            return Refusal("not_converged", "a corner lies at the rim of the camera's field")
        step, wrong = robust_step(linear)
        moved = state.stepped(step, state.offsets)
        X, Z = moved.flange_T_camera, moved.base_T_board
    return moved, wrong


def _adjusted(
    camera: CentralModel, views: list[SeenView], state: LoopState, noise_px: float
) -> _Fit | Refusal:
    seen = together(views)
    for _ in range(_STEPS):
        linear = linearise(camera, seen, state, noise_px)
        if linear is None:
            break
        solution = solve_loop(linear)
        if np.abs(solution.step / np.sqrt(np.diag(solution.covariance))).max() < _ENOUGH:
            # what the camera is off by weighs the views otherwise: the last step counts it, as the covariance
            linear = linear.with_camera(camera, seen, state)
            last = solve_loop(linear)
            state = state.stepped(last.step, last.offsets)
            fit = _Fit(views, state, last, noise_px, solve_loop(linear.with_scale()))
            return judge_fit(solution.sigmas, fit.covariance) or fit
        state = state.stepped(solution.step, solution.offsets)
    return Refusal("not_converged", f"no minimum was found in {_STEPS} steps")


def _result(
    camera: CentralModel, fit: _Fit, views: list[SeenView], reasons: list[str], seconds: float
) -> HandEye:
    kept = {view.number: view for view in fit.views}
    told = []
    for number, reason in enumerate(reasons):
        view = kept.get(number) or next((v for v in views if v.number == number), None)
        told.append(_told(camera, fit.state, view, reason))
    return HandEye(
        status="ok",
        message="",
        flange_T_camera=fit.state.flange_T_camera,
        base_T_board=fit.state.base_T_board,
        covariance=owned(fit.covariance[:6, :6]),
        board_covariance=owned(fit.covariance[6:, 6:]),
        robot_position_m=fit.solution.sigmas[0],
        robot_rotation_rad=fit.solution.sigmas[1],
        noise_px=fit.noise_px,
        board_scale=math.exp(fit.log_scale[0]),
        board_scale_sigma=math.exp(fit.log_scale[0]) * fit.log_scale[1],
        views=tuple(told),
        seconds=seconds,
    )


def _told(camera: CentralModel, state: LoopState, view: SeenView | None, reason: str) -> HandEyeView:
    """Return what is left over in a view."""
    if view is None:
        return _unseen(reason)
    base_T_board = view.base_T_flange * state.flange_T_camera * view.poses[0]
    loop = (view.base_T_flange * state.flange_T_camera).inv() * state.base_T_board
    return HandEyeView(
        used=not reason,
        reason=reason,
        position_m=float(np.linalg.norm(base_T_board.translation - state.base_T_board.translation)),
        rotation_rad=float((state.base_T_board.rotation.inv() * base_T_board.rotation).magnitude()),
        own_rms_px=view.own_rms_px,
        pixels=owned(view.pixels),
        loop_px=owned(view.residuals(camera, loop)),
    )


def _unseen(reason: str) -> HandEyeView:
    nothing = np.empty((0, 2))
    return HandEyeView(False, reason, math.nan, math.nan, math.nan, nothing, nothing)


def _without_pose(refusal: Refusal, views: list[SeenView], reasons: list[str], seconds: float) -> HandEye:
    """Return why there is no result; views that saw the board keep what is known of them."""
    seen = {view.number: view for view in views}
    told = []
    for number, reason in enumerate(reasons):
        blank = _unseen(reason or refusal.message)
        if number in seen:
            pixels = owned(seen[number].pixels)
            blank = replace(blank, own_rms_px=seen[number].own_rms_px, pixels=pixels)
        told.append(blank)
    unknown = np.full((6, 6), math.nan)
    return HandEye(
        status=refusal.status,
        message=refusal.message,
        flange_T_camera=None,
        base_T_board=None,
        covariance=unknown,
        board_covariance=unknown,
        robot_position_m=math.nan,
        robot_rotation_rad=math.nan,
        noise_px=math.nan,
        board_scale=math.nan,
        board_scale_sigma=math.nan,
        views=tuple(told),
        seconds=seconds,
    )
