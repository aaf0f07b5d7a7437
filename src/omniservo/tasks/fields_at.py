"""What fields a place in a task's file may have."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import get_args

from omniservo.tasks.section import Section, names_in_file, sections_in


def fields_at(place: Sequence[str | int], document: type[Section]) -> tuple[str, ...]:
    """Return the legal names in the section at ``place``: of fields, places in lists, kinds of obstacles.

    ``document`` is the whole file's.
    """
    sections: list[type[Section]] = [document]
    for part in place:
        inner = [s for section in sections for s in _sections_of(section, part)]
        kinds = [s for s in sections if part == _kind(s)]
        sections = inner or kinds or sections
    found = (names_in_file(n, field)[0] for section in sections for n, field in section.model_fields.items())
    return tuple(dict.fromkeys(found))


def _sections_of(section: type[Section], part: str | int) -> Iterator[type[Section]]:
    for name, field in section.model_fields.items():
        if part in names_in_file(name, field):
            yield from sections_in(field.annotation)


def _kind(section: type[Section]) -> str | None:
    """Return what ``type`` says in a section of this class."""
    field = section.model_fields.get("type")
    return None if field is None else str(get_args(field.annotation)[0])
