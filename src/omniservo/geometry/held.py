"""Named tuples that kernels hand to each other by reference.

Numba hands on every array of a named tuple as nine arguments of its own, and counts a reference to each. A
kernel takes hold of a large one first: what it calls then takes one pointer.
"""

from collections.abc import Callable
from typing import Any, TypeVar

from numba.core import types
from numba.experimental import structref
from numba.extending import overload

T = TypeVar("T", bound=tuple[Any, ...])


@structref.register
class Held(types.StructRef):  # type: ignore[name-defined,misc]
    """The type of a held named tuple."""


def held(record: T) -> T:
    """Return a named tuple behind one pointer; what is held already, and all in the interpreter, as it is."""
    return record


def _held(record: Any) -> Callable[..., Any] | None:
    """Return the code of `held` for a type: field by field, since Numba has no loop over fields."""
    if isinstance(record, Held):
        return lambda record: record
    if not isinstance(record, types.BaseNamedTuple):  # type: ignore[attr-defined]
        return None
    struct = Held(list(zip(record.fields, record.types, strict=True)))
    lines = "".join(f"    struct.{field} = record.{field}\n" for field in record.fields)
    scope: dict[str, Any] = {"new": structref.new, "type_of_struct": struct}
    code = f"def hold(record):\n    struct = new(type_of_struct)\n{lines}    return struct\n"
    exec(code, scope)  # noqa: S102 — names of fields of our own classes
    hold: Callable[..., Any] = scope["hold"]
    return hold


overload(held)(lambda record: _held(record))  # without annotations: Numba compares them with hold's
