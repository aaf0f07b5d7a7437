"""How much of a job is behind: each stage takes the share of it that it took when it was measured."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[str, float], object]
"""Called with a stage and the share of it, or of the whole job, that is behind."""

_LOADING = 1.2
"""[s] before the first stage: what is imported"""

_SECONDS = {
    "teaching the goal": 0.2,
    "looking at the target": 0.1,
    "estimating motion and structure": 0.05,
    "planning": 0.1,
    "looking again": 0.1,
    "following the path": 9.1,
    "filming": 2.8,
    "measuring the run": 0.8,
    "drawing figures": 3.2,
    "drawing the animation": 0.6,
}
"""[s] of ``paper-example-1``; their ratios count"""

_REPORT = 0.4
"""[s] of the report, for each run in it"""

_WITHIN = {"waiting for images": "following the path"}
"""what happens to a stage, and takes as long as it takes"""

_OF_FILM = {"filming"}
"""A run that was stopped before its first step is drawn standing still without."""


class JobProgress:
    """Turns the stages of a job's runs into the share of the job that is behind.

    Args:
        tell: is called with what is being done, and that share.
        methods: of the runs, one after the other.
        filmed: whether there is an animation.
    """

    def __init__(self, tell: Progress, methods: tuple[str, ...], *, filmed: bool) -> None:
        self._tell, self._methods, self._run = tell, methods, 0
        self._seconds = {stage: s for stage, s in _SECONDS.items() if filmed or stage not in _OF_FILM}
        self._whole = _LOADING + len(methods) * (sum(self._seconds.values()) + _REPORT)

    def begin_run(self, number: int) -> None:
        """Go on to the run of the ``number``-th method."""
        self._run = number

    def __call__(self, stage: str, done: float = 0.0) -> None:
        """Go on to a stage of this run, or within it to a share of it."""
        stages, place = list(self._seconds), _WITHIN.get(stage, stage)
        before = sum(self._seconds[s] for s in stages[: stages.index(place)]) + done * self._seconds[place]
        behind = _LOADING + self._run * sum(self._seconds.values()) + before
        name = f"{self._methods[self._run]}: {stage}" if len(self._methods) > 1 else stage
        self._tell(name, behind / self._whole)

    def report(self) -> None:
        """Go on to the report of all runs."""
        self._tell("writing the report", 1.0 - len(self._methods) * _REPORT / self._whole)
