"""What the shell completes: names of tasks, cameras and arms that come with the package.

Files are completed by the shell itself where no name fits.
"""

from __future__ import annotations

from collections.abc import Iterable


def task_names(incomplete: str) -> list[str]:
    """Return the shipped tasks whose names begin so."""
    from omniservo.shipped_tasks import shipped_tasks

    return _begin_with(incomplete, shipped_tasks())


def camera_names(incomplete: str) -> list[str]:
    """Return the camera presets whose names begin so."""
    from omniservo.cameras import PRESETS

    return _begin_with(incomplete, PRESETS)


def arm_names(incomplete: str) -> list[str]:
    """Return the shipped arms whose names begin so."""
    from omniservo.robots import shipped_arms

    return _begin_with(incomplete, shipped_arms())


def _begin_with(incomplete: str, names: Iterable[str]) -> list[str]:
    return [name for name in names if name.startswith(incomplete)]
