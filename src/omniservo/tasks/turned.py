"""How a thing is turned."""

from __future__ import annotations

import math

from pydantic import FiniteFloat, model_validator
from scipy.spatial.transform import Rotation

from omniservo.planning.checks import NEAR_UNIT
from omniservo.tasks.quantities import Angle
from omniservo.tasks.section import Section


class Turned(Section):
    """A rotation: a unit quaternion or a rotation vector; without either nothing is turned."""

    quaternion: tuple[FiniteFloat, FiniteFloat, FiniteFloat, FiniteFloat] | None = None
    """(x, y, z, w), unit within 1e-6"""
    rotation_vector: tuple[Angle, Angle, Angle] | None = None
    """axis times angle [rad]"""

    @model_validator(mode="after")
    def _one_rotation(self) -> Turned:
        if self.quaternion is not None and self.rotation_vector is not None:
            raise ValueError("give quaternion or rotation_vector, not both")
        if self.quaternion is not None and abs(math.hypot(*self.quaternion) - 1.0) > NEAR_UNIT:
            raise ValueError(f"quaternion has norm {math.hypot(*self.quaternion):g}; it must be 1")
        return self

    @property
    def rotation(self) -> Rotation:
        """It as SciPy's Rotation."""
        if self.quaternion is not None:
            return Rotation.from_quat(self.quaternion)
        return Rotation.from_rotvec(self.rotation_vector or (0.0, 0.0, 0.0))
