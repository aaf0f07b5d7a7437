"""Kernels that are compiled when they are first called, not when what calls them is compiled.

A kernel that may need something, a point cloud's proof say, has it compiled, though most problems have no
point cloud. What is `late` is called through a *cell*, eight bytes that hold the address of its machine code:
0 until the first call, which has it loaded, or compiled, by Python.

Private parts of Numba, tried with 0.68.1: `call_conv` (`get_function_type`, `call_function`,
`return_user_exc`, `return_status_propagate`), `CompileResult.library.get_pointer_to_function` and
`fndesc.llvm_func_name`.
"""

from __future__ import annotations

import ctypes
import hashlib
import inspect
import re
from collections.abc import Callable
from functools import wraps
from importlib import import_module
from typing import Any, NamedTuple, TypeVar, cast

from omniservo.errors import TERMINATED

CELL_ENDING = ".cell"
"""of the symbols of cells"""

_FILL = "omniservo.fill"
_NUMBER = {"None": "none", "int": "int64", "float": "float64", "bool": "boolean"}

F = TypeVar("F", bound=Callable[..., Any])


class LateKernel(NamedTuple):
    """What a cell has to be filled with: a kernel for the types of its arguments."""

    module: str
    name: str
    types: tuple[Any, ...]


class _Cell(NamedTuple):
    kernel: LateKernel
    address: ctypes.c_void_p


_cells: dict[str, _Cell] = {}
"""Every cell of this process, by its symbol"""

_symbol_at: dict[int, str] = {}

_functions: dict[tuple[str, str], Any] = {}
"""Numba's dispatchers by module and name"""


def called_late(compiled: Any, function: F) -> F:
    """Return ``function`` such that kernels which call it have it compiled at their first call.

    Args:
        compiled: Numba's dispatcher of the function.
        function: takes its arguments by place, and returns numbers alone, as its annotation says.
    """
    from numba.core.types.misc import unliteral
    from numba.core.typing import signature
    from numba.extending import lower_builtin, type_callable, types

    returned = _returned(function)

    @wraps(function)
    def called_from_python(*arguments: Any) -> Any:
        return compiled(*arguments)

    compile_for = compiled.compile
    # What a call from Python compiles is what cells hold, too: both return what callers take it to return.
    compiled.compile = lambda kinds: compile_for(signature(returned, *kinds))
    _functions[function.__module__, function.__qualname__] = compiled

    @type_callable(called_from_python)  # type: ignore[untyped-decorator]
    def types_of(_context: Any) -> Callable[..., Any]:
        def typer(*given: Any) -> Any:
            return signature(returned, *(unliteral(kind) for kind in given))

        typer.pysig = inspect.signature(function)  # type: ignore[attr-defined]
        return typer

    @lower_builtin(called_from_python, types.VarArg(types.Any))  # type: ignore[untyped-decorator]
    def call(context: Any, builder: Any, called: Any, arguments: Any) -> Any:
        kernel = LateKernel(function.__module__, function.__qualname__, called.args)
        return _call_through(symbol_of(kernel), context, builder, called, arguments)

    return cast(F, called_from_python)


def symbol_of(kernel: LateKernel) -> str:
    """Return the symbol of a kernel's cell, which from now on machine code can be linked to."""
    from llvmlite.binding import add_symbol

    types = hashlib.sha256(str(kernel.types).encode()).hexdigest()[:16]
    symbol = f"{kernel.module}.{kernel.name}-{types}{CELL_ENDING}"
    if symbol not in _cells:
        cell = _Cell(kernel, ctypes.c_void_p(None))
        place = ctypes.addressof(cell.address)
        add_symbol(_FILL, ctypes.cast(_called_by_machine_code, ctypes.c_void_p).value)
        add_symbol(symbol, place)
        _cells[symbol], _symbol_at[place] = cell, symbol
    return symbol


def late_kernels(symbols: tuple[str, ...]) -> tuple[LateKernel, ...]:
    """Return what belongs into the cells of these symbols."""
    return tuple(_cells[symbol].kernel for symbol in symbols)


def fill_all() -> None:
    """Compile every late kernel that a kernel of this process may call, and those that these may call."""
    filled = -1
    while filled != len(_cells):
        filled = len(_cells)
        for symbol in [*_cells]:
            _fill_cell(symbol)


def _fill(place: int) -> int:
    """Fill a cell, in a call by machine code; return which interrupt ended it, if one did.

    ctypes prints any other exception, and the kernel finds the cell empty.
    """
    try:
        _fill_cell(_symbol_at[place])
    except KeyboardInterrupt:
        return 1
    except SystemExit:
        return 2
    return 0


_INTERRUPTS = ((1, KeyboardInterrupt, ()), (2, SystemExit, (TERMINATED,)))
"""What the kernel raises for what `_fill` returned."""

_called_by_machine_code = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_void_p)(_fill)


def _fill_cell(symbol: str) -> None:
    kernel, address = _cells[symbol]
    if address.value is not None:
        return
    if (kernel.module, kernel.name) not in _functions:
        import_module(kernel.module)
    compiled = _functions[kernel.module, kernel.name]
    compiled.compile(kernel.types)
    code = compiled.overloads[kernel.types]
    address.value = code.library.get_pointer_to_function(code.fndesc.llvm_func_name)


def _call_through(symbol: str, context: Any, builder: Any, called: Any, arguments: Any) -> Any:
    """Write the call of what a cell holds, for Numba's calling convention."""
    from llvmlite import ir
    from numba.core import cgutils

    kind = context.call_conv.get_function_type(called.return_type, called.args).as_pointer()
    module, byte = builder.module, ir.IntType(8).as_pointer()
    cell = module.globals.get(symbol) or ir.GlobalVariable(module, kind, symbol)
    number = ir.IntType(32)
    fill = cgutils.get_or_insert_function(module, ir.FunctionType(number, [byte]), _FILL)
    with cgutils.if_unlikely(builder, cgutils.is_null(builder, builder.load(cell))):
        ended = builder.call(fill, [builder.bitcast(cell, byte)])
        for code, interrupt, its_arguments in _INTERRUPTS:
            with cgutils.if_unlikely(builder, builder.icmp_signed("==", ended, number(code))):
                context.call_conv.return_user_exc(builder, interrupt, its_arguments)
    kernel = builder.load(cell)
    with cgutils.if_unlikely(builder, cgutils.is_null(builder, kernel)):
        context.call_conv.return_user_exc(builder, RuntimeError, (f"{symbol}: not compiled",))
    status, result = context.call_conv.call_function(
        builder, kernel, called.return_type, called.args, arguments
    )
    with cgutils.if_unlikely(builder, status.is_error):
        context.call_conv.return_status_propagate(builder, status)
    return result


def _returned(function: Callable[..., Any]) -> Any:
    """Return Numba's type of what a function returns, by its annotation."""
    from numba import types

    text = str(function.__annotations__["return"])
    names = re.findall(r"None|int|float|bool", text)
    kinds = [getattr(types, _NUMBER[name]) for name in names]
    if re.fullmatch(r"tuple\[.*\]", text):
        return types.Tuple(kinds)
    return kinds[0]
