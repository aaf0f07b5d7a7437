"""Fields of results that cost more than all the rest of the result."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from typing import Any, TypeVar, cast

T = TypeVar("T")


class Later:
    """A function that stands for what it returns."""

    def __init__(self, function: Callable[[], Any]) -> None:
        self.function = function


def later(function: Callable[[], T]) -> Any:
    """Return what can be given to a deferred field instead of the function's value."""
    return Later(function)


def deferring(*names: str) -> Callable[[type[T]], type[T]]:
    """Let the named fields of a dataclass be given by `later`.

    The function is called when the field is first read, or a copy is made; what it returned is the field's
    value from then on, so that a reader, and another process, sees no difference.
    """

    def state(instance: Any) -> dict[str, Any]:
        known: dict[str, Any] = {name: getattr(instance, name) for name in names}
        return {**vars(instance), **known}

    def decorate(cls: type[T]) -> type[T]:
        for name in names:
            setattr(cls, name, _Deferred(name))
        setattr(cls, "__getstate__", state)  # noqa: B010 — of a class of any kind
        return cls

    return decorate


def changed(instance: T, **changes: object) -> T:
    """Return a copy of a dataclass with other fields, as `dataclasses.replace`; what is deferred stays so."""
    given = {field.name: vars(instance)[field.name] for field in fields(cast(Any, instance)) if field.init}
    return type(instance)(**{**given, **changes})


class _Deferred:
    """The descriptor of such a field."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __get__(self, instance: Any, owner: type) -> Any:
        if instance is None:
            return self
        value = instance.__dict__[self._name]
        if isinstance(value, Later):
            value = instance.__dict__[self._name] = value.function()
        return value

    def __set__(self, instance: Any, value: Any) -> None:
        instance.__dict__[self._name] = value
