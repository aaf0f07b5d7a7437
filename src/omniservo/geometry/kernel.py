"""The one way in which code is compiled here.

A kernel is optimised, together with all that it calls, and then again inside every kernel that calls it. What
has one caller and mostly calls others is therefore `inlined`, and large named tuples are `held`.

Numba counts the references to every array that a kernel is handed: two calls and two atomic additions each,
which take longer than the work on one point. What makes and returns no array is a `leaf`, and is spared that.

A loop becomes vector instructions, four numbers at a time, if it goes over arrays of one number each, `BLOCK`
long, without branches: conditions are joined by ``&`` and choose between values that are computed either way
(what is read from an array only on one side is a branch). An iteration takes a fixed number of steps for the
whole block; the few points for which it was too short are done one by one behind it.
"""

import re
from collections.abc import Callable
from functools import lru_cache
from typing import Any, TypeVar, cast

import numba
from numba.core import serialize
from numba.core.types.misc import unliteral

from omniservo.geometry.kernel_cache import KernelCache
from omniservo.geometry.late import called_late

serialize._numba_unpickle = lru_cache(maxsize=None)(serialize._numba_unpickle)
"""Numba calls it for every array that a kernel returns. Written in Python it is where a Ctrl-C of meanwhile
is raised, between two arrays of a tuple, which Numba does not expect: the process ends with a segmentation
fault. What is kept is found without a line of Python."""

BLOCK = 512
"""numbers: all arrays of such a loop stay in the nearest cache"""

_NUMBERS = r"None|<class '(float|int|bool)'>|float|int|bool|tuple\[((float|int|bool)(, |\]))+"
"""what a leaf may return, as annotations are written"""

F = TypeVar("F", bound=Callable[..., Any])


def kernel(function: F) -> F:
    """Compile with Numba: strict IEEE arithmetic, no interpreter lock, kept on disk by `KernelCache`.

    No fast-math and no fused multiply-add contraction, because certificates bound every rounding
    error. Division by zero follows IEEE (infinity or NaN) instead of raising, so kernels return flags.
    """
    return _compiled(function, _nrt=True)


def leaf(function: F) -> F:
    """Compile like `kernel` what neither makes nor returns an array, without counting references.

    An array that is made inside is an error of the compiler; one that is returned would be freed while
    in use, and is refused here.
    """
    _numbers_alone(function)
    return _compiled(function, _nrt=False)


def inlined(function: F) -> F:
    """Compile like `kernel`, but as a part of the kernel that calls it: not for itself, and never twice."""
    return _compiled(function, inline="always")


def late(function: F) -> F:
    """Compile like `kernel`, but at the first call, not with what calls it: what most problems do not need.

    It takes its arguments by place and returns numbers alone.
    """
    _numbers_alone(function)
    return called_late(_compiled(function, _nrt=True), function)


def _numbers_alone(function: Callable[..., Any]) -> None:
    returned = str(function.__annotations__["return"])
    if not re.fullmatch(_NUMBERS, returned):
        raise TypeError(
            f"{function.__qualname__}: returns {returned}; a leaf, and what is late, returns numbers alone"
        )


def _compiled(function: F, **options: Any) -> F:
    compiled: Any = numba.njit(
        nogil=True, error_model="numpy", fastmath=False, no_cfunc_wrapper=True, **options
    )(function)
    if function.__module__.startswith("omniservo."):
        compiled._cache = KernelCache(function)
    of_types = compiled.get_call_template

    def of_wider_types(arguments: Any, keywords: Any) -> Any:
        wide = tuple(unliteral(a) for a in arguments)
        return of_types(wide, {name: unliteral(a) for name, a in keywords.items()})

    # Numba would compile a kernel anew for every constant it is called with: 3 is a type of its own.
    compiled.get_call_template = of_wider_types
    return cast(F, compiled)
