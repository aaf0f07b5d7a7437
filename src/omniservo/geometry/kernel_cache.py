"""Compiled kernels are kept on disk under one hash over all that they are compiled from.

Numba's own cache stamps a function with the text of its one file. Where a callee stands in another file, an
edit of the callee leaves the caller as it was: a certificate from old code. And Numba's index of a function
is read, changed and written without a lock: of two processes that compile it for two types at once, one can
file its code under the other's signature. Here neither can happen:

- A folder is named by a hash over the text of every file with a kernel and of every file of this package
  that one of these imports, over the versions of Numba, llvmlite and Python, over Numba's settings and over
  the processor that the code is for. A change of any of them begins another folder; what is edited while a
  process runs is not kept by it.
- A file holds one function for one signature, which is compared when it is read, and is written under another
  name first. A file calls another by its name, and whichever process wrote that, it does the same:
  processes at work at the same time do each other no harm.

Numba links a kernel into each of its callers and compiles it there again, which takes half of all the time.
Here a large kernel is compiled once. Its callers call it by a symbol, the name of its file; who loads a
caller loads first what it calls, and where that is missing, the caller is compiled again. What is called late
(`late`) is known by the file of its caller, which makes its cell.

A wheel brings a folder of its own, for a generic processor, which is only read; the user's comes after it.
Private parts of Numba, tried with 0.68.1: `Dispatcher._cache` and what it calls of a cache,
`CompileResult._reduce` and `_rebuild`, `serialize.dumps`, `CodeLibrary.has_dynamic_globals`, `_final_module`
and `_get_module_for_linking`, `JitEngine._defined_symbols`.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import platform
import re
import shutil
import sys
import tempfile
from collections.abc import Callable
from contextlib import suppress
from functools import lru_cache, partial
from importlib.metadata import version
from pathlib import Path
from types import MappingProxyType
from typing import Any

from omniservo.geometry.late import CELL_ENDING, late_kernels, symbol_of

PACKAGE = Path(__file__).parents[1]

SHIPPED = PACKAGE / "kernels"
"""A wheel's own kernels; a checkout has none."""

LARGEST_LINKED = 24_000
"""characters of LLVM assembly up to which a kernel is linked into its callers: small ones run faster so"""

KEPT = 6
"""Folders of the user's that are kept, those used last: each edit of a kernel begins one."""

_V3 = "avx avx2 bmi bmi2 f16c fma lzcnt movbe popcnt sse4.2 ssse3 xsave"

GENERIC = MappingProxyType(
    {
        "x86_64": ("x86-64-v3", _V3),
        "amd64": ("x86-64-v3", _V3),
    }
)
"""For a machine, the processor that a wheel's kernels are compiled for, and what a processor must have to run
them; "generic", which all have, elsewhere"""

_NAME, _FEATURES = "NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES"
_IMPORT = re.compile(rb"from (omniservo[\w.]*) import (\([^)]*\)|[^\n]*)")
_NAME_OF = re.compile(rb"\w+")
_HAS_KERNELS = b"omniservo.geometry.kernel import"
_DIGEST_BYTES, _ENDING = 32, ".kernel"
_FUNCTION_TYPE = re.compile(r"(\w+) \((.*)\)")


