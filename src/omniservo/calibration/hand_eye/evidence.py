"""Why there is no hand-eye calibration: what the views lack, named."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.calibration.hand_eye.hand_eye import HandEyeStatus
from omniservo.calibration.hand_eye.start import HandEyeStart, closed_form, start
from omniservo.geometry.arrays import FloatArray

LEAST_VIEWS = 4
"""three determine both poses, and leave next to nothing that says how sure they are"""

_TURNED = math.radians(2.0)
"""an axis that all rotations move by less than this, root mean square, counts as not moved"""

_MISFIT = 0.1
"""a start whose median view is off by more, angle [rad] plus distance over the board's distance, is none"""

_BETTER = 3.0
"""times that inverted poses must fit better to be what was meant"""

_MANY, _BETTER_OF_MANY = 6, 1.25
"""views from which on so many times are enough: the median view is then none that three views can fit"""

_OPEN = (0.05, math.radians(5.0))
"""standard deviations [m], [rad] beyond which nothing is determined, or robot and images disagree"""


@dataclass(frozen=True)
class Refusal:
    """Why there is no result."""

    status: HandEyeStatus
    message: str


def too_few(views: int, reasons: Sequence[str]) -> Refusal | None:
    """Refuse fewer than `LEAST_VIEWS` usable views; ``reasons`` are those of all, "" of the usable ones."""
    if views >= LEAST_VIEWS:
        return None
    words = f"{views} of {len(reasons)} views can be used; at least {LEAST_VIEWS} are needed"
    counted = Counter(reason for reason in reasons if reason).most_common(1)
    if counted:
        words += f"; {counted[0][1]} of them: {counted[0][0]}"
    return Refusal("too_few_views", words)


def judge_rotations(base_T_flange: Sequence[RigidTransform]) -> Refusal | None:
    """Refuse robot poses that do not turn the flange about two axes.

    (R − I) t = … is what the views say about the camera's place t, R being the flange's rotation between two
    of them: along an axis that no R moves, they say nothing.
    """
    R = np.stack([pose.as_matrix()[..., :3, :3] for pose in base_T_flange])
    i, j = np.triu_indices(len(R), k=1)
    moved_by = np.swapaxes(R[i], 1, 2) @ R[j] - np.eye(3)
    squares, axes = np.linalg.eigh(np.einsum("nki,nkj->ij", moved_by, moved_by) / len(i))
    if squares[2] < _TURNED**2:
        words = f"the flange turned by less than {math.degrees(_TURNED):g}° between all poses"
        return Refusal("no_rotation", f"{words}; turn it about two axes")
    if squares[0] < _TURNED**2:
        axis = _spelled(axes[:, 0] * np.sign(axes[np.argmax(np.abs(axes[:, 0])), 0]))
        words = (
            f"all poses turn the flange about one axis, {axis} in its frame: where the camera sits along it"
        )
        return Refusal("one_axis", f"{words} is not observable; tilt the flange about a second axis too")
    return None


def judge_start(
    first: HandEyeStart, base_T_flange: RigidTransform, poses: Sequence[Sequence[RigidTransform]]
) -> Refusal | None:
    """Refuse a start that most views do not agree with, or that inverted poses would beat.

    Few views may agree by chance with a start of the wrong kind, so inverted poses are always tried.
    """
    better = _BETTER if len(poses) < _MANY else _BETTER_OF_MANY
    other = start(base_T_flange.inv(), poses)
    if other.misfit * better < first.misfit and other.misfit < _MISFIT:
        words = "views agree once every robot pose is inverted: flange_T_base seems given, base_T_flange is"
        return Refusal(
            "poses_inverted",
            f"{words} needed (or the camera stands still and the board is on the flange: its pose is found by"
            " giving flange_T_base, and called flange_T_camera then)",
        )
    if first.misfit < _MISFIT:
        return None
    return Refusal("views_disagree", _disagreement(base_T_flange, poses))


def judge_fit(sigmas: tuple[float, float], covariance: FloatArray) -> Refusal | None:
    """Refuse a fit that says nothing, or in which the robot is off by more than robots are."""
    for size, bound, unit in zip(sigmas, _OPEN, ("mm", "°"), strict=True):
        if size > bound:
            words = f"robot and pictures disagree by {_in(unit, size)} per axis (legal: {_in(unit, bound)})"
            return Refusal("views_disagree", f"{words}: {_CAUSES}")
    deviations = np.sqrt([np.linalg.eigvalsh(covariance[k : k + 3, k : k + 3])[-1] for k in (0, 3)])
    for size, bound, unit in zip(deviations, _OPEN, ("mm", "°"), strict=True):
        if size > bound:
            words = f"the camera's pose is left open by {_in(unit, float(size))} (legal: {_in(unit, bound)})"
            return Refusal("not_determined", f"{words}; more views with larger rotations are needed")
    return None


_CAUSES = (
    "poses of other pictures, or of another frame; lengths in another unit than m; a board of another size?"
)


def _disagreement(base_T_flange: RigidTransform, poses: Sequence[Sequence[RigidTransform]]) -> str:
    """Say whether the rotations alone agree: then it is lengths that do not."""
    camera_T_board = RigidTransform.concatenate([own[0] for own in poses])
    X = closed_form(base_T_flange.as_matrix(), camera_T_board.as_matrix())
    flange_T_camera = RigidTransform.from_matrix(X)
    boards = (base_T_flange * flange_T_camera * camera_T_board).rotation
    turned = float(np.median((boards.mean().inv() * boards).magnitude()))
    if turned < _MISFIT / _BETTER:
        factor = _length_factor(base_T_flange, flange_T_camera, camera_T_board)
        return (
            "the views' rotations agree, their places do not, unless the robot's lengths are multiplied by"
            f" {factor:.3g}: are they in m, and is the board of that size?"
        )
    return f"the board of the median view is {_in('°', turned)} off the others': {_CAUSES}"


def _length_factor(
    base_T_flange: RigidTransform, flange_T_camera: RigidTransform, camera_T_board: RigidTransform
) -> float:
    """Return s of the best s t_A + R_A (R_X t_B + t_X) = t_Z, linear in s, t_X and t_Z."""
    R = base_T_flange.as_matrix()[..., :3, :3]
    seen = base_T_flange.rotation.apply(flange_T_camera.rotation.apply(camera_T_board.translation))
    rows = np.concatenate(
        [base_T_flange.translation[:, :, None], R, -np.broadcast_to(np.eye(3), R.shape)], axis=2
    )
    return float(np.linalg.lstsq(rows.reshape(-1, 7), -seen.ravel(), rcond=None)[0][0])


def _in(unit: str, size: float) -> str:
    return f"{1e3 * size:.3g} mm" if unit == "mm" else f"{math.degrees(size):.3g}°"


def _spelled(axis: FloatArray) -> str:
    return f"({', '.join(f'{x:.2f}' for x in axis + 0.0)})"
