"""What of this machine matters to omniservo, checked: what is found, and what to do where it is wrong."""

from __future__ import annotations

import os
import platform
import re
import shutil
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, distribution, version
from pathlib import Path
from typing import Literal

from omniservo.cli.compiled_record import CompiledRecord
from omniservo.errors import InputError
from omniservo.geometry.kernel_cache import kernel_folders, user_folder

Verdict = Literal["ok", "note", "wrong"]
"""note: everything works, and something could be better or is not there"""

GIVES = {
    "study": "rows of studies as Parquet, in place of CSV",
    "cluster": "studies on a Dask cluster: omniservo study --scheduler",
    "view": "the live page: omniservo view",
    "ros2": "real arms and cameras by ROS 2, without a ROS installation",
    "xacro": "robots' descriptions in xacro files",
}
"""What each extra of the package is for."""

_FEWEST_CORES = 2
"""A real arm's loop has a process of its own, and rendering takes two threads."""

_LEAST_MEMORY = 2**30
"""[bytes] A whole run takes about half of it."""

_LEAST_DISK = 2**28
"""[bytes] A folder of results has at most 20 MB, all kernels about as much."""

_SLEEP, _SLEEPS, _LATE = 1e-3, 100, 2e-3
"""[s] of a sleep, how many, and [s] too late that disturb a loop of 200 Hz"""

_MEMORY = Path("/proc/meminfo")
_DEVICES = Path("/dev")
_MB = 1e6


@dataclass(frozen=True)
class Check:
    """One thing that was looked into."""

    name: str
    verdict: Verdict
    found: str
    """in words"""
    next_step: str = ""
    """what to do; empty where there is nothing to do"""
    values: dict[str, object] = field(default_factory=dict)
    """what was found, for a program"""


def machine_checks() -> Iterator[Check]:
    """Yield every check."""
    yield from (_python(), *_packages(), _cores(), _memory(), _disk(Path.cwd(), "disk"))
    yield from (_cache(), _cameras(), _timer(), *_extras())


def _python() -> Check:
    found = platform.python_version()
    needed = str(distribution("omniservo").metadata["Requires-Python"] or "")
    values: dict[str, object] = {"version": found, "needed": needed}
    if _is_within(found, needed):
        return Check("python", "ok", f"{found} ({needed} is needed)", values=values)
    step = f"install omniservo with a Python that is {needed}"
    return Check("python", "wrong", f"{found}; {needed} is needed", step, values)


def _packages() -> Iterator[Check]:
    """Yield a check of the packages that are always needed, and of Numba itself."""
    needed = _requirements(None)
    bad = [words for name, bounds in needed.items() if (words := _missing(name, bounds))]
    values: dict[str, object] = {"packages": len(needed), "wrong": bad}
    step = "pip install --upgrade omniservo, into the environment that this command is in"
    if bad:
        yield Check("packages", "wrong", "; ".join(bad), step, values)
        return
    yield Check("packages", "ok", f"all {len(needed)} that are needed are there", values=values)
    try:
        import numba
    except Exception as error:  # it refuses Pythons and NumPys that it does not know by errors of its own
        yield Check("numba", "wrong", f"cannot be imported: {error}", step)
        return
    yield Check("numba", "ok", f"{numba.__version__}, works with this Python and NumPy {version('numpy')}")


def _extras() -> Iterator[Check]:
    for extra in distribution("omniservo").metadata.get_all("Provides-Extra") or ():
        needed = _requirements(extra)
        bad = [words for name, bounds in needed.items() if (words := _missing(name, bounds))]
        what = GIVES.get(extra, ", ".join(needed))
        values: dict[str, object] = {"installed": not bad}
        if bad:
            step = f'pip install "omniservo[{extra}]", if you want that'
            yield Check(f"extra {extra}", "note", f"not installed: {what}", step, values)
        else:
            yield Check(f"extra {extra}", "ok", f"installed: {what}", values=values)


def _cores() -> Check:
    there = os.cpu_count() or 1
    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else there
    values: dict[str, object] = {"usable": usable, "there": there}
    words = f"{usable} that may be used, of {there}"
    if usable >= _FEWEST_CORES:
        return Check("cores", "ok", words, values=values)
    step = "give the process two cores: images are rendered late, and a real arm's loop has none to itself"
    return Check("cores", "wrong", words, step, values)


def _memory() -> Check:
    found = re.search(r"MemAvailable: +(\d+) kB", _MEMORY.read_text()) if _MEMORY.is_file() else None
    if found is None:
        return Check("memory", "note", f"unknown: no {_MEMORY}")
    free = 1024 * int(found[1])
    values: dict[str, object] = {"available_bytes": free}
    words = f"{free / 2**30:.1f} GiB available"
    if free >= _LEAST_MEMORY:
        return Check("memory", "ok", words, values=values)
    return Check("memory", "wrong", words, "end other programs: a run needs up to 1 GiB", values)


