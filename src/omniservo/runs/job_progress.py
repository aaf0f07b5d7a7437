"""How much of a job is behind: each stage takes the share of it that it took when it was measured."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[str, float], object]
"""Told a stage and the share of it, or of the whole job, that is behind."""

_SECONDS = {
    "teaching the goal": 1.0,
    "looking at the target": 1.0,
    "estimating motion and structure": 1.0,
    "planning": 2.0,
    "following the path": 32.0,
    "filming": 28.0,
    "measuring the run": 4.0,
    "drawing figures": 12.0,
    "drawing the animation": 3.0,
}
"""[s] of ``paper-example-1``; their ratios count"""

_REPORT = 18.0
"""[s] of the report, for each run in it"""

_OF_FILM = {"filming", "drawing the animation"}


class JobProgress:
    """Turns the stages of a job's runs into the share of the job that is behind.

    Args:
        tell: is told what is being done, and that share.
        methods: of the runs, one after the other.
        filmed: whether there is an animation.
    """

    def __init__(self, tell: Progress, methods: tuple[str, ...], *, filmed: bool) -> None:
        self._tell, self._methods, self._run = tell, methods, 0
        self._seconds = {stage: s for stage, s in _SECONDS.items() if filmed or stage not in _OF_FILM}
        self._whole = len(methods) * (sum(self._seconds.values()) + _REPORT)

    def begin_run(self, number: int) -> None:
        """Go on to the run of the ``number``-th method."""
        self._run = number

    def __call__(self, stage: str, done: float = 0.0) -> None:
        """Go on to a stage of this run, or within it to a share of it."""
        stages = list(self._seconds)
        before = sum(self._seconds[s] for s in stages[: stages.index(stage)]) + done * self._seconds[stage]
        behind = self._run * sum(self._seconds.values()) + before
        name = f"{self._methods[self._run]}: {stage}" if len(self._methods) > 1 else stage
        self._tell(name, behind / self._whole)

    def report(self) -> None:
        """Go on to the report of all runs."""
        self._tell("writing the report", 1.0 - len(self._methods) * _REPORT / self._whole)
