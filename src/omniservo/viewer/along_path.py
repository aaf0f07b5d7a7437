"""What is left of every constraint along a path: curves over w, with what is proven of each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.planning import Plan
from omniservo.reporting.image_distance import image_distance
from omniservo.robots import link_gaps
from omniservo.viewer.answer import Answer
from omniservo.viewer.situation import Situation
from omniservo.whole_arm import ArmPlan

SAMPLES = 41
"""of a curve"""

LINK_SAMPLES = 21
"""of the links' gaps, which take longer"""


@dataclass(frozen=True, eq=False)
class MarginCurve:
    """One quantity over w."""

    title: str
    unit: str
    w: FloatArray
    """(m,)"""
    values: FloatArray
    """(m,) NaN where there is none"""
    required: float | None = None
    """what the values have to keep"""
    certified: float | None = None
    """what is proven for all w"""


def curves_of(answer: Answer) -> list[MarginCurve]:
    """Return every curve that there is of an answer."""
    arm = [] if answer.arm_plan is None else arm_curves(answer.situation, answer.arm_plan)
    return camera_curves(answer.plan) + arm


def camera_curves(plan: Plan) -> list[MarginCurve]:
    """Return the camera's clearance [mm] and the points' distance to the image's limits [px]."""
    if plan.path is None:
        return []
    problem, w = plan.problem, np.linspace(0.0, 1.0, SAMPLES)
    poses, _ = plan.path.sampled(w)
    proven, found = plan.status == "certified", []
    if problem.obstacles:
        gaps = np.min([_gaps(o, poses[:, :3, 3], w) for o in problem.obstacles], axis=0)
        bound = plan.least_clearance(range(len(problem.obstacles))) if proven else None
        own = [problem.clearance if o.clearance is None else o.clearance for o in problem.obstacles]
        found.append(
            MarginCurve(
                "camera to obstacles", "mm", w, 1e3 * gaps, 1e3 * min(own),
                None if bound is None else 1e3 * bound,
            )
        )  # fmt: skip
    left = np.einsum("mji,mnj->mni", poses[:, :3, :3], problem.points[None] - poses[:, None, :3, 3])
    pixels, valid = problem.camera.project(left)
    margins = image_distance(problem.camera, np.where(valid[..., None], pixels, 0.0))
    least = np.where(valid, margins, np.nan).min(axis=1)
    bound = plan.least_visibility() if proven else None
    # The curve, like what is required here, is of the model's pixels; the bound is of the true ones.
    certified = None if bound is None else bound + problem.camera.deviation_px
    found.append(MarginCurve("points to image limits", "px", w, least, problem.image_margin, certified))
    return found


def arm_curves(situation: Situation, found: ArmPlan) -> list[MarginCurve]:
    """Return the joints' room to their limits [deg] and the links' gaps to what stands around [mm]."""
    branch, arm = found.branch, situation.arm
    if branch is None or arm is None:
        return []
    setting, end = arm.setting, float(branch.w[-1])
    w = np.linspace(0.0, end, SAMPLES)
    limits = np.rad2deg(setting.arm.limit_margins(branch(w)).min(axis=1))
    reserve = float(np.rad2deg(setting.limit_reserve))
    proven = reserve if found.certified else None
    curves = [MarginCurve("joints to their limits", "deg", w, limits, reserve, proven)]
    bodies = setting.bodies(found.plan.problem.obstacles)
    places = np.linspace(0.0, end, LINK_SAMPLES)
    gaps = np.min(list(link_gaps(bodies, branch(places)).values()), axis=0)
    proof, bound = found.clearance, None
    if found.certified and proof is not None and proof.status == "clear":
        bound = 1e3 * (proof.clearance + proof.proven)
    curves.append(
        MarginCurve("links to bodies", "mm", places, 1e3 * gaps, 1e3 * setting.clearance_around, bound)
    )
    return curves


def _gaps(obstacle: object, places: FloatArray, w: FloatArray) -> FloatArray:
    """Return the distance (m,) of places (m, 3) at w (m,) to an obstacle, where it is then [m]."""
    motion = getattr(obstacle, "motion", None)
    moved = 0.0 if motion is None else np.stack([np.polyval(row, w) for row in motion], axis=-1)
    gaps: FloatArray = obstacle.distance(np.ascontiguousarray(places - moved))  # type: ignore[attr-defined]
    return gaps
