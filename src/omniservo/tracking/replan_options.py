"""When a plan is made again: the options of `Replanner`, each checked."""

from __future__ import annotations

from dataclasses import dataclass

from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import finite_number

_PERIODS = 1.5
"""of the camera, from an image with which planning began until another way is entered"""

_LEAST_TUBE = 0.003
"""An estimate that changes by more than tracking has room for leads the camera off the path by more; but by
no less than this is planned again [m]."""


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

    @classmethod
    def of_loop(cls, rate: float, late: float, room: float, seed: int) -> ReplanOptions:
        """Return those of a loop whose plans keep some room for tracking.

        Args:
            rate: images a second.
            late: how much later than its image a twist acts [s].
            room: what plans keep free because the camera does not follow exactly [m].
            seed: as for `plan_path`.
        """
        return cls(ahead=_PERIODS / rate + late, tube=max(room, _LEAST_TUBE), seed=seed)

    def __post_init__(self) -> None:
        finite_number("ahead", self.ahead, above=0.0)
        finite_number("tube", self.tube, above=0.0)
        finite_number("seed", self.seed, minimum=0)
        if self.time_budget is not None:
            finite_number("time_budget", self.time_budget, above=0.0)
