"""A camera as ROS 2 states it."""

from __future__ import annotations

import numpy as np

from omniservo.camera_files.formats.ros import lens_of
from omniservo.cameras import UnifiedCamera
from omniservo.cameras.models import CentralModel, Pinhole
from omniservo.errors import InputError
from omniservo.ros_messages.messages import CameraInfoMessage, HeaderMessage


def camera_info(camera: CentralModel, header: HeaderMessage) -> CameraInfoMessage | None:
    """Return the message; None where ROS has no name for the camera's model: one with ξ, say."""
    if isinstance(camera, UnifiedCamera) and camera.xi == 0.0 and camera.skew == 0.0:
        camera = Pinhole(
            camera.fx, camera.fy, camera.cx, camera.cy, camera.width, camera.height,
            distortion=camera.distortion,
        )  # fmt: skip
    try:
        lens, kind, coefficients = lens_of(camera)
    except InputError:
        return None
    k = np.array([[lens.fx, 0.0, lens.cx], [0.0, lens.fy, lens.cy], [0.0, 0.0, 1.0]])
    return CameraInfoMessage(
        header,
        height=camera.height,
        width=camera.width,
        distortion_model=kind,
        d=np.array(coefficients),
        k=k.ravel(),
        r=np.eye(3).ravel(),
        p=np.hstack([k, np.zeros((3, 1))]).ravel(),
    )
