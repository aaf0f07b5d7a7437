"""What a method gives back for a problem.

A peer is a module in `benchmarks.comparisons.planning.peers` with a function ::

    def solve(problem: PlanningProblem, neutral: Neutral, budget: float) -> Attempt

``budget`` [s] bounds one call. A module attribute ``CALLBACKS`` names the language that its constraint
callbacks run in. It raises ImportError on import where its library is absent.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from omniservo.geometry.arrays import FloatArray
from omniservo.planning import CameraPath


@dataclass(frozen=True, eq=False)
class Polyline:
    """A path of straight pieces, equally long in w: centres in between by lines, rotations by slerp."""

    quaternions: FloatArray
    """(m, 4), (x, y, z, w), unit; the first is the identity, the last the goal's up to its sign"""
    positions: FloatArray
    """(m, 3) [m]"""


@dataclass(frozen=True, eq=False)
class Attempt:
    """One call of a method."""

    claimed: bool
    """The method says that its path keeps every constraint, by its own measure."""
    path: CameraPath | Polyline | None
    seconds: float
    """`perf_counter` around the solver alone, first start to last; the building of a model is not in it"""
    note: str = ""
    facts: dict[str, float] = field(default_factory=dict)
    """figures to keep with the row, such as ``build_seconds``, ``starts``, ``evaluations``"""
