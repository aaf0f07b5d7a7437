"""Array types, and the check that every array passes at a public boundary."""

import math
from collections.abc import Sequence
from itertools import chain
from typing import Any

import numpy as np
import numpy.typing as npt

from omniservo.errors import InputError, spelled

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]
ByteArray = npt.NDArray[np.uint8]


def finite_array(name: str, value: npt.ArrayLike, shape: Sequence[int | None]) -> FloatArray:
    """Return ``value`` as a float64 array of the given shape, or say what is wrong with it.

    Args:
        name: what the caller calls it; stands first in every message.
        value: anything NumPy turns into numbers.
        shape: required shape; None is any length. A leading ``...`` is written as ``-1``:
            ``(-1, 3)`` accepts ``(3,)``, ``(n, 3)``, ``(m, n, 3)``.

    Raises:
        InputError: not numeric, of another shape, with NaN or infinity, or with masked entries.
    """
    array = _as_floats(name, value)
    wanted = tuple(shape)
    if array.shape != wanted and not _is_of_shape(array, wanted):
        raise InputError(f"{name}: shape {array.shape} given; {_spell(wanted)} is needed")
    if not all_finite(array):
        bad = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        raise InputError(f"{name}: {array[bad]} at index {bad}; every number must be finite")
    return array


def all_finite(array: FloatArray) -> bool:
    """Return whether every number is finite; of a few, ``all()`` takes twice as long."""
    return bool(np.count_nonzero(np.isfinite(array)) == array.size)


def refuse_masked(name: str, value: Any) -> None:
    """Raise InputError where an array has masked entries: NumPy hands out the numbers under the mask."""
    if isinstance(value, np.ma.MaskedArray) and value.mask.any():
        raise InputError(f"{name}: {value.mask.sum()} masked entries given; every number is needed")


def finite_number(
    name: str, value: Any, *, minimum: float = -math.inf, maximum: float = math.inf, above: float = -math.inf
) -> float:
    """Return ``value`` as a float with minimum <= value <= maximum and value > above.

    Raises:
        InputError: not a number, NaN, infinite, or out of range.
    """
    if isinstance(value, bool | np.bool_ | str | bytes):
        raise InputError(f"{name}: {spelled(value)} given; a number is needed")
    try:
        number = float(value)
    except OverflowError:
        raise InputError(f"{name}: {spelled(value)} given; a finite number is needed") from None
    except (TypeError, ValueError):
        raise InputError(f"{name}: {spelled(value)} given; a number is needed") from None
    if not math.isfinite(number):
        raise InputError(f"{name}: {number} given; a finite number is needed")
    if number < minimum or number > maximum or number <= above:
        low = f"> {above:g}" if above > -math.inf else f">= {minimum:g}" if minimum > -math.inf else ""
        high = f"<= {maximum:g}" if maximum < math.inf else ""
        raise InputError(f"{name}: {number:g} given; legal: {' and '.join(x for x in (low, high) if x)}")
    return number


def owned(array: npt.ArrayLike) -> FloatArray:
    """Return a copy: what a result hands out shares no memory with what it was computed from.

    It can be written to, because SciPy 1.17 and before refuse read-only arrays (`Rotation.apply`,
    `Rotation.from_rotvec`; scipy/scipy#24751, #24761), and its rows are contiguous, as OpenCV needs them.
    """
    return np.array(array, dtype=np.float64, order="C")


def frozen(array: FloatArray) -> FloatArray:
    """Return a read-only copy: what a proof or a control law is computed from never changes afterwards."""
    copy = np.array(array, dtype=np.float64)
    copy.setflags(write=False)
    return copy


def frozen_again(value: Any, state: dict[str, Any]) -> None:
    """Give a copy the state of what it is of, its arrays read-only as they were: to be its ``__setstate__``.

    Neither pickle nor `copy.deepcopy` keeps that of an array.
    """
    vars(value).update(state)
    for name, held in state.items():
        if isinstance(held, np.ndarray) and not name.startswith("_"):
            held.setflags(write=False)


def _is_of_shape(array: FloatArray, wanted: tuple[int | None, ...]) -> bool:
    tail = wanted[1:] if wanted[:1] == (-1,) else wanted
    given = array.shape[len(array.shape) - len(tail) :] if wanted[:1] == (-1,) else array.shape
    return len(given) == len(tail) and all(w is None or w == g for w, g in zip(tail, given, strict=True))


def _as_floats(name: str, value: npt.ArrayLike) -> FloatArray:
    refuse_masked(name, value)
    try:
        if isinstance(value, list | tuple) and _holds_flag(value):
            raise TypeError
        array = np.asarray(value)
        if array.dtype == object or array.dtype.kind not in "fiu":
            raise TypeError
        return array.astype(np.float64)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{name}: {spelled(value)} given; an array of numbers is needed") from None


def _holds_flag(values: Sequence[Any]) -> bool:
    """Tell whether True or False stands among nested lists: NumPy would take them for 1 and 0."""
    while True:
        kinds = set(map(type, values))
        if bool in kinds or not kinds & {list, tuple}:
            return bool in kinds
        values = list(chain.from_iterable(v for v in values if isinstance(v, list | tuple)))


def _spell(shape: tuple[int | None, ...]) -> str:
    parts = ["…" if s == -1 else "any" if s is None else str(s) for s in shape]
    return f"({', '.join(parts)}{',' if len(parts) == 1 else ''})"
