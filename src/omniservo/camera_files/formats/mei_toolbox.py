"""Values of C. Mei's MATLAB toolbox, written down by hand in JSON or YAML.

The toolbox saves a .mat file and prints its result; people copy the numbers. Read are ``xi`` with

- fx, fy, cx, cy, k1, k2, p1, p2 and skew [px], one number each (gamma1, gamma2, u0, v0 will do, too), or
- the toolbox's own arrays: gammac [γ1, γ2], cc [u0, v0], kc [k1, k2, p1, p2 and a fifth that must be 0] and
  alpha_c, with skew = alpha_c γ1.

What is not there is 0, but for ξ, focal lengths and centre. The toolbox counts pixels from 0 at a centre,
as its parent, J.-Y. Bouguet's toolbox; the file does not say the image size. Read only.
"""

from __future__ import annotations

from typing import Any

from omniservo.camera_files.calibration_file import CalibrationFile
from omniservo.cameras import UnifiedCamera

_NAMES = (("fx", "gamma1"), ("fy", "gamma2"), ("cx", "u0"), ("cy", "v0"))


def recognises(fields: Any) -> bool:
    """Say whether ξ stands beside a focal length."""
    return (
        "xi" in fields
        and any(name in fields for name in ("fx", "gamma1", "gammac"))
        and "format" not in fields
    )


def names(file: CalibrationFile) -> list[str]:
    """Return the names of the file's cameras: one, which has none."""
    return [""]


def read(file: CalibrationFile, name: str) -> UnifiedCamera:
    """Return the camera.

    Raises:
        InputError: a value is missing or not legal, or the caller does not say the image size.
    """
    for field in file.fields:
        if str(field).lower().startswith("dist"):
            raise file.error("not read beside xi; legal: k1, k2, p1, p2, one number each, or kc", str(field))
    if file.has("gammac"):
        fx, fy = file.numbers(2, "gammac", nonzero=(0, 1))
        cx, cy = file.numbers(2, "cc")
        kc = file.coefficients("kc", legal=(0, 4, 5)) if file.has("kc") else ()
        if any(kc[4:]):
            raise file.error(f"a fifth number, {kc[4]:g}; legal: 0", "kc")
        distortion = (*kc, 0.0, 0.0, 0.0, 0.0)[:4]
        skew = fx * file.number("alpha_c") if file.has("alpha_c") else 0.0
    else:
        places = [next((n for n in pair if file.has(n)), pair[0]) for pair in _NAMES]
        fx, fy = (file.number(place, nonzero=True) for place in places[:2])
        cx, cy = (file.number(place) for place in places[2:])
        k1, k2, p1, p2, skew = (
            file.number(n) if file.has(n) else 0.0 for n in ("k1", "k2", "p1", "p2", "skew")
        )
        distortion = (k1, k2, p1, p2)
    xi = file.number("xi", minimum=0.0)
    size = _size(file)
    return file.build(
        UnifiedCamera, fx=fx, fy=fy, cx=cx, cy=cy, xi=xi, **size, skew=skew, distortion=distortion
    )


def _size(file: CalibrationFile) -> dict[str, int]:
    if file.has("width") and file.has("height"):
        return file.image_size((file.number("width"), file.number("height")), "width")
    return file.image_size()
