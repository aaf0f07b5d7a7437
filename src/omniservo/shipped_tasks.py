"""Where task files are: found without loading what runs them, so that a wrong name is reported at once."""

from __future__ import annotations

from pathlib import Path

from omniservo.errors import InputError, did_you_mean
from omniservo.files import is_file

_FOLDER = Path(__file__).parent / "tasks" / "shipped"


def shipped_tasks() -> tuple[str, ...]:
    """Names of the tasks that come with the package, sorted."""
    return tuple(sorted(file.stem for file in _FOLDER.glob("*.yaml")))


def task_file(task: str | Path) -> Path:
    """Return the file of a task: a name of `shipped_tasks`, or a file. A name wins over a file called so.

    Raises:
        InputError: neither.
    """
    names = shipped_tasks()
    path = _FOLDER / f"{task}.yaml" if str(task) in names else Path(task)
    if not is_file(path):
        raise InputError(
            f"task {str(task)!r}: neither a file nor one of the shipped tasks: {', '.join(names)}"
            f"{did_you_mean(task, names)}"
        )
    return path
