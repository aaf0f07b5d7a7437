"""Points found in one image, with what is estimated of them."""

from __future__ import annotations

from dataclasses import dataclass

from scipy.spatial.transform import RigidTransform

from omniservo.geometry.arrays import BoolArray, FloatArray


@dataclass(frozen=True, eq=False)
class SeenPoints:
    """Points found in one image, with what is estimated of them."""

    time: float
    """of its exposure, on the robot's clock [s]"""
    pixels: FloatArray
    """(n, 2) [px]"""
    valid: BoolArray
    """(n,) those that were found"""
    points: FloatArray
    """(n, 3) in the initial camera frame, as estimated now [m]"""
    initial_T_camera: RigidTransform
    """pose of the image, as estimated now"""
    time_sigma: float = 0.0
    """standard deviation of ``time`` [s]"""
