"""What every family of constraints hands to the judge."""

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from typing import Generic, TypeVar

from omniservo.verification.decision import Finding

Subject = TypeVar("Subject")
Judge = Callable[[Subject], Finding]


@dataclass(frozen=True)
class Constraint(Generic[Subject]):
    """One line of a certificate: of the path alone, or of every target point."""

    name: str
    """as in the certificate, without "(point J)" """
    unit: str
    judge: Callable[[Fraction], Judge[Subject]]
    """A margin becomes a decision on a subject: is at least that margin left at every w?"""
    left: Callable[[Subject, Fraction], float]
    """The margin that is left at w, in floating point, for messages only."""
