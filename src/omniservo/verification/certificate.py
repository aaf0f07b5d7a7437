"""The verifier's answer."""

from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

from omniservo.verification.problem_differences import Difference

Status = Literal["certified", "refuted", "undecided"]


class Judgement(NamedTuple):
    """One constraint of the problem, or one line of the plan's certificate that stands for none."""

    name: str
    margin: float
    """as the plan states it; 0 where it states none"""
    unit: str
    verdict: Literal["holds", "violated", "undecided"]
    """of that margin and of the constraint itself"""
    w: float | None
    """where it does not hold"""


@dataclass(frozen=True)
class Certificate:
    """What is proven of a plan file.

    ``certified``: the path and every claim of the file are proven. ``refuted``: something in it is false
    or missing, or the plan's problem is not the one that was meant. ``undecided``: neither. ``reasons`` says
    why it is not certified, one readable line each.
    """

    status: Status
    constraints: tuple[Judgement, ...]
    reasons: tuple[str, ...]
    differences: tuple[Difference, ...] | None = None
    """between the plan's problem and the one that was meant; None where they were not compared"""

    def __repr__(self) -> str:
        held = sum(judgement.verdict == "holds" for judgement in self.constraints)
        why = f"; {self.reasons[0][:100]}" if self.reasons else ""
        return f"Certificate({self.status}, {held} of {len(self.constraints)} margins hold{why})"

    def to_dict(self) -> dict[str, Any]:
        """Return the answer as plain lists and numbers."""
        return {
            "status": self.status,
            "constraints": [judgement._asdict() for judgement in self.constraints],
            "reasons": list(self.reasons),
            "differences": None if self.differences is None else [d._asdict() for d in self.differences],
        }
