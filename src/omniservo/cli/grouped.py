"""Options that go together are one object in a command: each field of a dataclass is an option."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import MISSING, fields, is_dataclass
from functools import wraps
from inspect import Parameter, Signature, signature
from typing import Any, get_type_hints


def grouped(command: Callable[..., None]) -> Callable[..., None]:
    """Let parameters of a Typer command be dataclasses, whose fields become parameters in their place.

    A parameter of the command that is called like a field is both: the group has its value, too.
    """
    hints = get_type_hints(command, include_extras=True)
    groups: dict[str, Any] = {name: hint for name, hint in hints.items() if is_dataclass(hint)}
    own = [p for p in signature(command).parameters.values() if p.name not in groups]
    given: dict[str, Parameter] = {}
    for parameter in signature(command).parameters.values():
        group = groups.get(parameter.name)
        for each in [parameter] if group is None else _options(group):
            hint = hints[each.name] if each is parameter else each.annotation
            kept = each.replace(annotation=hint, kind=Parameter.KEYWORD_ONLY)
            given.setdefault(each.name, kept)

    @wraps(command)
    def called(**values: Any) -> None:
        objects = {
            name: group(**{field.name: values[field.name] for field in fields(group)})
            for name, group in groups.items()
        }
        command(**{p.name: values[p.name] for p in own}, **objects)

    called.__dict__["__signature__"] = Signature(list(given.values()))
    called.__annotations__ = {name: p.annotation for name, p in given.items()}
    return called


def _options(group: Any) -> list[Parameter]:
    """Return the fields of a dataclass as parameters."""
    hints = get_type_hints(group, include_extras=True)
    return [
        Parameter(
            field.name,
            Parameter.KEYWORD_ONLY,
            default=Parameter.empty if field.default is MISSING else field.default,
            annotation=hints[field.name],
        )
        for field in fields(group)
    ]
