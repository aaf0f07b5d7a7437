"""When a plan is made again: the options of `Replanner`, each checked."""

from __future__ import annotations

from dataclasses import dataclass

from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import finite_number


@with_field_docs
@dataclass(frozen=True)
class ReplanOptions:
    """When a plan is made again."""

    ahead: float = 0.08
    """The new way is entered so long after the image with which planning began [s]: a period of the camera,
    in which to plan, and the delay until a twist acts. Until then the old way is followed, and proven, too"""
    tube: float = 0.005
    """An estimate that has changed by more than this is planned for again [m]; see `Replanner.change`"""
    time_budget: float | None = None
    """A plan that took longer is not followed [s]; None: as long as it takes, where time stands meanwhile"""
    seed: int = 0
    """as for `plan_path`"""

    def __post_init__(self) -> None:
        finite_number("ahead", self.ahead, above=0.0)
        finite_number("tube", self.tube, above=0.0)
        finite_number("seed", self.seed, minimum=0)
        if self.time_budget is not None:
            finite_number("time_budget", self.time_budget, above=0.0)