class KernelCache:
    """Loads and saves what one function compiles to, as `numba.core.caching.FunctionCache` does.

    Args:
        function: to be compiled, of this package.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        self._name = f"{function.__module__.removeprefix('omniservo.')}.{function.__qualname__}"
        _sources()  # now, as the text is that is being imported

    @property
    def cache_path(self) -> str:
        """The folder that is written to."""
        return str(user_folder())

    def load_overload(self, signature: Any, target_context: Any) -> Any:
        """Return the code for a signature, or None where it has to be compiled."""
        from numba.core.runtime import rtsys

        rtsys.initialize(target_context)  # all that code needs to run; `refresh` loads what compiles, too
        kept, compiled = _load(self._file(signature), target_context)
        return compiled if kept == signature else None

    def save_overload(self, signature: Any, compiled: Any) -> None:
        """Keep what a signature compiled to; where that cannot be written it is compiled again next time."""
        from numba.core.serialize import dumps

        name, library = self._file(signature), compiled.library
        if library.has_dynamic_globals:
            return
        symbols, called, cells = _symbols(library._final_module)
        if len(str(library._final_module)) > LARGEST_LINKED:
            _stand_apart(name, signature, compiled)
        if _stamps(kernel_files()) != _sources()[1]:
            return  # a file was edited while this process ran, and is not what was compiled
        content = dumps((signature, called, late_kernels(cells), symbols, compiled._reduce()))
        folder = user_folder()
        try:
            _begin(folder)
            handle, written = tempfile.mkstemp(dir=folder)
            with os.fdopen(handle, "wb") as file:
                file.write(hashlib.sha256(content).digest() + content)
            os.replace(written, folder / name)
        except OSError:
            return

    def flush(self) -> None:
        """Delete nothing: what is kept belongs to this very code."""

    def _file(self, signature: Any) -> str:
        return f"{self._name}-{hashlib.sha256(str(signature).encode()).hexdigest()[:16]}{_ENDING}"


_callable: dict[str, tuple[Any, Any]] = {}
"""Signature and code, by symbol, of what this process has loaded, or compiled and does not link"""


def _load(name: str, target_context: Any) -> tuple[Any, Any]:
    """Return signature and code of a file, with all that it calls; (None, None): it has to be compiled."""
    if name in _callable:
        return _callable[name]
    for folder in kernel_folders():
        try:
            data = (folder / name).read_bytes()
        except OSError:
            continue
        _mark_as_used(folder)
        digest, content = data[:_DIGEST_BYTES], data[_DIGEST_BYTES:]
        if hashlib.sha256(content).digest() != digest:
            continue
        signature, called, late, symbols, code = pickle.loads(content)  # noqa: S301 — compiled by this user, or installed
        for one in late:
            symbol_of(one)
        if all(_load(callee, target_context)[1] is not None for callee in called):
            return _give_symbol(name, signature, _rebuilt(target_context, symbols, *code))
    return None, None


def _give_symbol(name: str, signature: Any, compiled: Any) -> tuple[Any, Any]:
    """Let machine code that is loaded from now on call this by its name."""
    from llvmlite.binding import add_symbol

    add_symbol(name, compiled.library.get_pointer_to_function(compiled.fndesc.llvm_func_name))
    _callable[name] = signature, compiled
    return signature, compiled


def _stand_apart(name: str, signature: Any, compiled: Any) -> None:
    """Have what is linked into callers do nothing but call this by its name."""
    from llvmlite.binding import parse_assembly

    module = compiled.library._final_module
    function = module.get_function(compiled.fndesc.llvm_func_name)
    kind = _FUNCTION_TYPE.fullmatch(str(function.global_value_type))
    if kind is None:
        return
    returned, types = kind.groups()
    arguments = ", ".join(f"{one} %a{i}" for i, one in enumerate(types.split(", ")))
    call = parse_assembly(f"""
        target datalayout = "{module.data_layout}"
        target triple = "{module.triple}"
        declare {returned} @"{name}"({types})
        define linkonce_odr {returned} @"{function.name}"({arguments}) alwaysinline {{
            %r = tail call {returned} @"{name}"({arguments})
            ret {returned} %r
        }}""")
    compiled.library._get_module_for_linking = lambda: call
    _give_symbol(name, signature, compiled)


def _symbols(module: Any) -> tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]]:
    """Return what a module defines, and the names of the files and of the cells that it calls."""
    both = [*module.functions, *module.global_variables]
    elsewhere = [symbol.name for symbol in both if symbol.is_declaration]
    called = (name for name in elsewhere if name.endswith(_ENDING))
    cells = (name for name in elsewhere if name.endswith(CELL_ENDING))
    return tuple(symbol.name for symbol in both if not symbol.is_declaration), tuple(called), tuple(cells)


def _rebuilt(target_context: Any, symbols: tuple[str, ...], library: Any, *rest: Any) -> Any:
    """Do what `CompileResult._rebuild` does, but read bitcode only for a caller that is compiled later.

    That takes longer than all else, and what is called from Python needs its machine code alone.
    """
    from llvmlite.binding import parse_bitcode
    from numba.core.compiler import CompileResult

    name, kind, (machine_code, bitcode) = library
    target_context.codegen()._engine._defined_symbols.update(symbols)
    result = CompileResult._rebuild(target_context, (name, kind, (machine_code, _no_bitcode())), *rest)
    result.library._get_module_for_linking = lru_cache(partial(parse_bitcode, bitcode))
    return result


@lru_cache
def _no_bitcode() -> bytes:
    from llvmlite.binding import parse_assembly

    empty: bytes = parse_assembly("").as_bitcode()
    return empty


def user_folder() -> Path:
    """Return the folder of this user's, this code's and this processor's kernels."""
    host, host_features = _host()
    name, features = os.environ.get(_NAME, host), os.environ.get(_FEATURES, host_features)
    try:
        caches = Path(os.environ.get("XDG_CACHE_HOME", ""))
        if not caches.is_absolute():  # which the XDG specification says to ignore
            caches = Path.home() / ".cache"
    except RuntimeError:  # a user without a home, as in some containers: nothing can be kept
        caches = Path(os.devnull)
    return caches / "omniservo" / f"kernels-{_key(name, features)}"


