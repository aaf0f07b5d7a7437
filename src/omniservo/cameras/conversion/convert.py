"""The public conversions: to the unified camera that planning works with, and between any two classes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import cast

import numpy as np

from omniservo.cameras.conversion.equivalence import as_unified, from_unified
from omniservo.cameras.conversion.families import FAMILIES
from omniservo.cameras.conversion.fit import field_of, fitted
from omniservo.cameras.conversion.residual import Residual, exact, measured
from omniservo.cameras.model_error import usual_model_error
from omniservo.cameras.models import CentralModel, camera_from_dict
from omniservo.cameras.unified_camera import UnifiedCamera
from omniservo.errors import InputError
from omniservo.geometry.arrays import finite_number

NOTICED_PX = 1e-3
"""A conversion that leaves less is the camera itself."""

MISSED = 1e-3
"""Share of the largest residual that the grids of `measured` may miss; up to 4e-4 were seen."""

_WORTH_A_HINT = 1.0
"""[px]"""

_ANY_PX = 1e9


@dataclass(frozen=True, eq=False)
class Conversion:
    """A unified camera that stands for another model."""

    camera: UnifiedCamera
    """With the largest residual added to the model's ``deviation_px``, rounded up by `MISSED`."""
    residual: Residual
    warnings: tuple[str, ...]
    """What a person must know about both cameras' domains."""
    cost: str = ""
    """What planning pays for it, in words; nothing where it is the model itself"""


def to_unified(model: CentralModel, *, largest_px: float | None = None) -> Conversion:
    """Return the unified camera that ``model`` is, or the nearest one over the field that is used.

    The field that is used is every pixel of the image, outside dead zone and mask, that the model can
    unproject. The nearest camera is the one whose largest residual is smallest; its k1, k2, p1, p2 are free.
    It keeps max_angle, dead zone and mask, sees no farther than the model, and carries what `convert` leaves
    in ``deviation_px``, which plans add to their visibility margin: a point that they keep in its image is in
    the model's, too.

    Raises:
        InputError: the largest residual exceeds ``largest_px`` [px], None: any will do; the message names it.
    """
    if largest_px is None:
        return _nearest(model)
    bound, conversion = finite_number("largest_px", largest_px, minimum=0.0), _nearest(model)
    if not conversion.residual.largest_px <= bound:
        raise InputError(_refusal(model, conversion.camera, conversion.residual, bound))
    return conversion


@lru_cache(maxsize=32)
def _nearest(model: CentralModel) -> Conversion:
    """Return the conversion of another model, however far it is away."""
    found, residual = convert(model, UnifiedCamera, largest_px=_ANY_PX)
    camera = cast(UnifiedCamera, found)
    warnings = model.warnings
    if residual.lost > 0.0 or np.isnan(residual.px).any():
        angle = math.degrees(camera.usable_angle)
        warnings = (
            *warnings,
            f"the unified camera stays one-to-one only up to {angle:.3f} deg from the axis: "
            f"{100.0 * residual.lost:.2g}% of the field is lost",
        )
    return Conversion(camera, residual, warnings, _cost(model, residual))


def _cost(model: CentralModel, residual: Residual) -> str:
    """Return what a conversion costs, and where it costs a pixel and more what a person can do."""
    if residual.largest_px <= NOTICED_PX and residual.lost == 0.0:
        return ""
    words = (
        f"image limits are planned with the unified camera nearest to this {_name(model)} camera: "
        f"{residual}; they keep {residual.largest_px:.3g} px more"
    )
    return words if residual.largest_px < _WORTH_A_HINT else f"{words}. {where_it_ends(model)}"


def convert(
    model: CentralModel, kind: type[CentralModel], *, largest_px: float = 1.0
) -> tuple[CentralModel, Residual]:
    """Return the camera of class ``kind`` that ``model`` is, or the nearest one over the field that is used.

    Its ``deviation_px`` is the model's and the largest residual together: both may point the same way.

    Raises:
        InputError: the class cannot be fitted, or the largest residual exceeds ``largest_px`` [px].
    """
    bound = finite_number("largest_px", largest_px, minimum=0.0)
    if type(model) is kind:
        return model, exact(model)
    unified = as_unified(model)
    same = None if unified is None else from_unified(unified, kind)
    if same is not None:
        return same, exact(model)
    found = [(camera, measured(camera, model)) for camera in _candidates(model, kind)]
    camera, residual = min(found, key=lambda pair: (round(pair[1].lost, 3), pair[1].largest_px))
    if not residual.largest_px <= bound:
        raise InputError(_refusal(model, camera, residual, bound))
    return standing_for(model, camera, residual), residual


def standing_for(model: CentralModel, camera: CentralModel, residual: Residual) -> CentralModel:
    """Return ``camera`` with what it leaves of ``model`` added to the model's own deviation, rounded up.

    By `MISSED`, since the largest residual is the largest of a grid. To the model's error the rms residual is
    added in quadrature.
    """
    total = model.deviation_px + residual.largest_px * (1.0 + MISSED)
    stated = model.model_error
    if residual.rms_px > NOTICED_PX:
        stated = (stated or usual_model_error(0.0, model.width, model.height)).with_residual(residual.rms_px)
    said = None if stated is None else stated.to_dict()
    return camera_from_dict({**camera.to_dict(), "deviation_px": total, "model_error": said})


def _candidates(model: CentralModel, kind: type[CentralModel]) -> list[CentralModel]:
    """Return the fitted cameras of a class, one for each way to fit it."""
    families = [family for family in FAMILIES if family.kind is kind]
    field, cameras, refusals = field_of(model), [], []
    for family in families:
        try:
            cameras.append(fitted(field, family, model))
        except InputError as error:
            refusals.append(error)
    good = [camera for camera in cameras if camera is not None]
    if not good:
        why = f" ({refusals[0]})" if refusals else ""
        raise InputError(f"{kind.__name__}: nothing of this class fits a {_name(model)} camera{why}")
    return good


def _refusal(model: CentralModel, camera: CentralModel, residual: Residual, bound: float) -> str:
    worst = (
        residual.pixels[int(np.nanargmax(residual.px))]
        if np.isfinite(residual.px).any()
        else residual.pixels[0]
    )
    ray = model.unproject(worst)[0]
    angle = math.degrees(math.atan2(math.hypot(ray[0], ray[1]), ray[2]))
    return (
        f"camera: the nearest {_name(camera)} camera leaves {residual.largest_px:.3g} px "
        f"({math.degrees(residual.largest_rad):.3g} deg) of this {_name(model)} camera, at pixel "
        f"({worst[0]:.0f}, {worst[1]:.0f}), {angle:.1f} deg from the axis; legal: at most {bound:g} px. "
        f"{where_it_ends(model)}; or allow more: --largest-px PX, largest_px= (omniservo camera convert)"
    )


def where_it_ends(model: CentralModel) -> str:
    """Return what a person can do who knows that a lens ends before its formula does."""
    reached = f"Its formula reaches {math.degrees(model.usable_angle):.1f} deg"
    return f"{reached}; say where the lens ends, if earlier: --max-angle DEG, max_angle="


def _name(model: CentralModel) -> str:
    return str(model.to_dict()["model"])
