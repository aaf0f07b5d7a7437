"""Spoiled files of every kind that the program reads: each is refused in one line, or is a good file still.

Run: ``python -m benchmarks.hostile_files [--count 5000] [--commands 300] [--first SEED] [--only KIND …]``.
The samples of `benchmarks.hostile_samples` are spoiled: bytes flipped, cut out, doubled; tokens replaced by
NaN, infinity, huge, negative, nested and empty ones; lines and fields removed, doubled and exchanged. Each is
read in process, with warnings as errors, within `SECONDS` of the processor and `MEMORY` more bytes; some of
those that a command reads also by that command, in a process of its own.

A fault is: an exception that is not `InputError` (or `NoSolutionError`), a warning, more than a line on
standard error, a time or memory that is exceeded, an exit code but 0, 1 and 2, a file half written or left
behind.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from time import process_time
from types import FrameType
from typing import Any

import numpy as np
from benchmarks.hostile_samples import Sample, samples

from omniservo.errors import InputError, NoSolutionError

SECONDS = 10.0
"""of the processor, for a file of some kilobytes: planning included"""
MEMORY = 2**30
"""more than before [bytes]"""
TOKENS = (
    "nan", "NaN", ".nan", "inf", "-.inf", "Infinity", "1e999", "-1e308", "1e308", "5e-324", "1e-320", "-1",
    "0", "-0.0", "1e6", "99999999999999999999999999", "4294967296", "true", "null", "~", "''", '"x"', "[]",
    "{}", "[[[[[1]]]]]", '{"a": {"b": [1]}}', "[nan, 1, 2]", "../../etc/passwd", "/dev/zero", "\u202e\u0000",
    "x" * 5000, "1:30", "0x10", "&a", "*a", "!!python/name:os.system", "%d", "<", "&amp;", "]]>", "-", ":",
    "#",
)  # fmt: skip
_TOKEN = re.compile(rb"[-+]?[0-9][-+0-9.eE]*|[A-Za-z_][A-Za-z0-9_]*")
_REFUSED = (InputError, NoSolutionError)

Fault = tuple[str, str]
"""what is wrong, and of which file"""


class TooLong(BaseException):
    """The time is over; nothing that catches exceptions catches this."""


def flipped(data: bytes, rng: np.random.Generator) -> bytes:
    """Some bytes are others."""
    spoiled = bytearray(data)
    for place in rng.integers(0, len(data), 1 + int(rng.geometric(0.3))):
        spoiled[place] = int(rng.integers(256))
    return bytes(spoiled)


def cut(data: bytes, rng: np.random.Generator) -> bytes:
    """The end, the beginning or a part between is missing."""
    a, b = sorted(rng.integers(0, len(data) + 1, 2).tolist())
    return (data[:a], data[b:], data[:a] + data[b:])[rng.integers(3)]


def doubled(data: bytes, rng: np.random.Generator) -> bytes:
    """A part stands twice."""
    a, b = sorted(rng.integers(0, len(data) + 1, 2).tolist())
    return data[:b] + data[a:]


def replaced(data: bytes, rng: np.random.Generator) -> bytes:
    """One to three numbers or words are others."""
    for _ in range(rng.integers(1, 4)):
        found = list(_TOKEN.finditer(data))
        if found:
            where = found[rng.integers(len(found))]
            data = data[: where.start()] + str(rng.choice(TOKENS)).encode() + data[where.end() :]
    return data


def lines_changed(data: bytes, rng: np.random.Generator) -> bytes:
    """A line is missing, stands twice, or elsewhere."""
    lines = data.splitlines(keepends=True)
    i, j = rng.integers(0, len(lines), 2)
    match rng.integers(3):
        case 0:
            del lines[i]
        case 1:
            lines.insert(j, lines[i])
        case _:
            lines[i], lines[j] = lines[j], lines[i]
    return b"".join(lines)


def field_changed(data: bytes, rng: np.random.Generator) -> bytes:
    """A field of JSON or YAML is missing, has another's name or value, or one of another kind."""
    import yaml

    try:
        fields = yaml.safe_load(data)
    except (yaml.YAMLError, ValueError, RecursionError):
        return replaced(data, rng)
    places = list(_places(fields))
    if not places:
        return replaced(data, rng)
    held, key = places[rng.integers(len(places))]
    other, other_key = places[rng.integers(len(places))]
    values = (None, True, -1, 0, 1e308, -5e-324, float("nan"), "x", "", [], {}, [[[]]], 10**30, [1.0] * 50)
    match rng.integers(5):
        case 0:
            del held[key]
        case 1:
            held[key] = json.loads(json.dumps(other[other_key]))
        case 2 if isinstance(held, dict):
            held[f"{key}x"] = held.pop(key)
        case _:
            held[key] = values[rng.integers(len(values))]
    return json.dumps(fields).encode()


def _places(value: Any) -> Iterator[tuple[Any, Any]]:
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, held in items:
        yield value, key
        yield from _places(held)


SPOILERS: tuple[Callable[[bytes, np.random.Generator], bytes], ...] = (
    flipped, cut, doubled, replaced, replaced, replaced, lines_changed, field_changed, field_changed,
)  # fmt: skip


def spoiled(sample: Sample, seed: int) -> bytes:
    """Return the file's bytes, spoiled once or several times; the seed decides everything."""
    rng, data = np.random.default_rng(seed), sample.content
    for _ in range(1 + int(rng.uniform() < 0.3)):
        data = SPOILERS[rng.integers(len(SPOILERS))](data or b"\n", rng)
    return data


