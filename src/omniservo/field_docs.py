"""What stands under the fields of a class, for `help`."""

from __future__ import annotations

import ast
import inspect
import re
import textwrap
from functools import cache
from typing import TypeVar

T = TypeVar("T")


def with_field_docs(cls: type[T]) -> type[T]:
    """Let `help` show the docstrings under the class's fields, as a section "Attributes" of its own.

    Python drops a string under a field. They are read from the source, when the docstring is needed and
    not before, so that importing costs nothing; without a source the class keeps its own words.
    """
    cls.__doc__ = _LazyDoc(cls.__doc__)  # type: ignore[assignment]
    return cls


class _LazyDoc:
    """A docstring that is put together when it is read."""

    def __init__(self, own: str | None) -> None:
        self.own = inspect.cleandoc(own or "")

    def __get__(self, instance: object, owner: type) -> str:
        said = {name: words for cls in reversed(owner.__mro__) for name, words in _fields_of(cls).items()}
        told = re.findall(r"^ +([\w, ]+): ", self.own, re.MULTILINE)
        own = {name.strip() for names in told for name in names.split(",")}
        lines = [f"    {name}: {words}" for name, words in said.items() if name not in own]
        return "\n".join([self.own, "", "Attributes:", *lines]) if lines else self.own


@cache
def _fields_of(cls: type) -> dict[str, str]:
    """Return for each public field of the class itself what stands under it, else its type."""
    try:
        (tree,) = ast.parse(textwrap.dedent(inspect.getsource(cls))).body
    except (OSError, TypeError):
        return {}
    words: dict[str, str] = {}
    above = ""
    for node in tree.body if isinstance(tree, ast.ClassDef) else ():
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            above, kind = node.target.id, ast.unparse(node.annotation)
            if not above.startswith("_") and not kind.startswith("ClassVar"):
                words[above] = kind
        elif above in words and isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            words[above] = inspect.cleandoc(str(node.value.value)).replace("\n", "\n" + " " * 8)
        else:
            above = ""
    return words
