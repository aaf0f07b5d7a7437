"""Where task files are: found without loading what runs them, so that a wrong name is reported at once."""

from __future__ import annotations

from pathlib import Path

from omniservo.files.shipped_files import ShippedFiles

_SHIPPED = ShippedFiles(Path(__file__).parent / "tasks" / "shipped", "task", "tasks")


def shipped_tasks() -> tuple[str, ...]:
    """Names of the tasks that come with the package, sorted."""
    return _SHIPPED.names()


def task_file(task: str | Path) -> Path:
    """Return the file of a task: a name of `shipped_tasks`, or a file. A name wins over a file called so.

    Raises:
        InputError: neither.
    """
    return _SHIPPED.find(task)
