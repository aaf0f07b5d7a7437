"""The one way in which code is compiled here.

A kernel is optimised, together with all that it calls, and then again inside every kernel that calls it. What
has one caller and mostly calls others is therefore `inlined`, and large named tuples are `held`.
"""

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., Any])


def kernel(function: F) -> F:
    """Compile with Numba: strict IEEE arithmetic, cached on disk, without the interpreter lock.

    No fast-math and no fused multiply-add contraction, because certificates bound every rounding
    error. Division by zero follows IEEE (infinity or NaN) instead of raising, so kernels return flags.
    """
    return _compiled(function, "never")


def inlined(function: F) -> F:
    """Compile like `kernel`, but as a part of the kernel that calls it: not for itself, and never twice."""
    return _compiled(function, "always")


def _compiled(function: F, inline: str) -> F:
    compiled = numba.njit(
        cache=True, nogil=True, error_model="numpy", fastmath=False, inline=inline, no_cfunc_wrapper=True
    )(function)
    return cast(F, compiled)