def _disk(folder: Path, name: str) -> Check:
    free = shutil.disk_usage(folder).free
    values: dict[str, object] = {"folder": str(folder), "free_bytes": free}
    words = f"{free / 2**30:.1f} GiB free in {folder}"
    if not os.access(folder, os.W_OK):
        step = "change to a folder that is yours, or name one with --out"
        return Check(name, "wrong", f"{folder} cannot be written to", step, values)
    if free < _LEAST_DISK:
        return Check(name, "wrong", words, "make room: a run's results take some 20 MB", values)
    return Check(name, "ok", words, values=values)


def _cache() -> Check:
    """Check where compiled kernels are kept: whether they are all there, and whether more can be."""
    folder = user_folder()
    files = {file.name: file for place in kernel_folders() for file in place.glob("*.kernel")}
    size = sum(file.stat().st_size for file in files.values())
    complete = CompiledRecord().is_complete()
    there = next(place for place in (folder, *folder.parents) if place.is_dir())
    writable = os.access(there, os.W_OK)
    values: dict[str, object] = {
        "folder": str(folder), "kernels": len(files), "bytes": size, "complete": complete,
        "writable": writable,
    }  # fmt: skip
    words = f"{len(files)} compiled functions, {size / _MB:.0f} MB, in {folder}"
    if not writable:
        step = "set XDG_CACHE_HOME to a folder that is yours; else all is compiled again in every process"
        return Check("kernels", "wrong", f"{words}, which cannot be written to", step, values)
    if shutil.disk_usage(there).free < _LEAST_DISK:
        return Check("kernels", "wrong", f"{words}; the disk is full", "make room there", values)
    if not complete:
        return Check("kernels", "note", f"{words}; not all yet", "omniservo warm-up", values)
    return Check("kernels", "ok", f"all compiled: {words}", values=values)


def _cameras() -> Check:
    devices = sorted(_DEVICES.glob("video*"))
    closed = [str(device) for device in devices if not os.access(device, os.R_OK | os.W_OK)]
    values: dict[str, object] = {"devices": [str(device) for device in devices], "closed": closed}
    if not devices:
        return Check(
            "cameras", "note", "no /dev/video*; network cameras and image files need none", "", values
        )
    if closed:
        step = 'sudo usermod -aG video "$USER", then log in again'
        return Check("cameras", "wrong", f"{', '.join(closed)}: you may not open it", step, values)
    return Check("cameras", "ok", f"{', '.join(map(str, devices))} may be opened", values=values)


def _timer() -> Check:
    """Check by how much a sleeping process is woken too late."""
    late = []
    for _ in range(_SLEEPS):
        begin = time.perf_counter()
        time.sleep(_SLEEP)
        late.append(time.perf_counter() - begin - _SLEEP)
    late.sort()
    typical, most = late[_SLEEPS // 2], late[-2]  # all but one of a hundred
    values: dict[str, object] = {"median_late_s": typical, "p98_late_s": most}
    words = f"woken {1e3 * typical:.2f} ms too late, 98% within {1e3 * most:.2f} ms"
    if most <= _LATE:
        return Check("timer", "ok", words, values=values)
    step = "end what else runs before a real arm is driven: its loop wakes every 5 ms"
    return Check("timer", "note", words, step, values)


_REQUIREMENT = re.compile(r"([\w.-]+)(?:\[[^]]*\])?\s*([^;]*?)\s*(?:;\s*(.*))?")


def _requirements(extra: str | None) -> dict[str, str]:
    """Return name → bounds of the packages that omniservo, or one of its extras, states to need."""
    needed = {}
    for line in distribution("omniservo").requires or ():
        found = _REQUIREMENT.fullmatch(line)
        if found is None:
            raise InputError(f"omniservo's own metadata: {line!r} is no requirement")
        name, bounds, marker = found.groups()
        of = re.search(r"extra == ['\"](\w+)['\"]", marker or "")
        if (of[1] if of else None) == extra:
            needed[name] = bounds
    return needed


def _missing(name: str, bounds: str) -> str:
    """Return what is wrong with a package: it is missing, or of another version; empty where it is right."""
    try:
        found = version(name)
    except PackageNotFoundError:
        return f"{name} is missing"
    return "" if _is_within(found, bounds) else f"{name} is {found}; {bounds} is needed"


def _is_within(found: str, bounds: str) -> bool:
    """Tell whether a version keeps bounds like ">=1.2,<2": numbers alone, as this package states them."""
    return all(_keeps(_numbers(found), bound.strip()) for bound in bounds.split(",") if bound.strip())


def _keeps(found: tuple[int, ...], bound: str) -> bool:
    sign, other = re.match(r"[<>=]+", bound), _numbers(bound)
    match sign[0] if sign else "":
        case ">=":
            return found >= other
        case "<":
            return found < other
        case "==":
            return found == other
        case _:
            raise InputError(f"omniservo's own metadata: {bound!r} is no bound that is known here")


def _numbers(text: str) -> tuple[int, ...]:
    """Return the numbers of a version, such as (0, 68, 1), without what is behind them."""
    found = re.search(r"\d+(\.\d+)*", text)
    return tuple(map(int, found[0].split("."))) if found else ()
