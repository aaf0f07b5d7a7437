"""A class of the user's own, from a Python file that was named on purpose: its code is run."""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import AbstractContextManager, redirect_stdout
from pathlib import Path
from traceback import extract_tb
from types import ModuleType
from typing import Any

from omniservo.errors import InputError, spelled
from omniservo.files.documents import read_bytes


def stdout_to_stderr() -> AbstractContextManager[object]:
    """Redirect what the user's code prints: standard output is a command's own, for JSON."""
    return redirect_stdout(sys.stderr)


def python_class(name: str, what: str, code: bytes | None = None) -> Callable[..., Any]:
    """Return what ``FILE.py:CLASS`` names; ``what`` it is to be stands in messages.

    Args:
        name: of file and class.
        what: "method", say.
        code: what the file holds, where it was read before or elsewhere; None: it is read.

    Raises:
        InputError: no such file, not one of Python, code that cannot be run, or no such class in it.
    """
    path, _, class_name = name.rpartition(":")
    if not path.endswith(".py"):
        raise InputError(f"{what}: {path}: not a Python file")
    content = read_bytes(path) if code is None else code
    module = ModuleType(f"omniservo_{what}_{Path(path).stem}")
    module.__file__ = path
    sys.modules[module.__name__] = module  # where dataclasses and pickle look for it
    try:
        code_object = compile(content, path, "exec", dont_inherit=True)  # without this file's __future__
        with stdout_to_stderr():
            exec(code_object, vars(module))  # noqa: S102 — the user named the file to run it
    except (Exception, SystemExit) as error:
        line = error.lineno if isinstance(error, SyntaxError) else extract_tb(error.__traceback__)[-1].lineno
        raise InputError(f"{what}: {path}: line {line}: {type(error).__name__}: {error}") from error
    found: Callable[..., Any] | None = getattr(module, class_name, None)
    if not callable(found):
        raise InputError(f"{what}: {path} has no class {spelled(class_name)}")
    return found
