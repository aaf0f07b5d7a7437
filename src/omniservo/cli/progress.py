"""What a command is at, said on standard error while a person waits."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Self

from rich.console import Console
from rich.progress import BarColumn, ProgressColumn, SpinnerColumn, Task, TextColumn, TimeElapsedColumn
from rich.progress import Progress as Bar
from rich.text import Text

if TYPE_CHECKING:
    from omniservo.geometry.compiler_watch import CompilerWatch

_LEAST_SHARE = 0.05
"""Of the job: before, what is left cannot be distinguished from the time that it took so far."""

_ANOTHER_LINE = 15.0
"""[s] after which, where lines are written one below the other, another says how far the same stage is"""

_COUNTED = re.compile(r"\d+")
"""image 3 of 40 is the same stage as image 4 of 40"""


@dataclass
class Doing:
    """What the running command is at and what it has written: said where somebody ends it."""

    stage: str = ""
    written: list[Path] = field(default_factory=list)

    def ended(self, how: str) -> str:
        """Return the message of an end such as "interrupted"."""
        during = f" while {self.stage}" if self.stage else ""
        there = ", ".join(str(path) for path in self.written if path.exists())
        return f"{how}{during}; {f'written before: {there}' if there else 'nothing was written'}"


DOING = Doing()


class Progress:
    """Says the stages of a job, the time that they take, and when code is compiled.

    On a terminal one line changes; elsewhere there is a line a stage.

    Args:
        what: the first stage.
        silent: says nothing, but knows the stage all the same.
        compiles: compiling is the job; in others it happens to a stage, and tells nothing of the rest.
    """

    def __init__(self, what: str, *, silent: bool, compiles: bool = False) -> None:
        self._what, self._silent, self._compiles = what, silent, compiles
        self._ends: float | None = None
        self._waited = 0.0
        self._begin = self._last_line = perf_counter()
        self._watch: CompilerWatch | None = None
        self._bar: Bar | None = None
        self._entered = ExitStack()

    def __enter__(self) -> Self:
        DOING.stage = self._what
        if self._silent:
            return self
        self._listen()
        if sys.stderr.isatty():
            self._bar = self._entered.enter_context(_bar())
            self._row = self._bar.add_task(self._what, total=None, ends=None)
        return self

    def __exit__(self, kind: type[BaseException] | None, *raised: object) -> None:
        self._entered.close()
        if kind is None:
            DOING.stage = ""
        if self._watch is not None and self._watch.compiled:
            from omniservo.cli.compiled_record import where_compiled_is_kept

            self._line(f"compiling took {self._watch.seconds:.0f} s; {where_compiled_is_kept()}")

    def __call__(self, stage: str, share: float | None = None, *, seconds: float | None = None) -> None:
        """Go on to a stage, or within it.

        Args:
            stage: such as "planning".
            share: of the whole job, what is behind it; None: not known, and no line is worth it.
            seconds: that the stage takes, and with it the job; None: not known.
        """
        changed = _COUNTED.sub("", stage) != _COUNTED.sub("", self._what)
        self._what = DOING.stage = stage
        if self._silent:
            return
        self._listen()
        self._ends = self._end(share) if seconds is None else perf_counter() + seconds
        if self._bar is not None:
            self._bar.update(
                self._row, description=stage, total=None if share is None else 1.0, completed=share or 0.0,
                ends=self._ends,
            )  # fmt: skip
        elif (share is not None or seconds is not None) and (
            changed or perf_counter() - self._last_line > _ANOTHER_LINE
        ):
            left = _left(self._ends)
            self._line(f"{stage}; {left}" if left else stage)

    @contextmanager
    def suspended(self) -> Iterator[None]:
        """Draw nothing while the block runs, which is `uncounted`: the terminal is for others."""
        with self.uncounted():
            if self._bar is not None:
                self._bar.stop()
            yield
            if self._bar is not None:
                self._bar.start()

    @contextmanager
    def uncounted(self) -> Iterator[None]:
        """Have a block whose time tells nothing of what is left: it waits for somebody."""
        begin = perf_counter()
        yield
        self._waited += perf_counter() - begin

    def _listen(self) -> None:
        """Watch the compiler once it is loaded: what never loads it is not made to wait for it."""
        if self._watch is None and "numba" in sys.modules:
            from omniservo.geometry.compiler_watch import CompilerWatch

            self._watch = self._entered.enter_context(CompilerWatch(self._compiling))

    def _end(self, share: float | None) -> float | None:
        """Return when it ends if the rest goes as fast as what is behind; None: not known yet."""
        if share is None or share < _LEAST_SHARE:
            return None
        return perf_counter() + self._worked() * (1.0 / share - 1.0)

    def _worked(self) -> float:
        """Return what the job took so far [s], without compiling that is not the job, and without waiting."""
        compiled = 0.0 if self._watch is None or self._compiles else self._watch.seconds
        return perf_counter() - self._begin - self._waited - compiled

    def _compiling(self, name: str) -> None:
        if self._bar is not None:
            self._bar.update(self._row, description=f"compiling, once: {name} ({self._what})")
            return
        compiled = 0 if self._watch is None else self._watch.compiled
        if compiled == 1 or perf_counter() - self._last_line > _ANOTHER_LINE:
            what = "this stage's code" if compiled == 1 else f"{compiled} functions so far"
            self._line(f"compiling, once: {what} ({self._what})")

    def _line(self, words: str) -> None:
        self._last_line = perf_counter()
        print(f"[{self._last_line - self._begin:4.0f} s] {words}", file=sys.stderr, flush=True)


class _TimeLeft(ProgressColumn):
    """Counts down, also while a stage says nothing."""

    def render(self, task: Task) -> Text:
        return Text(_left(task.fields["ends"]))


def _left(ends: float | None) -> str:
    """Say how long it takes until then; nothing where that is not known."""
    if ends is None:
        return ""
    seconds = round(max(ends - perf_counter(), 0.0))
    hours, minutes = seconds // 3600, seconds % 3600 // 60
    if hours:
        return f"about {hours} h {minutes} min left"
    return f"about {minutes} min left" if minutes >= 10 else f"about {seconds} s left"


def _bar() -> Bar:
    columns = (
        SpinnerColumn(), TextColumn("{task.description}", markup=False), BarColumn(20), TimeElapsedColumn(),
        _TimeLeft(),
    )  # fmt: skip
    return Bar(*columns, console=Console(stderr=True, emoji=False), transient=True)
