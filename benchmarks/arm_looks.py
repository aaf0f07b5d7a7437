"""Looks of `benchmarks.arm_loops`: where there is no plan at the risk, a small move, another image, again."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from benchmarks.arm_runs import NOISE_PX, Gaps, Truth
from scipy.spatial.transform import RigidTransform

from omniservo.errors import InputError, NoSolutionError
from omniservo.estimation import TwoViewEstimate
from omniservo.estimation.arm_views import ArmViews, KnownErrors, LengthPrior, chain_of
from omniservo.estimation.estimate_arm_views import estimate_arm_views
from omniservo.geometry.adjoint import adjoint
from omniservo.geometry.arrays import FloatArray
from omniservo.looks import CertifiedMove, ViewingState, next_look
from omniservo.planning import PlanningProblem
from omniservo.risk import RiskPlan
from omniservo.robots import Tube
from omniservo.whole_arm import ArmSetting

PlanFrom = Callable[[ViewingState], RiskPlan]


@dataclass(frozen=True, eq=False)
class Seen:
    """What the robot has seen and takes for true, rows as in its first image."""

    estimate: TwoViewEstimate
    camera_covariance: FloatArray
    mount: FloatArray
    """(6, 6) in the camera's frame"""
    base_T_goal: RigidTransform
    """the camera at the goal as the arm's joints have it"""
    goal: FloatArray
    """(n, 2) the goal's image [px]"""
    taken: tuple[tuple[FloatArray, FloatArray], ...]
    """joints (m,) and pixels (n, 2), NaN where not seen, of all others, the newest first"""


@dataclass(frozen=True, eq=False)
class Looked:
    """What looks came to."""

    standing: ViewingState
    answer: RiskPlan
    truth: Truth
    """as seen from where the arm then stands"""
    pixels: FloatArray
    """(n, 2) of the last image [px]"""
    looks: int
    failures: frozenset[str]
    """of the moves"""


def standing_of(asked: PlanningProblem, setting: ArmSetting, tube: Tube, seen: Seen) -> ViewingState | None:
    """Return where the arm stands first; None: two images do not tell what another one would."""
    _, optimum = estimate_arm_views(_views(asked, setting, seen), seen.estimate)
    bare = replace(setting, tube=None)
    return None if optimum is None else ViewingState(asked, bare, tube, seen.estimate, optimum, seen.mount)


def look_on(
    here: ViewingState | None,
    seen: Seen,
    truth: Truth,
    plan_from: PlanFrom,
    looks: int,
    random: np.random.Generator,
    seed: int,
) -> Looked | None:
    """Look up to so many times, until there is a plan; None: there is none."""
    failures: set[str] = set()
    failed: list[CertifiedMove] = []
    for number in range(1, looks + 1):
        if here is None:
            return None
        chosen = next_look(here, lambda there: plan_from(there).ok, seed, failed)
        if isinstance(chosen, str):
            return None
        joints = chosen.move.joints.positions[-1]
        failures |= _violated(chosen.move, truth, here)
        there, pixels = _seen_from(joints, truth, here, random)
        more = replace(seen, taken=((joints, pixels), *seen.taken))
        known = np.where(here.estimate.inliers[:, None], here.estimate.points, np.nan)
        try:
            here = here.after(joints, _views(here.asked, here.setting, more), known)
        except NoSolutionError:  # it gave nothing: the arm goes back
            failed.append(chosen.move)
            continue
        truth, seen, failed = there, more, []
        try:
            answer = plan_from(here)
        except InputError:
            return None
        if answer.ok:
            return Looked(here, answer, truth, pixels, number, frozenset(failures))
    return None


def _seen_from(
    joints: FloatArray, truth: Truth, here: ViewingState, random: np.random.Generator
) -> tuple[Truth, FloatArray]:
    """Return the truth as the camera has it there, and its image's pixels (n, 2), NaN where not seen."""
    back = truth.initial_T_camera(joints[None])[0].inv()
    truth = replace(
        truth, start=joints, points=back.apply(truth.points),
        balls=[(back.apply(centre), radius) for centre, radius in truth.balls],
    )  # fmt: skip
    pixels, valid = truth.camera.project(truth.points)
    valid &= truth.camera.in_image(np.where(valid[:, None], pixels, -1e3))
    pixels = pixels + NOISE_PX * random.standard_normal(pixels.shape)
    valid &= here.asked.camera.unproject(np.where(valid[:, None], pixels, 0.0))[1]
    pixels[~valid] = np.nan
    return truth, pixels


def _views(asked: PlanningProblem, setting: ArmSetting, seen: Seen) -> ArmViews:
    """Return all views, the newest first."""
    arm, mount = setting.arm, setting.flange_T_camera
    poses = [arm.base_T_flange(joints) * mount for joints, _ in seen.taken]
    way = poses[0].inv() * seen.base_T_goal
    square = float(way.translation @ way.translation)
    slopes = np.eye(6) - adjoint(way.inv())
    by_mount = way.translation @ way.rotation.as_matrix() @ slopes[:3] / square
    known = KnownErrors(
        seen.mount, seen.camera_covariance, LengthPrior(np.sqrt(square), 0.0, by_mount=by_mount)
    )
    first, *earlier = [pixels for _, pixels in seen.taken]
    pixels = np.array([first, seen.goal, *earlier])
    shown = np.isfinite(pixels).all(axis=2)
    noise = np.full(shown.shape, seen.estimate.noise_px)
    reached = chain_of(poses[0], [None, *poses[1:]])
    return ArmViews(asked.camera, np.nan_to_num(pixels), shown, noise, reached, known, is_guess=True)


def _violated(move: CertifiedMove, truth: Truth, here: ViewingState) -> set[str]:
    """Return what a move violates in truth."""
    joints = move.joints(np.linspace(0.0, 1.0, 41))
    left = Gaps(truth, here.setting.clearance_around, here.setting.self_clearance).least(joints)
    centres = truth.initial_T_camera(joints).translation
    centre = min(
        (float(np.linalg.norm(centres - c, axis=1).min()) - r for c, r in truth.balls), default=np.inf
    )
    low, high = truth.arm.joint_range.T
    failures = {
        "a body's clearance, looking": left < 0.0,
        "camera's clearance, looking": centre < here.asked.clearance,
        "joint range, looking": bool(((joints < low) | (joints > high)).any()),
    }
    return {name for name, bad in failures.items() if bad}
