"""What unit the file of a mesh or a cloud is in."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from omniservo.errors import InputError, spelled
from omniservo.files import UNITS
from omniservo.geometry.arrays import finite_number
from omniservo.planning.checks import LARGEST

UNIT_FIELDS = ("units", "scale")
"""Fields beside ``file``: the unit of its coordinates by name, or in metres."""


def file_unit(fields: Mapping[str, Any]) -> float | None:
    """Return one unit of the file that ``fields`` name [m]; None where they do not say.

    Raises:
        InputError: both ``units`` and ``scale``, a unit that is not known, or a scale that is not positive.
    """
    units, scale = (fields.get(name) for name in UNIT_FIELDS)
    if units is not None and scale is not None:
        raise InputError("units, scale: both given; legal: one of the two")
    if scale is not None:
        return finite_number("scale", scale, above=0.0, maximum=LARGEST)
    if units is None:
        return None
    if not isinstance(units, str) or units not in UNITS["length"]:
        raise InputError(f"units: {spelled(units)} given; legal: {', '.join(UNITS['length'])}")
    return UNITS["length"][units]
