"""Files that come with the package, by name: found without loading what reads them."""

from __future__ import annotations

from pathlib import Path

from omniservo.errors import InputError, did_you_mean
from omniservo.files.documents import is_file


class ShippedFiles:
    """The YAML files of one folder of the package.

    Args:
        folder: where they are.
        kind: what one of them is, for messages.
        kinds: several.
    """

    def __init__(self, folder: Path, kind: str, kinds: str) -> None:
        self._folder, self._kind, self._kinds = folder, kind, kinds

    def names(self) -> tuple[str, ...]:
        """Return their names, sorted."""
        return tuple(sorted(file.stem for file in self._folder.glob("*.yaml")))

    def find(self, given: str | Path) -> Path:
        """Return the file of a name, or the file that is given. A name wins over a file called so.

        Raises:
            InputError: neither.
        """
        names = self.names()
        path = self._folder / f"{given}.yaml" if str(given) in names else Path(given)
        if not is_file(path):
            raise InputError(
                f"{self._kind} {str(given)!r}: neither a file nor one of the shipped {self._kinds}: "
                f"{', '.join(names)}{did_you_mean(given, names)}"
            )
        return path
