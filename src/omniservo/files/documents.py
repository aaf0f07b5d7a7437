"""Untrusted files at the program's edge, read within bounds."""

from __future__ import annotations

import json
import math
import re
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Any

import yaml

from omniservo.errors import InputError, spelled

MAX_BYTES = 16 * 2**20
"""Largest document that is read [bytes]: a plan with 10⁵ points fits."""

MAX_YAML = 2**20
"""Largest YAML document that is read [characters]."""

MOST_YAML_VALUES = 30_000
"""Most values and field names of a YAML document: each costs some forty microseconds."""

_MAX_DEPTH = 32

UNITS = {
    "length": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254},
    "angle": {"rad": 1.0, "deg": math.pi / 180.0},
}
"""What a document may state lengths and angles in, in metres and radians; the first where it says nothing."""


def is_file(path: str | Path) -> bool:
    """Say whether a file that can be read is at this path, or at the end of the links there."""
    try:
        return Path(path).is_file()
    except (OSError, ValueError):  # too long, or with a zero in it
        return False


def require_file(path: str | Path) -> None:
    """Refuse what is no file: a pipe would keep its reader waiting, a device would never end.

    Raises:
        InputError: missing, a folder, or another thing that is no file.
    """
    if is_file(path):
        return
    try:
        there = Path(path).exists()
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from None
    except ValueError:  # a path that no file can have
        raise InputError(f"{spelled(str(path))}: no such file") from None
    raise InputError(f"{path}: not a file" if there else f"{path}: no such file")


def read_text(path: str | Path, *, max_bytes: int = MAX_BYTES) -> str:
    """Return the file's text (UTF-8).

    Raises:
        InputError: missing, a folder, unreadable, larger than ``max_bytes``, or not text.
    """
    return as_text(read_bytes(path, max_bytes=max_bytes), path)


def as_text(content: bytes, path: str | Path) -> str:
    """Return the text (UTF-8) that a file holds.

    Raises:
        InputError: it is none.
    """
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(f"{path}: not a text file (UTF-8)") from None


def read_bytes(path: str | Path, *, max_bytes: int = MAX_BYTES) -> bytes:
    """Return what a file holds.

    Raises:
        InputError: missing, a folder, unreadable, or larger than ``max_bytes``.
    """
    require_file(path)
    file = Path(path)
    try:
        size = file.stat().st_size
        if size > max_bytes:
            raise InputError(f"{path}: {size} bytes; at most {max_bytes} are read")
        with file.open("rb") as stream:
            content = stream.read(size + 1)  # for as many room is made before a byte is read
            if len(content) > size:  # files of the system have more in them than they say
                content += stream.read(max_bytes - size)
    except InputError:
        raise
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from None
    if len(content) > max_bytes:
        raise InputError(f"{path}: more than {max_bytes} bytes; at most so many are read")
    noted = _NOTED.get()
    if noted is not None:
        noted[file.absolute()] = content
    return content


_NOTED: ContextVar[dict[Path, bytes] | None] = ContextVar("noted", default=None)


@contextmanager
def noting_reads() -> Iterator[dict[Path, bytes]]:
    """Give a mapping into which every file that the block reads by `read_bytes` is put, by its path."""
    read: dict[Path, bytes] = {}
    before = _NOTED.set(read)
    try:
        yield read
    finally:
        _NOTED.reset(before)


_LONGEST_PATH = 1000


def file_inside(field: str, value: str, folder: Path | None) -> Path:
    """Return the path of a file that ``field`` of a document names; ``folder`` is the document's own.

    Raises:
        InputError: absolute, outside the folder (links followed), or there is no folder.
    """
    if folder is None:
        raise InputError(f"{field}: the path {spelled(value)} given, but no folder that it is relative to")
    root = folder.resolve()
    try:
        file = (root / value[:_LONGEST_PATH]).resolve()
    except (OSError, RuntimeError, ValueError):
        file = Path("/")
    if len(value) > _LONGEST_PATH or Path(value).is_absolute() or not file.is_relative_to(root):
        raise InputError(f"{field}: {spelled(value)} given; legal: a relative path inside the file's folder")
    return file


def read_document(path: str | Path) -> Any:
    """Return what a JSON or YAML file holds, as plain dicts, lists, strings, numbers, booleans and None.

    Nothing in the file can run code or refer to other files. Aliases, tags, duplicate keys and nesting
    deeper than 32 (YAML) are refused, and YAML above 1 MiB or 30 000 values, which is slow to read: JSON may
    have 16 MiB. Numbers of YAML are decimal.

    Raises:
        InputError: as `read_text`, or the text is neither JSON nor YAML (with the line).
    """
    return parse_document(read_text(path), str(path))


