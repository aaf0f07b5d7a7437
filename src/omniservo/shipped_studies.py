"""Where study files are: found without loading what runs them, so that a wrong name is reported at once."""

from __future__ import annotations

from pathlib import Path

from omniservo.errors import InputError, did_you_mean
from omniservo.files import is_file

_FOLDER = Path(__file__).parent / "studies" / "shipped"


def shipped_studies() -> tuple[str, ...]:
    """Names of the studies that come with the package, sorted."""
    return tuple(sorted(file.stem for file in _FOLDER.glob("*.yaml")))


def study_file(study: str | Path) -> Path:
    """Return the file of a study: a name of `shipped_studies`, or a file. A name wins over a file called so.

    Raises:
        InputError: neither.
    """
    names = shipped_studies()
    path = _FOLDER / f"{study}.yaml" if str(study) in names else Path(study)
    if not is_file(path):
        raise InputError(
            f"study {str(study)!r}: neither a file nor one of the shipped studies: {', '.join(names)}"
            f"{did_you_mean(study, names)}"
        )
    return path
