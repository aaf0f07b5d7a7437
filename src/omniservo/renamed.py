"""Public names of before stay usable for one release."""

import warnings
from collections.abc import Callable, Mapping
from functools import wraps
from importlib import import_module
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")


def renamed(module: str, names: Mapping[str, str]) -> Callable[[str], object]:
    """Return the ``__getattr__`` of a module in which old names give what has a new one, with a warning.

    Args:
        module: its ``__name__``.
        names: of each old name the new one, which the module has, or "package.name" where it is elsewhere.
    """

    def get(name: str) -> object:
        if name not in names:
            raise AttributeError(f"module {module!r} has no attribute {name!r}")
        home, _, new = names[name].rpartition(".")
        _warn(f"{module}.{name} is called {names[name]} now")
        return getattr(import_module(home or module), new)

    return get


def renamed_arguments(**names: str) -> Callable[[Callable[P, T]], Callable[P, T]]:
    """Let a function be called with arguments' names of before, ``old="new"``, with a warning."""

    def decorated(function: Callable[P, T]) -> Callable[P, T]:
        @wraps(function)
        def called(*args: P.args, **kwargs: P.kwargs) -> T:
            for old, new in names.items():
                if old in kwargs and new not in kwargs:
                    _warn(f"{function.__qualname__}: {old} is called {new} now")
                    kwargs[new] = kwargs.pop(old)
            return function(*args, **kwargs)

        return called

    return decorated


def renamed_attribute(old: str, new: str) -> Any:
    """Return the property that an attribute's name of before is, with a warning."""

    def get(of: object) -> object:
        _warn(f"{type(of).__name__}.{old} is called {new} now")
        return getattr(of, new)

    return property(get)


def _warn(message: str) -> None:
    """Warn the caller of who calls this."""
    warnings.warn(message, DeprecationWarning, stacklevel=3)
