"""The program that runs rows: this package, and methods from files."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path

import omniservo
from omniservo.errors import InputError, spelled
from omniservo.files import read_bytes
from omniservo.run_methods import RunMethod, run_method
from omniservo.servoing import ServoMethod, servo_method
from omniservo.servoing.own_method import OwnMethod

_PACKAGE = Path(omniservo.__file__).parent

ROOMS_APART = (
    "cli", "drive", "hardware", "looks", "recording", "reporting", "results", "ros_messages", "runs",
    "schemas", "simulation", "viewer",
)  # fmt: skip
"""Studies import nothing of them, nor does what they import: no row can rest on them."""


@dataclass(frozen=True)
class OwnSource:
    """A method of the user's own with its code, so that it can be run where the file is not."""

    name: str
    """``FILE.CLASS``, as rows have it"""
    source: str
    """``FILE.py:CLASS``"""
    code: bytes

    @classmethod
    def read(cls, source: str) -> OwnSource:
        """Return the method that ``FILE.py:CLASS`` names.

        Raises:
            InputError: not of this form, or no such file.
        """
        method = run_method(source)
        if method.source is None:
            raise InputError(f"method file: {spelled(source)} given; legal: FILE.py:CLASS")
        return cls(method.name, source, read_bytes(source.rpartition(":")[0]))


@dataclass(frozen=True)
class Program:
    """What turns a study and a row's number into the row."""

    own: tuple[OwnSource, ...] = ()
    """methods from files"""

    @classmethod
    def of(cls, sources: Sequence[str]) -> Program:
        """Return this package with methods ``FILE.py:CLASS``.

        Raises:
            InputError: one cannot be read, has no such class, or two have one name.
        """
        program = cls(tuple(map(OwnSource.read, sources)))
        if len(set(program.names)) != len(sources):
            raise InputError(f"method file: {', '.join(program.names)}: a name is given twice")
        for name in program.names:
            program.law(name, 1.0)  # that it is a method is said before anything is run
        return program

    def __reduce__(self) -> tuple[type[Program], tuple[tuple[OwnSource, ...]]]:
        return Program, (self.own,)  # not `version`, which each process finds of its own package

    @property
    def names(self) -> tuple[str, ...]:
        """Of the methods from files."""
        return tuple(own.name for own in self.own)

    @cached_property
    def version(self) -> str:
        """The package's version and 8 hexadecimal digits of all code that a row can rest on."""
        digest = hashlib.sha256(_package_digest())
        for own in self.own:
            digest.update(f"{own.name} {len(own.code)} ".encode() + own.code)
        return f"{omniservo.__version__}+{digest.hexdigest()[:8]}"

    def method(self, name: str) -> RunMethod:
        """Return what is known of a method by its name.

        Raises:
            InputError: it is neither this package's nor one of `own`.
        """
        own = next((own for own in self.own if own.name == name), None)
        return run_method(name) if own is None else RunMethod(name, name, source=own.source)

    def law(self, name: str, gain: float) -> ServoMethod:
        """Return a new one of a method without a plan, with its gain [1/s].

        Raises:
            InputError: no such method, or no such class in its file.
        """
        own = next((own for own in self.own if own.name == name), None)
        return servo_method(name, gain) if own is None else OwnMethod(own.source, gain, own.code)


PACKAGE = Program()
"""This package alone."""


@cache
def _package_digest() -> bytes:
    """Return a digest of the package's sources, but for the rooms apart from studies, and of its arms."""
    digest = hashlib.sha256()
    for path in sorted((*_PACKAGE.rglob("*.py"), *(_PACKAGE / "robots" / "shipped").glob("*.xml"))):
        place = path.relative_to(_PACKAGE)
        if place.parts[0] not in ROOMS_APART:
            content = path.read_bytes()
            digest.update(f"{place.as_posix()} {len(content)} ".encode() + content)
    return digest.digest()