def parse_document(text: str, source: str) -> Any:
    """Return what JSON or YAML text holds; see `read_document`. ``source`` stands first in messages."""
    try:
        if text.lstrip()[:1] in ("{", "["):
            try:
                return json.loads(text, object_pairs_hook=_without_duplicates, parse_constant=float)
            except json.JSONDecodeError:
                if not source.lower().endswith((".yaml", ".yml")):  # YAML has braces, too
                    raise
        if len(text) > MAX_YAML:
            raise InputError(f"{source}: more than {MAX_YAML} bytes of YAML; JSON may have {MAX_BYTES}")
        return yaml.load(text, Loader=_PlainLoader)  # noqa: S506  a SafeLoader with fewer powers
    except json.JSONDecodeError as error:
        raise InputError(f"{source}: line {error.lineno}: not JSON: {error.msg}") from None
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f"line {mark.line + 1}: " if mark is not None else ""
        problem = getattr(error, "problem", None) or "not YAML"
        if problem == "but found another document":
            problem = "a second document begins; legal: one, so cut the file off before this line"
        raise InputError(f"{source}: {where}{problem}") from None
    except RecursionError:
        raise InputError(f"{source}: nested too deeply") from None
    except InputError:
        raise
    except ValueError as error:
        message = "a number has too many digits" if "digits" in str(error) else str(error)
        raise InputError(f"{source}: {message}") from None


def stated_units(units: Any, source: str) -> dict[str, float]:
    """Return metres and radians in one unit of "length" and "angle", from the ``units`` field of a document.

    Raises:
        InputError: not a mapping of these two to units that are known.
    """
    if not isinstance(units, dict) or set(units) - set(UNITS):
        raise InputError(
            f"{source}: units: {spelled(units)} given; legal: a mapping with {' and '.join(UNITS)}"
        )
    stated = {}
    for quantity, legal in UNITS.items():
        unit = units.get(quantity, next(iter(legal)))
        if not isinstance(unit, str) or unit not in legal:
            raise InputError(f"{source}: units.{quantity}: {spelled(unit)} given; legal: {', '.join(legal)}")
        stated[quantity] = legal[unit]
    return stated


class _PlainLoader(yaml.SafeLoader):
    """SafeLoader without aliases and duplicate keys, and with 1e-3 read as a number."""

    depth = 0
    values = 0

    def compose_node(self, parent: Any, index: Any) -> Any:
        self.values += 1
        if self.values > MOST_YAML_VALUES:
            raise ValueError(f"more than {MOST_YAML_VALUES} values of YAML; JSON may have more")
        if self.check_event(yaml.events.AliasEvent):
            event = self.peek_event()  # type: ignore[no-untyped-call]
            raise yaml.composer.ComposerError(None, None, "aliases are not read", event.start_mark)
        event = self.peek_event()  # type: ignore[no-untyped-call]
        if event.tag is not None:
            raise yaml.composer.ComposerError(
                None, None, f"tag {spelled(event.tag)}: tags are not read", event.start_mark
            )
        self.depth += 1
        if self.depth > _MAX_DEPTH:
            raise ValueError(f"nested deeper than {_MAX_DEPTH}")
        node = super().compose_node(parent, index)
        self.depth -= 1
        return node

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
        seen = set()
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                raise yaml.constructor.ConstructorError(
                    None, None, "a field's name must be plain", key.start_mark
                )
            if key.value in seen:
                raise yaml.constructor.ConstructorError(
                    None, None, f"field {spelled(key.value)} is given twice", key.start_mark
                )
            seen.add(key.value)
        return super().construct_mapping(node, deep)


_OTHERWISE = ("timestamp", "int", "float")
"""Kinds of YAML that are read by other rules, or not at all: 1:30 is no number to the base 60."""

_PlainLoader.yaml_implicit_resolvers = {
    first: [(tag, pattern) for tag, pattern in resolvers if tag.rpartition(":")[2] not in _OTHERWISE]
    for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
}
_PlainLoader.add_implicit_resolver(
    "tag:yaml.org,2002:int", re.compile(r"^[-+]?(0|[1-9]\d*)$"), list("-+0123456789")
)
_PlainLoader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"^[-+]?(\d+(\.\d*)?|\.\d+)([eE][-+]?\d+)?$|^[-+]?\.(inf|Inf|INF)$|^\.(nan|NaN|NAN)$"),
    list("-+0123456789."),
)


def _without_duplicates(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    fields = dict(pairs)
    if len(fields) != len(pairs):
        twice = next(name for name, count in Counter(name for name, _ in pairs).items() if count > 1)
        raise ValueError(f"field {spelled(twice)} is given twice")
    return fields
