"""The files that a task names."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from omniservo.errors import InputError, spelled
from omniservo.files import file_inside


@dataclass(frozen=True)
class TaskFiles:
    """Finds the files that a task names.

    A task need not be trusted: whoever wrote it must not be able to have other files of its reader looked
    into. So it reads nothing outside its folder, unless its reader allows it.
    """

    source: str
    """the task; stands first in messages"""
    folder: Path
    """that the task lies in"""
    allow_outside: bool = False
    """its reader trusts it with files elsewhere"""

    def path(self, field: str, value: str) -> Path:
        """Return the path of a file that a field of the task names.

        Raises:
            InputError: it leaves the task's folder, and that is not allowed.
        """
        if self.allow_outside:
            try:
                return (self.folder / value).resolve()
            except (OSError, RuntimeError, ValueError):  # too long, links in a ring, or with a zero in it
                raise InputError(f"{self.source}: {field}: {spelled(value)} given; legal: a path") from None
        try:
            return file_inside(f"{self.source}: {field}", value, self.folder)
        except InputError as error:
            raise InputError(f"{error}; --allow-outside allows any (allow_outside=True)") from None
