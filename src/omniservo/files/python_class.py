"""A class of the user's own, from a Python file that was named on purpose: its code is run."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

from omniservo.errors import InputError, spelled
from omniservo.files.documents import read_bytes


def python_class(name: str, what: str, code: bytes | None = None) -> Callable[..., Any]:
    """Return what ``FILE.py:CLASS`` names; ``what`` it is to be stands in messages.

    Args:
        name: of file and class.
        what: "method", say.
        code: what the file holds, where it was read before or elsewhere; None: it is read.

    Raises:
        InputError: no such file, or no such class in it.
    """
    path, _, class_name = name.rpartition(":")
    content = read_bytes(path) if code is None else code
    module = ModuleType(f"omniservo_{what}_{Path(path).stem}")
    module.__file__ = path
    sys.modules[module.__name__] = module  # where dataclasses and pickle look for it
    exec(compile(content, path, "exec"), vars(module))  # noqa: S102 — the user named the file to run it
    found: Callable[..., Any] | None = getattr(module, class_name, None)
    if not callable(found):
        raise InputError(f"{what}: {path} has no class {spelled(class_name)}")
    return found
