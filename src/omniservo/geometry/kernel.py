"""The one way in which code is compiled here."""

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., Any])


def kernel(function: F) -> F:
    """Compile with Numba: strict IEEE arithmetic, cached on disk, without the interpreter lock.

    No fast-math and no fused multiply-add contraction, because certificates bound every rounding
    error. Division by zero follows IEEE (infinity or NaN) instead of raising, so kernels return flags.
    """
    compiled = numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=False)(function)
    return cast(F, compiled)
