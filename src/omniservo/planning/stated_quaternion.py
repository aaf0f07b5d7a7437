"""A rotation as the fields of a file state it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from scipy.spatial.transform import Rotation

from omniservo.errors import InputError
from omniservo.geometry.arrays import FloatArray, frozen, owned
from omniservo.planning.checks import bounded_array, unit_vector

ROTATION_FIELDS = ("quaternion", "rotation_vector")


def stated_quaternion(fields: Mapping[str, Any], place: str = "") -> FloatArray:
    """Return the unit quaternion (x, y, z, w) of ``quaternion`` or ``rotation_vector`` [rad], read-only.

    Where neither stands in ``fields`` nothing is turned. ``place`` stands before the field's name.

    Raises:
        InputError: both, not finite, beyond 1e6, or a quaternion whose length is not 1 within 1e-6.
    """
    given = [name for name in ROTATION_FIELDS if name in fields]
    if len(given) > 1:
        raise InputError(f"{place}quaternion, rotation_vector: both given; legal: one of the two")
    if given == ["rotation_vector"]:
        vector = bounded_array(f"{place}rotation_vector", fields["rotation_vector"], (3,))
        return frozen(Rotation.from_rotvec(owned(vector)).as_quat())
    return unit_vector(f"{place}quaternion", fields.get("quaternion", (0.0, 0.0, 0.0, 1.0)), 4)
