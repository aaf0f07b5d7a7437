"""Results written whole or not at all."""

from __future__ import annotations

import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from itertools import count
from pathlib import Path
from typing import BinaryIO

from omniservo.errors import AlreadyExists, InputError, NotWritten, spelled


def writable(path: str | Path, *, force: bool = False) -> None:
    """Refuse a result's path before the work is done, not after it.

    Raises:
        InputError: the path exists and ``force`` is False, or it holds the working folder, or its folder does
            not exist.
    """
    target = Path(path)
    _replaceable(target)
    if exists(target) and not force:
        raise AlreadyExists(path)
    if not target.parent.is_dir():
        raise InputError(f"{path}: its folder {target.parent} does not exist")


def exists(path: Path) -> bool:
    """Say whether anything is at this path.

    Raises:
        InputError: a path that no file can have.
    """
    try:
        return path.exists()
    except (OSError, ValueError):
        raise InputError(f"{spelled(str(path))}: not a path that a file can have") from None


def _replaceable(path: Path) -> None:
    """Refuse the working folder and those that it lies in: with it all that is there would go.

    Raises:
        InputError: it is one of them.
    """
    try:
        here = Path.cwd()
    except FileNotFoundError:  # it was removed
        return
    if exists(path) and here.is_relative_to(path.resolve()):
        raise InputError(f"{path}: holds the folder that this is run in; legal: another")


def write_whole(path: str | Path, content: str | bytes, *, force: bool = False) -> None:
    """Write a file whole or not at all: into a temporary file beside it, then renamed.

    Raises:
        InputError: the file exists and ``force`` is False, or it cannot be written (`NotWritten`).
    """
    data = content.encode() if isinstance(content, str) else content
    with _whole(path, force=force) as stream:
        stream.write(data)


def copy_whole(source: Path, path: str | Path, *, force: bool = False) -> None:
    """Copy a file, however large, whole or not at all.

    Raises:
        InputError: as `write_whole`, or the source cannot be read (`NotWritten`).
    """
    with _whole(path, force=force) as stream, source.open("rb") as read:
        shutil.copyfileobj(read, stream)


@contextmanager
def _whole(path: str | Path, *, force: bool) -> Iterator[BinaryIO]:
    """Give a temporary file that becomes ``path`` if the block ends well, and vanishes otherwise."""
    file = Path(path)
    writable(file, force=force)
    if file.exists() and not file.is_file():
        raise InputError(f"{path}: {'a folder' if file.is_dir() else 'a device or pipe'}; a file is needed")
    temporary = _temporary(file)
    try:
        stream = temporary.open("xb")
    except OSError as error:
        raise NotWritten(path, error.strerror or str(error)) from None
    try:
        with stream:
            yield stream
        _named(temporary, file, force=force)
    except BaseException as error:
        temporary.unlink(missing_ok=True)
        if isinstance(error, OSError):
            raise NotWritten(path, error.strerror or str(error)) from None
        raise


def _temporary(path: Path) -> Path:
    """Return a free name beside a path: what `tempfile` makes is the user's alone, whatever the umask."""
    return path.with_name(f".{path.name}.{secrets.token_hex(4)}")


def _named(temporary: Path, file: Path, *, force: bool) -> None:
    """Give a whole file its name; without force one that came there meanwhile stays.

    Raises:
        AlreadyExists: there is one.
        OSError: it cannot have the name.
    """
    if not force:
        try:
            os.link(temporary, file)
        except FileExistsError:
            raise AlreadyExists(file) from None
        except OSError:  # of a file system without hard links
            pass
        else:
            temporary.unlink()
            return
    temporary.replace(file)


def writable_folder(path: str | Path, known_by: str, *, force: bool = False) -> None:
    """Refuse a folder of results before the work is done, not after it.

    Args:
        path: of the folder.
        known_by: a file that every folder of such results has.
        force: an existing one may be replaced.

    Raises:
        InputError: the path exists and ``force`` is False, or it is no such folder, or holds the working
            folder.
    """
    folder = Path(path)
    _replaceable(folder)
    if not exists(folder):
        return
    if not force:
        raise AlreadyExists(path)
    if not folder.is_dir():
        raise InputError(f"{path}: a file; a folder is needed")
    if any(folder.iterdir()) and not (folder / known_by).exists():
        raise InputError(
            f"{path}: holds other files, and no {known_by}; legal with --force: a folder of earlier results"
        )


