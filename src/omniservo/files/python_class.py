"""A class of the user's own, from a Python file that was named on purpose: its code is run."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from omniservo.errors import InputError, spelled
from omniservo.files.documents import require_file


def python_class(name: str, what: str) -> Callable[..., Any]:
    """Return what ``FILE.py:CLASS`` names; ``what`` it is to be stands in messages.

    Raises:
        InputError: no such file, or no such class in it.
    """
    path, _, class_name = name.rpartition(":")
    require_file(path)
    spec = importlib.util.spec_from_file_location(f"omniservo_{what}_{Path(path).stem}", path)
    if spec is None or spec.loader is None:
        raise InputError(f"{what}: {path}: not a Python file")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    found: Callable[..., Any] | None = getattr(module, class_name, None)
    if not callable(found):
        raise InputError(f"{what}: {path} has no class {spelled(class_name)}")
    return found