@contextmanager
def in_folder(sample: Sample, data: bytes) -> Iterator[Path]:
    """Give the path of the file in a folder of its own."""
    with tempfile.TemporaryDirectory() as folder:
        for name, content in sample.beside.items():
            (Path(folder) / name).write_bytes(content)
        path = Path(folder) / sample.name
        path.write_bytes(data)
        yield path


@contextmanager
def bounded() -> Iterator[None]:
    """Warnings are errors; the processor's time and the memory are bounded."""

    def over(number: int, frame: FrameType | None) -> None:
        raise TooLong

    now = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0]) * resource.getpagesize()
    before = signal.signal(signal.SIGVTALRM, over)
    resource.setrlimit(resource.RLIMIT_AS, (now + MEMORY, resource.RLIM_INFINITY))
    signal.setitimer(signal.ITIMER_VIRTUAL, SECONDS)
    try:
        with warnings.catch_warnings(action="error"):
            yield
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
        resource.setrlimit(resource.RLIMIT_AS, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
        signal.signal(signal.SIGVTALRM, before)


@contextmanager
def standard_error() -> Iterator[Callable[[], str]]:
    """Give a function that returns what was written there since, by libraries of C, too."""
    with tempfile.TemporaryFile() as file:
        kept = os.dup(2)
        os.dup2(file.fileno(), 2)

        def words() -> str:
            sys.stderr.flush()
            file.seek(0)
            return file.read().decode("utf-8", "replace")

        try:
            yield words
        finally:
            os.dup2(kept, 2)
            os.close(kept)


def in_process(sample: Sample, data: bytes) -> str:
    """Return "read", "refused", or what is wrong."""
    with in_folder(sample, data) as path, standard_error() as words:
        try:
            with bounded():
                sample.read(path)
            answer = "read"
        except _REFUSED as error:
            answer = "refused" if "\n" not in str(error) else f"more than a line: {error}"
        except TooLong:
            answer = f"longer than {SECONDS:g} s"
        except BaseException as error:
            answer = f"{type(error).__name__}: {error!s:.120}"
        said = words()
    return answer if not said else f"on standard error: {said:.120}"


def by_command(sample: Sample, data: bytes) -> str:
    """Return "done", "no", "refused", or what is wrong."""
    with in_folder(sample, data) as path:
        out = path.parent / "out.json"
        words = {"FILE": str(path), "OUT": str(out)}
        given = [words.get(w, w.replace("BESIDE", str(path.parent))) for w in sample.command]
        there = {p.name for p in path.parent.iterdir()}
        run = subprocess.run(
            [sys.executable, "-m", "omniservo.cli.main", *given],
            capture_output=True, check=False, timeout=600,
        )  # fmt: skip
        drawing = {"out.png"} if run.returncode == 1 else set()  # of a refused plan's worst moment
        left = {p.name for p in path.parent.iterdir()} - there - {out.name} - drawing
        lines = run.stderr.decode("utf-8", "replace").splitlines()
        if run.returncode not in (0, 1, 2) or left or len(lines) > 1:
            return f"exit {run.returncode}, left {sorted(left)}, said {lines[-1:]!s:.150}"
        if run.returncode and (len(lines) != 1 or not lines[0].startswith("omniservo: ")):
            return f"exit {run.returncode}, said {lines!s:.150}"
        if run.returncode == 2 and out.exists():
            return "refused, but something was written"
        if out.is_file() and out.read_bytes()[:1] in (b"{", b"["):
            json.loads(out.read_bytes())
        elif out.is_dir():
            shutil.rmtree(out)
    return ("done", "no", "refused")[run.returncode]


def main() -> None:
    """Print a line for each kind, and every fault with its seed."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--count", type=int, default=5000)
    parser.add_argument("--commands", type=int, default=300)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--only", nargs="*", default=[])
    arguments = parser.parse_args()
    known = [s for s in samples() if not arguments.only or s.kind in arguments.only]
    for sample in known:
        answer = in_process(sample, sample.content)
        assert answer == "read", f"{sample.name} as it should be: {answer}"
    said: dict[str, Counter[str]] = {}
    faults, commands, longest = 0, 0, (0.0, "")
    every = max(1, arguments.count // max(1, arguments.commands))
    for seed in range(arguments.first, arguments.first + arguments.count):
        sample = known[seed % len(known)]
        data, before = spoiled(sample, seed), process_time()
        answers = [in_process(sample, data)]
        longest = max(longest, (process_time() - before, f"{sample.name}, seed {seed}"))
        if (
            ((seed - arguments.first) // len(known)) % every == 0
            and sample.command
            and commands < arguments.commands
        ):
            commands += 1
            answers.append(by_command(sample, data))
        for way, answer in zip(("in process", "by command"), answers, strict=False):
            good = answer in ("read", "refused", "done", "no")
            said.setdefault(sample.kind, Counter())[f"{way} {answer if good else 'FAULT'}"] += 1
            faults += not good
            if not good:
                print(f"fault, {way}: {sample.name}, seed {seed}: {answer}", flush=True)
    for kind, counts in sorted(said.items()):
        print(f"{kind:<16} " + ", ".join(f"{words} {n}" for words, n in sorted(counts.items())))
    print(f"{arguments.count} files in process, {commands} of them by command: {faults} faults; ", end="")
    print(f"longest {longest[0]:.1f} s ({longest[1]})")


if __name__ == "__main__":
    main()
