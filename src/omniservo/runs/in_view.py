"""Whether a task's target is in the camera's picture at all: geometry, before any picture is searched."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.errors import InputError
from omniservo.geometry.arrays import FloatArray
from omniservo.perception.feature_kind import LEAST_FEATURES
from omniservo.tasks import Task
from omniservo.tasks.target import Dot


def require_in_view(task: Task, initial_T_camera: RigidTransform, where: str) -> None:
    """Refuse a pose from which the lens cannot show enough dots, whatever stands in between.

    Args:
        task: its target and camera.
        initial_T_camera: where the picture is taken.
        where: the picture's name in the message.

    Raises:
        InputError: fewer than eight dots project wholly into the camera's image.
    """
    rims = np.array([_rim(dot, task.target.dot_radius or 0.0) for dot in task.target.dots])
    pixels, valid = task.camera.project(initial_T_camera.inv().apply(rims.reshape(-1, 3)))
    seen = valid & task.camera.in_image(np.where(valid[:, None], pixels, -1e3))
    shown = seen.reshape(len(rims), -1).all(1)
    if shown.sum() < LEAST_FEATURES:
        raise InputError(
            f"{task.name}: {int(shown.sum())} of the target's {len(rims)} dots lie wholly in {where} of this "
            f"camera ({task.camera.width}×{task.camera.height} px); at least {LEAST_FEATURES} are needed"
        )


def _rim(dot: Dot, radius: float) -> FloatArray:
    """Return points (16, 3) [m] round a dot's edge."""
    normal = np.asarray(dot.normal)
    side = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    side /= np.linalg.norm(side)
    angle = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)[:, None]
    across = np.cross(normal, side)
    return np.asarray(np.asarray(dot.center) + radius * (np.cos(angle) * side + np.sin(angle) * across))
