"""Where study files are: found without loading what runs them, so that a wrong name is reported at once."""

from __future__ import annotations

from pathlib import Path

from omniservo.files.shipped_files import ShippedFiles

_SHIPPED = ShippedFiles(Path(__file__).parent / "studies" / "shipped", "study", "studies")


def shipped_studies() -> tuple[str, ...]:
    """Names of the studies that come with the package, sorted."""
    return _SHIPPED.names()


def study_file(study: str | Path) -> Path:
    """Return the file of a study: a name of `shipped_studies`, or a file. A name wins over a file called so.

    Raises:
        InputError: neither.
    """
    return _SHIPPED.find(study)
