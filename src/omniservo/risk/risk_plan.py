"""A plan with what is known of its risk."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

from omniservo.field_docs import with_field_docs
from omniservo.planning.plan import Plan
from omniservo.short_repr import short_repr


@with_field_docs
@dataclass(frozen=True)
class UncertainMargin:
    """What uncertainty does to one constraint of the problem."""

    unit: str
    """"m" or "px\""""
    planned: float
    """smallest margin along the planned path, beyond what the problem asks for"""
    executed: float
    """the same along the executed path; less is left only with the stated risk"""
    extra: float
    """by how much more the plan was required than the problem asks for"""
    parts: Mapping[str, float]
    """source → what it alone takes of the planned margin at the stated risk"""

    @property
    def left(self) -> float:
        """``executed`` over what uncertainty takes: below 0 it takes more than there is."""
        return self.executed / max(self.planned - self.executed, 1e-12)


@with_field_docs
@dataclass(frozen=True)
class LinkMargin:
    """What gaps of the arm, and of what it carries, to what stands around are kept wider for [m]."""

    risk: float
    """that any gap is narrower than required and deviated, because mount or estimate are uncertain"""
    violated: float
    """share of the samples in which one is"""
    mount: float
    """what the mount alone takes of a gap that is close, at most but for the risk"""
    estimate: float
    """what the estimate alone takes, likewise"""
    added: float
    """by how much more clearance was planned with, so that the samples keep what is required"""


class RiskReasons(NamedTuple):
    """Why a plan at a stated risk is as it is."""

    margins: Mapping[str, UncertainMargin]
    advice: str
    refusal: str = ""
    """why there is no plan; "": there is one, or the plan itself says it"""


@with_field_docs
@dataclass(frozen=True, eq=False)
class RiskPlan:
    """A plan whose margins are wide enough for an uncertain estimate, or the reason why there is none.

    The reasons are found when they are first read: that takes longer than planning.
    """

    ok: bool
    """the executed path violates a constraint with at most the stated risk: the 95% upper bound on
    ``predicted`` by Clopper and Pearson, from samples that had no part in the search, is not above it"""
    found: Plan
    """``plan`` without the reasons"""
    risk: float
    """as stated for the camera's constraints; see ``links`` for what the arm has besides"""
    predicted: float
    """share of the samples whose executed path violates a constraint of the problem"""
    predicted_bound: float
    """its upper bound, see ``ok``"""
    samples: int
    """how many"""
    extra_clearance: float
    """most that was added to a constraint in metres [m]"""
    extra_visibility: float
    """added to the visibility margin [px]"""
    seconds: float
    """wall time, without the reasons [s]"""
    reasons: Callable[[], RiskReasons] = field(repr=False)
    """finds them"""
    links: LinkMargin | None = None
    """of the whole arm, where it was planned for; its risk comes on top"""

    __repr__ = short_repr

    @cached_property
    def _reasons(self) -> RiskReasons:
        return self.reasons()

    @cached_property
    def plan(self) -> Plan:
        """The plan; its problem asks for the widened margins, and certificate and verifier prove those.

        Of status "not_found" or "infeasible" where ``ok`` is False: then the best attempt.
        """
        if self.ok or not self._reasons.refusal:
            return self.found
        return replace(self.found, status="not_found", reason=self._reasons.refusal)

    @property
    def margins(self) -> Mapping[str, UncertainMargin]:
        """Constraint → what uncertainty does to it; "image" are all image limits together."""
        return self._reasons.margins

    @property
    def advice(self) -> str:
        """What would help, found by planning without each source; where ``ok`` is True what dominates."""
        return self._reasons.advice

    def to_dict(self) -> dict[str, Any]:
        """Return the report without the plan, as plain numbers."""
        return {
            "ok": self.ok,
            "risk": self.risk,
            "predicted": self.predicted,
            "predicted_bound": self.predicted_bound,
            "samples": self.samples,
            "extra_clearance": self.extra_clearance,
            "extra_visibility": self.extra_visibility,
            "margins": {
                name: {
                    "unit": m.unit,
                    "planned": m.planned,
                    "executed": m.executed,
                    "extra": m.extra,
                    "parts": dict(m.parts),
                }
                for name, m in self.margins.items()
            },
            "advice": self.advice,
            "seconds": self.seconds,
            "links": None if self.links is None else asdict(self.links),
        }
