"""The closest camera that a format can hold."""

from __future__ import annotations

from omniservo.camera_files.camera_files import FORMATS, WRITTEN, text_in_format
from omniservo.cameras.conversion import Residual, convert, standing_for, where_it_ends
from omniservo.cameras.conversion.residual import measured
from omniservo.cameras.models import CentralModel, camera_from_dict
from omniservo.errors import InputError, did_you_mean, spelled

_ANY_PX = 1e9


def closest_model(
    camera: CentralModel, format_name: str, *, largest_px: float = 1.0
) -> tuple[CentralModel, Residual | None]:
    """Return the camera itself where the format holds it, else the closest of the models that it holds.

    Every model of the format is fitted over the field that is used (`omniservo.cameras.conversion.convert`);
    taken is the one that loses least of the field and, of equals, has the smallest largest residual.

    Returns:
        the model, and what the conversion leaves, None where there was none.

    Raises:
        InputError: unknown format, or no model of it comes within ``largest_px`` [px]; the message names the
            residual.
    """
    if format_name not in WRITTEN:
        raise InputError(
            f"format: {spelled(format_name)} given; legal: {', '.join(FORMATS)}"
            f"{did_you_mean(format_name, FORMATS)}"
        )
    try:
        text_in_format(camera, format_name)
    except InputError as error:
        refusal = str(error)
    else:
        return camera, None
    found: list[tuple[CentralModel, Residual]] = []
    reasons: list[str] = []
    for kind in WRITTEN[format_name].kinds:
        try:
            found.append(_without_skew(*convert(camera, kind, largest_px=_ANY_PX), camera, format_name))
        except InputError as error:
            reasons.append(f"{kind.__name__}: {error}")
    if not found:
        raise InputError(f"{refusal}; {'; '.join(reasons)}") from None
    model, residual = min(found, key=lambda pair: (round(pair[1].lost, 3), pair[1].largest_px))
    if not residual.largest_px <= largest_px:
        raise InputError(
            f"format {format_name!r}: its closest model, {type(model).__name__}, is up to"
            f" {residual.largest_px:.3g} px away; legal: <= {largest_px:g} px (--largest-px allows more)."
            f" {where_it_ends(camera)}"
        )
    return model, residual


def _without_skew(
    model: CentralModel, residual: Residual, camera: CentralModel, format_name: str
) -> tuple[CentralModel, Residual]:
    """Return the model, its skew left out where the format cannot hold it.

    Raises:
        InputError: the format cannot hold the model for another reason.
    """
    try:
        text_in_format(model, format_name)
    except InputError:
        if getattr(model, "skew", 0.0) == 0.0:
            raise
        model = camera_from_dict({**model.to_dict(), "skew": 0.0})
        text_in_format(model, format_name)
        residual = measured(model, camera)
        model = standing_for(camera, model, residual)
    return model, residual
