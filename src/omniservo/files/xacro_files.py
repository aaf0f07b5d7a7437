"""xacro files, expanded to the URDF that they stand for.

xacro is a language: a file's expressions are evaluated as Python, and it reads what it includes. The guard of
the xacro package against hostile expressions is known to be weak, so a file is expanded only where a person
says so, never because another file names it. The work is done in a process of its own, bounded in time and
memory, which holds accidents, not attackers.
"""

from __future__ import annotations

import io
import json
import resource
import subprocess
import sys
from collections.abc import Mapping
from contextlib import redirect_stderr
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any

from omniservo.errors import InputError, did_you_mean, spelled
from omniservo.files import read_text
from omniservo.files.ros_packages import RosPackages
from omniservo.files.xml_files import XmlElement

_MOST_SECONDS = 30
_MOST_MEMORY = 2**30
_LARGEST = 4 * 2**20
"""[bytes] of a file, and [characters] of what it expands to"""
_LONGEST = 500
"""[characters] of what xacro says"""


def expand_xacro(
    path: str | Path,
    arguments: Mapping[str, str] | None = None,
    packages: Mapping[str, str | Path] | None = None,
) -> str:
    """Return the URDF that a xacro file stands for; meshes of packages are named ``package://NAME/…``.

    This evaluates the Python expressions of the file and of all that it includes, with the rights of the
    caller: only for files whose author is trusted.

    Args:
        path: of the file.
        arguments: of the file's ``<xacro:arg>`` elements.
        packages: folders of ROS packages by name, for ``$(find NAME)``; others are looked for above and
            beside the file, in ROS_PACKAGE_PATH and in AMENT_PREFIX_PATH.

    Raises:
        InputError: the package xacro is not installed, the file has no such argument, or xacro cannot expand
            it; the message says why, and in which macro.
    """
    file = Path(path)
    read_text(file, max_bytes=_LARGEST)
    if find_spec("xacro") is None:
        raise InputError(f"{file}: the package xacro, which expands it, is not installed: pip install xacro")
    RosPackages(file, packages)  # a wrong folder is said before the work
    stated = {name: str(Path(folder).resolve()) for name, folder in (packages or {}).items()}
    asked = {"file": str(file.resolve()), "arguments": dict(arguments or {}), "packages": stated}
    try:
        done = subprocess.run(
            [sys.executable, "-P", "-m", "omniservo.files.xacro_files"],
            input=json.dumps(asked), capture_output=True, text=True, timeout=_MOST_SECONDS, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        raise InputError(f"{file}: xacro was not done after {_MOST_SECONDS} s") from None
    try:
        answer = json.loads(done.stdout)
    except ValueError:
        answer = {"error": f"more than {_MOST_MEMORY // 2**20} MiB or {_MOST_SECONDS} s of work"}
    if "error" in answer:
        raise InputError(f"{file}: xacro cannot expand it: {answer['error']}")
    if len(answer["text"]) > _LARGEST:
        raise InputError(f"{file}: expands to {len(answer['text'])} characters; at most {_LARGEST} are read")
    return str(answer["text"])


def xacro_advice(root: XmlElement, file: Path) -> str | None:
    """Return what to do with a robot's file that is xacro; None: it is not."""
    used = [e for e in root.iter() if isinstance(e, XmlElement) and e.tag.startswith("xacro:")]
    if not used:
        return None
    needed = dict.fromkeys(e.get("name", "") for e in used if e.tag == "xacro:arg" and not e.get("default"))
    name = file.name.removesuffix(".xacro").removesuffix(".urdf")
    command = " ".join(
        ["omniservo robot expand", str(file), *(f"{n}:=…" for n in needed), f"--out {name}.urdf"]
    )
    if find_spec("xacro") is None:
        command = f"pip install xacro, then {command}"
    return f"a xacro file, to be expanded first, which evaluates its expressions: {command}"


def _expanded(asked: dict[str, Any]) -> str:
    """Expand in this process, which does nothing else."""
    packages = RosPackages(Path(asked["file"]), asked["packages"])
    found: dict[str, str] = {}

    def get_package_share_directory(name: str) -> str:
        found[name] = str(packages.root("$(find)", name))
        return found[name]

    # what xacro asks for $(find NAME)
    ament = ModuleType("ament_index_python.packages")
    ament.get_package_share_directory = get_package_share_directory  # type: ignore[attr-defined]
    sys.modules["ament_index_python"] = ModuleType("ament_index_python")
    sys.modules["ament_index_python.packages"] = ament
    import xacro  # type: ignore[import-not-found,import-untyped,unused-ignore]

    arguments = _Arguments(asked["arguments"])
    document = xacro.process_file(asked["file"], mappings=arguments)
    for name in asked["arguments"]:
        if name not in arguments.used:
            known = [other for other in arguments if other in arguments.used]
            raise InputError(
                f"argument {spelled(name)}: the file has none of this name; legal: "
                f"{', '.join(known) or 'none'}{did_you_mean(name, known)}"
            )
    for element in document.getElementsByTagName("mesh"):
        named = element.getAttribute("filename")
        element.setAttribute("filename", _in_package(named, found))
    return str(document.toprettyxml(indent="  "))


class _Arguments(dict[str, str]):
    """Arguments of a file by name, which know which of them it used."""

    def __init__(self, given: Mapping[str, str]) -> None:
        super().__init__(given)
        self.used: set[object] = set()

    def __contains__(self, name: object) -> bool:
        self.used.add(name)
        return super().__contains__(name)

    def __getitem__(self, name: str) -> str:
        self.used.add(name)
        return super().__getitem__(name)


def _in_package(reference: str, found: Mapping[str, str]) -> str:
    """Return a mesh's absolute path as one in the package that it lies in."""
    path = "/" + reference.removeprefix("file://").lstrip("/")
    for name, root in found.items():
        if reference.startswith(("file://", "/")) and path.startswith(root + "/"):
            return f"package://{name}/{path.removeprefix(root + '/')}"
    return reference


def _words(error: BaseException) -> str:
    """Return what xacro says in one line, or what was said to it of a package."""
    inner = error
    while isinstance(wrapped := getattr(inner, "exc", None), BaseException):
        inner = wrapped
    if isinstance(inner, InputError):
        return str(inner)
    said = " ".join(str(error).split())[:_LONGEST] or type(error).__name__
    return f"{said}; {_place()}"


def _place() -> str:
    """Return in which macro of which file xacro was."""
    import xacro  # type: ignore[import-not-found,import-untyped,unused-ignore]

    with redirect_stderr(io.StringIO()) as said:
        xacro.print_location()
    return " ".join(said.getvalue().split())[:_LONGEST]


def _answer() -> None:
    """Read requests from standard input and answer on standard output."""
    resource.setrlimit(resource.RLIMIT_AS, (_MOST_MEMORY, _MOST_MEMORY))
    resource.setrlimit(resource.RLIMIT_CPU, (_MOST_SECONDS, _MOST_SECONDS))
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))
    asked, words = json.load(sys.stdin), sys.stdout
    sys.stdout = sys.stderr  # xacro's own prints are no answer
    try:
        answer = {"text": _expanded(asked)}
    except Exception as error:  # whatever the file's expressions raise
        answer = {"error": _words(error)}
    json.dump(answer, words)


if __name__ == "__main__":
    _answer()
