"""Whether a task's target can be seen at all: geometry, before any image is searched."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.errors import InputError
from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.runs.feature_kind_of import feature_kind_of
from omniservo.runs.robot_cell import RobotCell
from omniservo.tasks import Task
from omniservo.tasks.target import Dot, TargetSection, TexturedFace

_GRID = 8
"""points along a side of a textured face; a part of a face is enough"""


@dataclass(frozen=True)
class _Parts:
    """What of a target must be seen as a whole, and how much of it."""

    outlines: FloatArray
    """(k, m, 3) points of each part [m]"""
    name: str
    least: int


def require_in_view(task: Task, initial_T_camera: RigidTransform, where: str) -> None:
    """Refuse a pose from which the lens cannot show enough of the target, whatever stands in between.

    Args:
        task: its target and camera.
        initial_T_camera: where the image is taken.
        where: the image's name in the message.

    Raises:
        InputError: too few dots or tags, or too little of the textured faces, project into the image.
    """
    parts = _parts(task)
    shown = int(_in_image(task, parts, initial_T_camera).sum())
    if shown < parts.least:
        raise InputError(
            f"{task.name}: {shown} of the target's {len(parts.outlines)} {parts.name} lie wholly in {where} "
            f"of this camera ({task.camera.width}×{task.camera.height} px); at least {parts.least} are needed"
        )


def require_unhidden(task: Task, cell: RobotCell, joints: FloatArray, where: str) -> None:
    """Refuse a configuration of the arm from which too much of the target is hidden by something in between.

    On a real robot only the image itself can tell.

    Args:
        task: its target and camera.
        cell: the arm, and what stands around it.
        joints: (n,) of the arm where the image is taken [rad].
        where: the image's name in the message.

    Raises:
        InputError: of the dots, tags or textured faces in the image too few are met first by the rays of
            sight; it names what is.
    """
    if cell.truth is None:
        return
    parts = _parts(task)
    world_T_initial = task.start.world_T_camera.transform
    shown = _in_image(task, parts, world_T_initial.inv() * cell.scene.world_T_camera(joints))
    points = world_T_initial.apply(parts.outlines.reshape(-1, 3))
    hiders = cell.truth.hidden_by(joints, points)
    blocked = np.array([name is not None for name in hiders])
    hidden = blocked.reshape(parts.outlines.shape[:2]) & shown[:, None]
    seen = int((shown & ~hidden.any(1)).sum())
    if hidden.any() and seen < parts.least:
        names = Counter(str(name) for name, hides in zip(hiders, hidden.flat, strict=True) if hides)
        raise InputError(
            f"{task.name}: {seen} of the target's {len(shown)} {parts.name} can be seen in {where}; at least "
            f"{parts.least} are needed; hidden by {', '.join(name for name, _ in names.most_common())}"
        )


def _in_image(task: Task, parts: _Parts, initial_T_camera: RigidTransform) -> BoolArray:
    """(k,) whether every point of a part projects into the image, whatever stands in between."""
    pixels, valid = task.camera.project(initial_T_camera.inv().apply(parts.outlines.reshape(-1, 3)))
    seen = valid & task.camera.in_image(np.where(valid[:, None], pixels, -1e3))
    wholly: BoolArray = seen.reshape(parts.outlines.shape[:2]).all(1)
    return wholly


def _parts(task: Task) -> _Parts:
    target, least = task.target, feature_kind_of(task).least
    if target.tags is not None:
        corners = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])
        tags = np.array([tag.transform.apply(0.5 * tag.edge * corners) for tag in target.tags.panels])
        return _Parts(tags, "tags", least // 4)
    if target.textures:
        points = np.concatenate([_grid(face) for face in target.textures])
        return _Parts(points[:, None], "sample points on textured faces", least)
    return _Parts(_rims(target), "dots", least)


def _grid(face: TexturedFace) -> FloatArray:
    """Return points (_GRID², 3) [m] spread over a face."""
    share = (np.arange(_GRID) + 0.5) / _GRID - 0.5
    x, y = np.meshgrid(share * face.size[0], share * face.size[1])
    return np.asarray(face.transform.apply(np.column_stack((x.ravel(), y.ravel(), np.zeros(x.size)))))


def _rims(target: TargetSection) -> FloatArray:
    return np.array([_rim(dot, target.dot_radius or 0.0) for dot in target.dots])


def _rim(dot: Dot, radius: float) -> FloatArray:
    """Return points (16, 3) [m] round a dot's edge."""
    normal = np.asarray(dot.normal)
    side = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    side /= np.linalg.norm(side)
    angle = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)[:, None]
    across = np.cross(normal, side)
    return np.asarray(np.asarray(dot.center) + radius * (np.cos(angle) * side + np.sin(angle) * across))
