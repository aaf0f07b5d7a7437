"""Numbers as a person reads them."""

from __future__ import annotations

import math

_UNITS = {
    "m": (1e3, "mm"),
    "rad": (180.0 / math.pi, "°"),
    "1": (1.0, ""),
    "share": (100.0, "%"),
}
_TIMES = ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs"))

NOTHING = "–"
"""where a quantity does not exist"""


def spell(value: float | None, unit: str) -> str:
    """Return a value with a readable unit: m in mm, rad in °, a share in %, s in s, ms or µs; others stay."""
    if value is None or math.isnan(value):
        return NOTHING
    if unit == "s":
        factor, name = next((t for t in _TIMES if abs(value) >= t[0]), _TIMES[-1])
        return f"{significant(value / factor)} {name}"
    factor, name = _UNITS.get(unit, (1.0, unit))
    return _named(significant(value * factor), name)


def spell_bound(value: float | None, unit: str) -> str:
    """Return a proven lower bound, rounded down: what is written is proven, too."""
    if value is None or math.isnan(value):
        return NOTHING
    factor, name = _UNITS.get(unit, (1.0, unit))
    return f"≥ {_named(significant(_rounded_down(value * factor)), name)}"


def _named(number: str, unit: str) -> str:
    return f"{number}{unit}" if unit in ("°", "%") else f"{number} {unit}".rstrip()


def reads_less(value: float, bound: float, unit: str) -> bool:
    """Return whether a value, as `spell` writes it, is less than a bound as `spell_bound` writes it."""
    factor, _ = _UNITS.get(unit, (1.0, unit))
    return round(value * factor, _decimals(value * factor)) < _rounded_down(bound * factor)


def _rounded_down(value: float) -> float:
    decimals = _decimals(value)
    return round(math.floor(value * 10.0**decimals * (1.0 + 1e-12)) / 10.0**decimals, decimals)


def significant(value: float) -> str:
    """Return a number with the digits that matter to a person: 0.0410, 5.28, 61.27, 874."""
    if value == 0.0 or not math.isfinite(value):
        return "0" if value == 0.0 else str(value)
    if abs(value) < 1e-6:
        return f"{value:.1e}".replace("-", "−")
    return f"{value:.{_decimals(value)}f}".replace("-", "−")


def first_digit(value: float) -> float:
    """Return a number with its first digit alone, rounded: of 5071 times as long a reader needs 5000."""
    return float(f"{value:.0e}")


def _decimals(value: float) -> int:
    """Return how many decimals matter to a person."""
    size = math.floor(math.log10(max(abs(value), 1e-6)))
    return 0 if size >= 2 else 2 if size >= 0 else 2 - size
