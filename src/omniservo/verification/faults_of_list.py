"""The plan's own certificate: the problem's constraints, no more and no less, and the worst among them."""

import re
from collections.abc import Sequence

from omniservo.verification.fields import Malformed
from omniservo.verification.judged import Case
from omniservo.verification.plan_file import Stated

_ABOUT_A_POINT = re.compile(r"(.*) \(point (\d{1,9})\)")


def by_constraint(stated: Sequence[Stated]) -> dict[str, Stated]:
    """Return the lines by the constraint they are about.

    Raises:
        Malformed: one stands twice.
    """
    lines: dict[str, Stated] = {}
    for line in stated:
        if lines.setdefault(_without_point(line.name)[0], line) is not line:
            raise Malformed(f"certificate: {line.name!r:.80} stands twice")
    return lines


def faults_of_list(
    stated: Sequence[Stated], worst: Stated | str | None, cases: Sequence[Case], points: int
) -> list[str]:
    """Every constraint of the problem must be in the certificate, in its unit, and nothing else."""
    units = {case.constraint.name: case.constraint.unit for case in cases}
    faults = []
    for line in stated:
        name, point = _without_point(line.name)
        if name not in units or (point is not None and point >= points):
            faults.append(f"certificate: {line.name!r:.80} is no constraint of this problem")
        elif line.unit != units[name]:
            faults.append(
                f"certificate: {line.name!r:.80} is stated in {line.unit!r:.20}, not in {units[name]}"
            )
    present = {_without_point(line.name)[0] for line in stated}
    faults += [f"certificate: {name} is missing" for name in units if name not in present]
    return faults + _faults_of_worst(stated, worst)


def _faults_of_worst(stated: Sequence[Stated], worst: Stated | str | None) -> list[str]:
    """The worst is one of the lines, word for word, and no line of its unit has a smaller margin.

    A bare name states no margin: it only has to be among the lines.
    """
    if worst is None or any(worst == line.name for line in stated):
        return []
    if isinstance(worst, str) or worst not in stated:
        name = worst if isinstance(worst, str) else worst.name
        return [f"certificate.worst: {name!r:.80} does not stand so among the constraints"]
    lower = min((line for line in stated if line.unit == worst.unit), key=lambda line: line.margin)
    if lower.margin >= worst.margin:
        return []
    return [f"certificate.worst: {worst.name!r:.80} is stated, but {lower.name!r:.80} has a smaller margin"]


def _without_point(name: str) -> tuple[str, int | None]:
    match = _ABOUT_A_POINT.fullmatch(name)
    return (match[1], int(match[2])) if match else (name, None)
