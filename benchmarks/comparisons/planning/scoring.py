"""What an attempt is worth: proven or refuted, energy, length, what it keeps."""

from __future__ import annotations

from dataclasses import dataclass
from time import perf_counter

import numpy as np
from benchmarks.comparisons.planning.attempt import Attempt
from benchmarks.comparisons.planning.dense_check import look
from benchmarks.comparisons.planning.neutral import Neutral

from omniservo import verify_plan
from omniservo.errors import InputError
from omniservo.planning import CameraPath, Certificate, Plan, PlanningProblem, certify

SHOWN = -1e-9
"""A sampled g below it shows a violation."""


@dataclass(frozen=True)
class Score:
    """A row of the results, without the method."""

    claimed: bool
    feasible: bool
    """Proven by certificate and verifier; of a polyline: 20 000 looks show no violation."""
    violated: bool
    """A w shows that a constraint is violated, or an end is missed."""
    defect: str = ""
    """Certificate, verifier and dense check contradict one another: must be empty."""
    least: float = np.nan
    """smallest g at 20 000 looks (`samples`)"""
    family: str = ""
    """whose it is"""
    clearance: float = np.nan
    """smallest proven clearance, least distance and sight margin beyond what is asked for [m]"""
    visibility: float = np.nan
    """smallest proven visibility margin beyond what is asked for [px]"""
    energy: float = np.nan
    """∫‖t″‖²/ℓ² + ‖φ″‖² dw"""
    length: float = np.nan
    """of the way of the camera centre [m]"""
    verifier_seconds: float = np.nan


def score(problem: PlanningProblem, neutral: Neutral, attempt: Attempt) -> Score:
    """Judge an attempt by certificate, verifier and dense check."""
    if attempt.path is None:
        return Score(attempt.claimed, False, False)
    seen = look(neutral, attempt.path)
    shown = seen.least < SHOWN or not seen.ends_meet
    if not isinstance(attempt.path, CameraPath):
        return Score(
            attempt.claimed, not shown, shown, least=seen.least, family=seen.family, length=seen.length
        )
    proven, refuted, certificate, seconds = _judge(problem, attempt.path)
    margins = _margins(certificate)
    return Score(
        claimed=attempt.claimed,
        feasible=proven,
        violated=shown or refuted,
        defect=f"proven, but {seen.family} {seen.least:.3g} at w = {seen.w:.6f}" if proven and shown else "",
        least=seen.least,
        family=seen.family,
        clearance=margins["m"],
        visibility=margins["px"],
        energy=energy(neutral, attempt.path),
        length=seen.length,
        verifier_seconds=seconds,
    )


def _judge(problem: PlanningProblem, path: CameraPath) -> tuple[bool, bool, Certificate | None, float]:
    """Return whether certificate and verifier prove it, whether one refutes it; the verifier's time [s]."""
    try:
        verdict, certificate = certify(problem, path)
    except InputError:  # it starts or ends elsewhere
        return False, True, None, np.nan
    if verdict != "certified":
        return False, verdict == "refuted", certificate, np.nan
    plan = Plan(problem, verdict, path, certificate, 0.0, "certified")
    begin = perf_counter()
    verified = verify_plan(plan).status
    return verified == "certified", verified == "refuted", certificate, perf_counter() - begin


def _margins(certificate: Certificate | None) -> dict[str, float]:
    """Return the smallest margin by unit."""
    found = {"m": np.nan, "px": np.nan}
    for line in () if certificate is None else certificate.constraints:
        if line.unit in found:
            found[line.unit] = float(np.fmin(found[line.unit], line.margin))
    return found


def energy(neutral: Neutral, path: CameraPath) -> float:
    """Return the bending energy ∫‖t″‖²/ℓ² + ‖φ″‖² dw, by a Gauss rule that is exact for it."""
    nodes, weights = np.polynomial.legendre.leggauss(max(path.degrees))
    total = 0.0
    for rows, unit in ((path.rotation, 1.0), (path.translation, neutral.ell)):
        second = np.array([np.polyval(np.polyder(row, 2), 0.5 * (nodes + 1.0)) for row in rows])
        total += float((second**2 @ weights).sum()) / (2.0 * unit**2)
    return total
