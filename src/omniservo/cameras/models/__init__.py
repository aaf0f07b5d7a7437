"""Every other central camera model, and what they all offer."""

from collections.abc import Mapping
from typing import Any

from omniservo.cameras.models.central_model import CentralModel
from omniservo.cameras.models.double_sphere import DoubleSphere
from omniservo.cameras.models.equirectangular import Equirectangular
from omniservo.cameras.models.extended_unified import ExtendedUnified
from omniservo.cameras.models.kannala_brandt import KannalaBrandt
from omniservo.cameras.models.lens_model import LensModel
from omniservo.cameras.models.ocam_polynomial import OcamPolynomial
from omniservo.cameras.models.pinhole import Pinhole
from omniservo.cameras.unified_camera import UnifiedCamera
from omniservo.errors import InputError, spelled

MODEL_CLASSES: tuple[type[LensModel], ...] = (
    KannalaBrandt,
    ExtendedUnified,
    DoubleSphere,
    OcamPolynomial,
    Pinhole,
    Equirectangular,
)

__all__ = [
    "MODEL_CLASSES",
    "MODEL_NAMES",
    "CentralModel",
    "DoubleSphere",
    "Equirectangular",
    "ExtendedUnified",
    "KannalaBrandt",
    "OcamPolynomial",
    "Pinhole",
    "camera_from_dict",
]

MODEL_NAMES = ("unified", *(kind.model for kind in MODEL_CLASSES))
"""what "model" is in `to_dict`"""


def camera_from_dict(fields: Mapping[str, Any], source: str = "camera") -> CentralModel:
    """Return the camera that ``to_dict`` of any model gave.

    Args:
        fields: "model" and the model's own fields.
        source: stands first in messages.

    Raises:
        InputError: an unknown model, or a field is missing, unknown or not legal.
    """
    model = fields.get("model") if isinstance(fields, Mapping) else None
    for kind in MODEL_CLASSES:
        if model == kind.model:
            return kind.from_dict(fields, source)
    if isinstance(fields, Mapping) and "model" in fields and model != "unified":
        raise InputError(f"{source}: model: {spelled(model)} given; legal: {', '.join(MODEL_NAMES)}")
    return UnifiedCamera.from_dict(fields, source)
