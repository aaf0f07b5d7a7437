"""ROS packages by name: the folders that ``package://NAME/…`` and ``$(find NAME)`` mean."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from pathlib import Path, PurePosixPath

from omniservo.errors import InputError, spelled
from omniservo.files import file_inside, is_file, read_text
from omniservo.files.xml_files import parse_elements

_LEVELS = 6
"""folders above the file that are searched for a package"""
_LARGEST_MANIFEST = 2**16
"""[bytes] of a package.xml"""


class RosPackages:
    """Knows where packages are: as stated, near the file, in ROS_PACKAGE_PATH or AMENT_PREFIX_PATH."""

    def __init__(self, file: Path, stated: Mapping[str, str | Path] | None = None) -> None:
        """Prepare for the packages that a robot's file names.

        Args:
            file: the robot's.
            stated: folders by the package's name; they win.

        Raises:
            InputError: a stated folder does not exist.
        """
        self._folder = file.resolve().parent
        self._stated = {name: Path(folder) for name, folder in (stated or {}).items()}
        for name, folder in self._stated.items():
            if not folder.is_dir():
                raise InputError(f"package {spelled(name)}: {folder}: no such folder")

    def find(self, place: str, name: str, inner: str) -> Path:
        """Return the file ``inner`` of a package; ``place`` stands first in messages.

        Nothing outside the package is returned; links are followed only in packages that the user's own
        setup names: as stated, or in one of the two variables.

        Raises:
            InputError: no such package or file.
        """
        if not _is_plain(name):
            raise InputError(f"{place}: package {spelled(name)} given; legal: the name of a folder")
        known = list(self._known(name))
        near = [] if name in self._stated else list(self._near(name))
        for root in near:
            if is_file(file := file_inside(place, inner, root)):
                return file
        for root in known:
            if is_file(file := _within(place, inner, root)):
                return file
        if near or known:
            root = (near + known)[0]
            raise InputError(f"{place}: {spelled(inner)}: no such file in the package {root}")
        raise self._unknown(place, name)

    def root(self, place: str, name: str) -> Path:
        """Return a package's folder; see `find`.

        Raises:
            InputError: no such package.
        """
        if not _is_plain(name):
            raise InputError(f"{place}: package {spelled(name)} given; legal: the name of a folder")
        near = iter(()) if name in self._stated else self._near(name)
        root = next(near, None) or next(self._known(name), None)
        if root is None:
            raise self._unknown(place, name)
        return root

    def _near(self, name: str) -> Iterator[Path]:
        """Look among and beside the folders above the file."""
        for above in [self._folder, *self._folder.parents][:_LEVELS]:
            if (above.name == name and above.is_dir()) or _manifest_name(above) == name:
                yield above
            if (above / name).is_dir():
                yield above / name

    def _known(self, name: str) -> Iterator[Path]:
        """Look where the user says, or else in the variables of ROS."""
        if name in self._stated:
            yield self._stated[name]
            return
        for entry in _entries("ROS_PACKAGE_PATH"):
            if entry.name == name or _manifest_name(entry) == name:
                yield entry
            if (entry / name).is_dir():
                yield entry / name
        for entry in _entries("AMENT_PREFIX_PATH"):
            if (entry / "share" / name).is_dir():
                yield entry / "share" / name

    def _unknown(self, place: str, name: str) -> InputError:
        return InputError(
            f"{place}: package {spelled(name)}: not among the {_LEVELS} folders above the file nor beside "
            f"them (from {self._folder} upwards), nor in ROS_PACKAGE_PATH or AMENT_PREFIX_PATH; say where "
            f"it is: --package {name}=FOLDER"
        )


def _is_plain(name: str) -> bool:
    return name not in ("", ".", "..") and "/" not in name and "\0" not in name


def _entries(variable: str) -> list[Path]:
    return [
        folder for entry in os.environ.get(variable, "").split(":") if (folder := Path(entry)).is_absolute()
    ]


def _within(place: str, inner: str, root: Path) -> Path:
    """Return a file of a package that the user trusts, whose links may lead elsewhere."""
    parts = PurePosixPath(inner).parts
    if ".." in parts or inner.startswith("/") or "\0" in inner:
        raise InputError(f"{place}: {spelled(inner)} given; legal: a path inside the package")
    return root.joinpath(*parts)


def _manifest_name(folder: Path) -> str | None:
    """Return what a folder's package.xml calls it; None: it has none."""
    manifest = folder / "package.xml"
    if not is_file(manifest):
        return None
    try:
        root = parse_elements(read_text(manifest, max_bytes=_LARGEST_MANIFEST), str(manifest))
    except InputError:
        return None
    return (root.findtext("name") or "").strip()