@contextmanager
def made_folder(path: str | Path) -> Iterator[Path]:
    """Make a folder, and those that it lies in; where the block fails, what was made and is empty goes again.

    Raises:
        InputError: the folder cannot be made (`NotWritten`), or no file can have such a path.
    """
    folder = Path(path)
    made = [each for each in (folder, *folder.parents) if not exists(each)]
    try:
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise NotWritten(path, error.strerror or str(error)) from None
        yield folder
    except BaseException:
        with suppress(OSError):  # the first that is not empty, and those that it lies in, stay
            for each in made:
                each.rmdir()
        raise


@contextmanager
def whole_folder(path: str | Path, known_by: str, *, force: bool = False, room: int = 0) -> Iterator[Path]:
    """Give an empty temporary folder that becomes ``path`` if the block ends well, and vanishes otherwise.

    Where a file in it cannot be written, the whole files that were are kept in ``path``.incomplete.

    Args:
        path: of the folder.
        known_by: a file that the block writes in it; another folder that has none is not replaced.
        force: an existing one may be replaced.
        room: what the block is going to write [bytes].

    Raises:
        InputError: the folder is not `writable_folder`, its parent cannot be written, or the disk has less
            than ``room`` or gets full.
    """
    writable_folder(path, known_by, force=force)
    folder = Path(path)
    if folder.is_symlink():
        folder = folder.resolve()
    try:
        free = shutil.disk_usage(next(p for p in folder.absolute().parents if p.is_dir())).free
    except OSError as error:
        raise NotWritten(path, error.strerror or str(error)) from None
    if free < room:
        raise NotWritten(path, f"{free // 2**20} MiB are free there; about {room // 2**20} are needed")
    with made_folder(folder.parent), _becoming(folder, force=force) as temporary:
        yield temporary


@contextmanager
def _becoming(folder: Path, *, force: bool) -> Iterator[Path]:
    """Give a temporary folder beside ``folder``; see `whole_folder`."""
    temporary = _temporary(folder)
    try:
        temporary.mkdir()
    except OSError as error:
        raise NotWritten(folder, error.strerror or str(error)) from None
    try:
        yield temporary
        if folder.exists() and not force:  # it was not when the work began
            raise NotWritten(folder, "exists by now")
        if folder.exists():
            shutil.rmtree(folder)
        temporary.replace(folder)
    except (NotWritten, OSError) as error:
        path, reason = _failed(error, folder)
        raise NotWritten(_in(folder, path, temporary), f"{reason}; {_kept(temporary, folder)}") from None
    except BaseException:
        shutil.rmtree(temporary, ignore_errors=True)
        raise


def _failed(error: NotWritten | OSError, folder: Path) -> tuple[Path, str]:
    if isinstance(error, NotWritten):
        return Path(error.path), error.reason
    return Path(error.filename or folder), error.strerror or str(error)


def _in(folder: Path, file: Path, temporary: Path) -> Path:
    """Return where a file would have come to be."""
    return folder / file.relative_to(temporary) if file.is_relative_to(temporary) else file


def _kept(temporary: Path, folder: Path) -> str:
    """Give the files that were written a place that a person finds, and say so."""
    if not any(file.is_file() for file in temporary.rglob("*")):
        shutil.rmtree(temporary, ignore_errors=True)
        return "nothing was written"
    place = unused(folder.with_name(f"{folder.name}.incomplete"))
    temporary.replace(place)
    return f"what was written before is kept in {place}"


def unused(path: Path) -> Path:
    """Return the path, with a number at its end where it exists."""
    numbered = (path.with_name(f"{path.name}-{number}") for number in count(2))
    return path if not path.exists() else next(p for p in numbered if not p.exists())