def shipped_folder() -> Path | None:
    """Return the folder of a wheel's kernels for this code, if there is one and this processor runs them."""
    level, needed = GENERIC.get(platform.machine().lower(), ("generic", ""))
    runs = set(needed.split()) <= {f[1:] for f in _host()[1].split(",") if f.startswith("+")}
    folder = SHIPPED / f"kernels-{_key(level, '')}"
    return folder if runs and os.environ.get(_NAME, level) == level and folder.is_dir() else None


def kernel_folders() -> list[Path]:
    """Return the folders in which compiled kernels are looked for, in this order."""
    return [folder for folder in (shipped_folder(), user_folder()) if folder is not None]


@lru_cache
def _host() -> tuple[str, str]:
    """Return the name and the features of the processor."""
    import llvmlite.binding as llvm

    return llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()


@lru_cache
def kernel_files() -> tuple[Path, ...]:
    """Return every file that a kernel's code may depend on: those with kernels and all that these import."""
    text = {
        os.path.join(folder, name)[len(str(PACKAGE.parent)) + 1 :]: Path(folder, name).read_bytes()
        for folder, _, names in os.walk(PACKAGE)
        for name in names
        if name.endswith(".py")
    }
    begin = [file for file, content in text.items() if _HAS_KERNELS in content]
    found: set[str] = set()
    while begin:
        file = begin.pop()
        if file not in found:
            found.add(file)
            begin += [f for module, name in _imported(text[file]) for f in _defining(text, module, name)]
    return tuple(sorted(PACKAGE.parent / file for file in found))


def _imported(text: bytes) -> list[tuple[str, bytes]]:
    """Return the modules, as paths without ending, and the names that a text imports."""
    return [
        (module.decode().replace(".", os.sep), name)
        for module, names in _IMPORT.findall(text)
        for name in _NAME_OF.findall(names)
    ]


def _defining(text: dict[str, bytes], module: str, name: bytes) -> list[str]:
    """Return the files that a name is from; of a package, where what it hands on is from, or itself."""
    package = os.path.join(module, "__init__.py")
    if package not in text:
        return [file for file in (f"{module}.py",) if file in text]
    inside = os.path.join(module, f"{name.decode()}.py")
    if inside in text:
        return [inside]
    handed_on = {origin for origin, n in _imported(text[package]) if n == name and origin != module}
    return [f for origin in handed_on for f in _defining(text, origin, name)] or [package]


@lru_cache
def _sources() -> tuple[str, list[tuple[int, int]]]:
    """Return a hash over the text of what kernels are compiled from, and the stamps of its files."""
    files, hashed = kernel_files(), hashlib.sha256()
    stamps = _stamps(files)
    for file in files:
        hashed.update(str(file.relative_to(PACKAGE)).encode() + b"\0" + file.read_bytes() + b"\0")
    return hashed.hexdigest(), stamps


def _stamps(files: tuple[Path, ...]) -> list[tuple[int, int]]:
    return [(stat.st_mtime_ns, stat.st_size) for stat in map(os.stat, files)]


def _key(processor: str, features: str) -> str:
    settings = {n: v for n, v in os.environ.items() if n.startswith("NUMBA_") and n not in (_NAME, _FEATURES)}
    machine = sys.platform, platform.machine(), processor, features
    parts = repr((_sources()[0], _versions(), sorted(settings.items()), machine))
    return hashlib.sha256(parts.encode()).hexdigest()[:20]


@lru_cache
def _versions() -> tuple[str | None, ...]:
    return version("numba"), version("llvmlite"), sys.implementation.cache_tag, sys.abiflags


def _begin(folder: Path) -> None:
    """Make the folder; of those of other code, which whoever uses them compiles again, leave only some."""
    if folder.is_dir():
        return
    folder.mkdir(parents=True, exist_ok=True)
    others = sorted(folder.parent.glob("kernels-*"), key=lambda other: other.stat().st_mtime)
    for old in others[:-KEPT]:
        shutil.rmtree(old, ignore_errors=True)


@lru_cache
def _mark_as_used(folder: Path) -> None:
    with suppress(OSError):
        os.utime(folder)
