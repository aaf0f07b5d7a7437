"""Which uncertainty is the obstacle, found by leaving it out."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from omniservo.estimation import TwoViewEstimate
from omniservo.estimation.uncertainty.joint_uncertainty import Source
from omniservo.risk.risk_plan import UncertainMargin

HELP: dict[Source, str] = {
    "noise": "more points, sharper pixels or another picture",
    "scale": "a known length, or a scale that is known better",
    "calibration": "a calibration from more pictures",
}


def sources_of(estimate: TwoViewEstimate) -> tuple[Source, ...]:
    """Return the sources that an estimate's uncertainty has."""
    law = estimate.uncertainty
    found: list[Source] = []
    if law is not None and (len(law.noise) or law.own.any()):
        found.append("noise")
    if estimate.scale_sigma > 0.0:
        found.append("scale")
    if law is not None and len(law.calibration):
        found.append("calibration")
    return tuple(found)


def what_dominates(margins: Mapping[str, UncertainMargin]) -> str:
    """Say which source takes most of the tightest constraint in metres, and in px."""
    words = []
    for unit, factor, spelled in (("m", 1e3, "mm"), ("px", 1.0, "px")):
        rows = [(m.executed, name) for name, m in margins.items() if m.unit == unit and m.parts]
        if rows:
            name = min(rows)[1]
            margin = margins[name]
            source = max(margin.parts, key=lambda s: margin.parts[s])
            taken = factor * (margin.planned - margin.executed)
            words.append(f"{name}: uncertainty takes {taken:.2g} {spelled}, most of it {source}")
    return "; ".join(words)


def what_would_help(
    sources: tuple[Source, ...],
    margins: Mapping[str, UncertainMargin],
    plans_with: Callable[[tuple[Source, ...]], bool],
) -> str:
    """Return which sources must go for a path, the one that takes most of the tightest constraint first.

    ``plans_with`` tells whether there is a path with only these sources.
    """
    helpful = [s for s in sources if plans_with(tuple(other for other in sources if other != s))]
    if helpful:
        tight = min(margins.values(), key=lambda m: m.left, default=None)
        helpful.sort(key=lambda s: 0.0 if tight is None else -tight.parts.get(s, 0.0))
        return "what would help: " + "; or ".join(HELP[s] for s in helpful)
    if len(sources) > 1 and plans_with(()):
        return "only all of these together would help: " + "; ".join(HELP[s] for s in sources)
    return "there would be none without uncertainty either"
