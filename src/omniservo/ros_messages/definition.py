"""A message's definition as the text of a .msg file, with those of the messages in it: "ros2msg" in MCAP."""

from __future__ import annotations

from typing import Any

from omniservo.ros_messages.messages import Numbers, RosMessage, Scalar

_SCALARS = {"i": "int32", "I": "uint32", "B": "uint8", "?": "bool", "d": "float64"}
_NUMBERS = {"<f8": "float64", "u1": "uint8"}
_RULE = "=" * 80


def definition(kind: type[RosMessage]) -> str:
    """Return the definition of a type, and behind it, each under a rule, of all types that it is made of."""
    parts = [_fields(kind)]
    parts += [f"{_RULE}\nMSG: {_short(inner)}\n{_fields(inner)}" for inner in _inner(kind, [])]
    return "".join(parts)


def _fields(kind: type[RosMessage]) -> str:
    rows = kind.wire_fields()
    return "".join(f"{_spelled(of)}{'[]' if many else ''} {name}\n" for name, of, many in rows)


def _spelled(of: Any) -> str:
    if isinstance(of, Scalar):
        return _SCALARS[of.code]
    if isinstance(of, Numbers):
        return f"{_NUMBERS[of.dtype]}[{'' if of.count is None else of.count}]"
    return "string" if of is str else _short(of)


def _short(kind: type[RosMessage]) -> str:
    return kind.ros_type.replace("/msg/", "/")


def _inner(kind: type[RosMessage], known: list[type[RosMessage]]) -> list[type[RosMessage]]:
    """Return the types that a type is made of, each once, those found before first."""
    for _, of, _ in kind.wire_fields():
        if isinstance(of, type) and issubclass(of, RosMessage) and of not in known:
            known.append(of)
            _inner(of, known)
    return known
