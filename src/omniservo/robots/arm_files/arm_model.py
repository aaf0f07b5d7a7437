"""An arm's file made ready: MuJoCo's model of it, its limits, and the flange that carries the camera."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

from scipy.spatial.transform import RigidTransform

from omniservo.geometry.arrays import FloatArray

SHOWN_GROUP = 1
"""MuJoCo geom group of the shapes that the arm is seen by."""

HIDDEN_GROUP = 3
"""MuJoCo geom group of shapes that stand for others in contacts, and are not seen."""


@dataclass(frozen=True)
class ArmModel:
    """Everything that a file says of an arm, checked."""

    spec: Any
    """MuJoCo's MjSpec: the arm alone, with drives, without gravity's pull; the file's world is its base"""
    model: Any
    """the same compiled"""
    flange: str
    """name of the site or link that carries the camera"""
    flange_body: str
    """the link that the flange is fixed to"""
    body_T_flange: RigidTransform
    speed: FloatArray
    """(n,) [rad/s]"""
    acceleration: FloatArray
    """(n,) [rad/s²]"""
    notices: tuple[str, ...]
    """what of the file was left out, put in or assumed"""

    @cached_property
    def touched_spec(self) -> Any:
        """The same without the shapes that are only seen."""
        spec = self.spec.copy()
        for geom in spec.geoms:
            if not (geom.contype or geom.conaffinity):
                spec.delete(geom)
        touched = {geom.meshname for geom in spec.geoms}
        for mesh in spec.meshes:
            if mesh.name not in touched:
                spec.delete(mesh)
        return spec
