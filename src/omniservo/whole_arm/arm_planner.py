"""The search for a camera path that an arm can follow on one branch, clear of everything."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain, islice
from typing import NamedTuple

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.polynomial import bernstein_from_power
from omniservo.geometry.quick_poses import inverse
from omniservo.geometry.subdivision import PROVEN
from omniservo.planning.camera_path import CameraPath
from omniservo.planning.improving_plans import first_proven
from omniservo.planning.judged_plan import judged_plan
from omniservo.planning.plan import Plan
from omniservo.planning.planning_problem import PlanningProblem
from omniservo.planning.search.path_family import offsets, path_family, unknowns
from omniservo.planning.search.problem_search import ProblemSearch, ends_like
from omniservo.planning.search.prove_path import prove_whole_path
from omniservo.planning.search.settle import power_path
from omniservo.planning.time_budget import TimeBudget
from omniservo.robots import ArmBodies, FollowedPath, JointPath, follow_path
from omniservo.robots.collision.carried_bodies import carried_too_close
from omniservo.whole_arm.arm_descent import LEAP, ArmDescent
from omniservo.whole_arm.arm_ends import free_postures
from omniservo.whole_arm.arm_equations import lead_onto
from omniservo.whole_arm.arm_plan import ArmPlan
from omniservo.whole_arm.arm_setting import ArmSetting
from omniservo.whole_arm.joint_curves import joint_curves
from omniservo.whole_arm.joint_demands import JointDemands
from omniservo.whole_arm.judged_branch import JudgedBranch, judged_branch

ATTEMPTS = 16
"""Camera paths from different starts at most, unless more are required"""

ROUNDS = 5
"""Descents for one of them."""

BRANCHES = 3
"""that are tried for one of them, where the arm may start in any"""

AIMS = 8
"""configurations at the goal that seven joints are led to, where they do not find there by themselves"""

NEAR = 17
"""Even places, ends included, at which joints say what a camera path is likely to need"""

_LOOKED_AT = np.linspace(0.0, 1.0, 2 * NEAR - 1)
"""where a camera path is checked before the arm is led along it"""

_PLACES = np.arange(1, NEAR - 1) / (NEAR - 1.0)
"""where a descent samples"""

_HIGHER = 1.5

HOPELESS = 8
"""On the way: so many camera paths in a row at whose end the arm cannot stand, and the next will not help"""

_FARTHER = 0.02
"""What a descent adds at least to how far the arm gets; else another start is taken."""


@dataclass(frozen=True, eq=False)
class _Attempt:
    path: CameraPath
    judged: JudgedBranch
    followed: FollowedPath
    aim: FloatArray | None
    """what seven joints were led to"""


class _Begin(NamedTuple):
    """What a camera path is moved from."""

    joints: FloatArray
    """(k, n) near those that follow it at the first k of the samples [rad]"""
    ends: FloatArray
    """(1 or 2, n) where it begins and, if they come so far, ends"""
    until: float
    """so far they come"""


class ArmPlanner:
    """The search for one problem and one arm, where both end poses are free."""

    def __init__(
        self,
        problem: PlanningProblem,
        setting: ArmSetting,
        bodies: ArmBodies,
        seed: int,
        budget: TimeBudget,
        *,
        aims: Sequence[FloatArray | None] | None = None,
        velocity: FloatArray | None = None,
    ) -> None:
        """Join them.

        ``bodies`` are the setting's among the problem's obstacles, ``budget`` began when all did; ``aims``
        are what self-motion is led to, one after the other: by default nothing, then what is free at the
        goal; ``velocity`` as for `follow_path`.
        """
        self._aims_given, self._velocity = aims, velocity
        self._setting, self._bodies, self._seed, self._budget = setting, bodies, int(seed), budget
        self.problem = problem
        """as given"""
        self.search = ProblemSearch.of(problem, self._seed)
        """the camera's own"""
        self._constraints = self.search.constraints
        self._ell = self._constraints.ell
        self._joint_demands = JointDemands(setting, bodies, self._ell)
        self._seen = self._joint_demands.seen(len(_PLACES))
        self._base_T_initial = setting.base_T_initial.as_matrix()
        self._camera_T_flange = inverse(setting.flange_T_camera)
        self._in_sight = setting.points_in_sight(problem)
        self._unproven: tuple[CameraPath, str]
        self._known: dict[CameraPath, list[_Attempt]] = {}
        self._looked_ahead: dict[CameraPath, tuple[bool, FloatArray | None]] = {}

    def as_they_are(self, paths: Iterable[CameraPath], near: FloatArray) -> ArmPlan | None:
        """Return the plan of the first camera path that the arm can follow unmoved; None: of none.

        ``near`` as for `rules_out`, by which paths are passed over before they are followed.
        """
        for number, path in enumerate(paths, start=1):
            if self.rules_out(path, near):
                continue
            found = self._first_certified(self._unmoved(path), number)
            if found is not None:
                return found
        return None

    def moved_from(self, path: CameraPath, near: FloatArray) -> ArmPlan | None:
        """Return the plan of a camera path moved until the arm can follow it; None: it does not come to that.

        ``near`` (`NEAR`, n): joints near those that follow the path at even places. It is not followed.
        """
        aim = self._aims_given[0] if self._aims_given else None
        moved = self._moved(path, _Begin(near[1:-1], near[[0, -1]], 1.0), aim)
        return None if moved is None else self._first_certified([moved], 1)

    def _first_certified(self, attempts: Iterable[_Attempt], tried: int) -> ArmPlan | None:
        """Return the plan of the first attempt that will do; None: of none."""
        for attempt in attempts:
            if not attempt.judged.reason:
                plan = judged_plan(self.problem, attempt.path, self._budget.begin, "certified", "")
                if plan.status == "certified":
                    return self._arm_plan(plan, attempt, tried)
        return None

    def rules_out(self, path: CameraPath, near: FloatArray) -> bool:
        """Return whether the arm fails at one of a few places of a path, judged by joints `led_onto` it."""
        return self._foreseen(path, near)[0]

    def led_onto(self, path: CameraPath, near: FloatArray) -> FloatArray | None:
        """Return joints (`NEAR`, n) at even places of a path, by Newton from ``near``; None: it fails."""
        return self._foreseen(path, near)[1]

    def _foreseen(self, path: CameraPath, near: FloatArray) -> tuple[bool, FloatArray | None]:
        """Return both; kept."""
        if path not in self._looked_ahead:
            (poses, _), led = path.sampled(_LOOKED_AT), near.copy()
            flange = self._base_T_initial @ poses @ self._camera_T_flange
            arrives = lead_onto(self._setting.arm.chain, flange[::2], LEAP, True, led)
            fails = not arrives or carried_too_close(self._bodies, flange, self._joint_demands.gaps)
            fails = fails or bool(self._joint_demands.values(led[1:-1], 0.0, self._seen).min() < 0.0)
            self._looked_ahead[path] = fails, led if arrives else None
        return self._looked_ahead[path]

    def stands_at_end(self, path: CameraPath) -> bool | None:
        """Return whether the arm can stand where a camera path leads it; None: it does not get there."""
        branches = [attempt.judged.branch for attempt in self._unmoved(path)]
        ends = [self._joint_demands.values(b.positions[-1:]) for b in branches if b.w[-1] >= 1.0]
        return any(bool((least >= 0.0).all()) for least in ends) if ends else None

    def plan(self, first: CameraPath | None = None, *, attempts: int = ATTEMPTS) -> ArmPlan:
        """Try one start after the other, before them a proven camera path if one is given."""
        paths, few = self._paths(first), min(int(attempts), ATTEMPTS)
        rest = islice(paths, int(attempts) - few)
        tried, best = 0, None
        for made in chain(self._of_paths(islice(paths, few)), self._of_curves(), self._of_paths(rest)):
            tried += 1
            found = self._first_certified(made, tried)
            if found is not None:
                return found
            best = max([*made, *([] if best is None else [best])], key=lambda a: a.judged.until)
            if self._late:
                break
        if best is None:
            path, missing = self._unproven
            plan = judged_plan(self.problem, path, self._budget.begin, "certified", "", missing)
            return ArmPlan(plan, None, None, None, time.perf_counter() - self._budget.begin, tried)
        plan = judged_plan(self.problem, best.path, self._budget.begin, "certified", "")
        best = replace(best, judged=self._judged(best.judged.branch))
        why = f"the arm can follow none of {tried} camera paths; the best attempt: {best.judged.reason}"
        return self._arm_plan(replace(plan, status="not_found", reason=why), best, tried)

    def _of_paths(self, paths: Iterable[CameraPath]) -> Iterator[list[_Attempt]]:
        """Yield what comes of camera paths."""
        ends = 0
        for path in paths:
            if self._aims_given is not None:
                ends = ends + 1 if self.stands_at_end(path) is False else 0
            yield self._attempts(path)
            if ends == HOPELESS:
                return

    def _of_curves(self) -> Iterator[list[_Attempt]]:
        """Yield what comes of paths near curves in joint space, moved from these joints on."""
        setting = self._setting
        if setting.start is None or self._late:  # the postures take a while to find
            return
        for joints, path in joint_curves(
            self.problem, setting, setting.start, self._free_at_goal, NEAR, self._seed
        ):
            if self._late:
                return
            aim = joints[-1] if setting.arm.dof > 6 else None
            moved = self._moved(path, _Begin(joints[1:-1], joints[[0, -1]], 0.0), aim)
            if moved is not None:
                yield [moved]

    @property
    def _late(self) -> bool:
        return self._budget.is_used_up

    def _paths(self, first: CameraPath | None) -> Iterator[CameraPath]:
        """Yield proven camera paths, until no more are found."""
        if first is not None:
            yield first
        number, search = 0, self.search
        while number < search.starts:
            found, tried = first_proven(search, self._budget, int(number == 0), number)
            if not found.proven:
                self._unproven = found.path, f"no path in {tried} starts"
                return
            number = found.number + 1
            yield found.path

    def _arm_plan(self, plan: Plan, attempt: _Attempt, attempts: int) -> ArmPlan:
        seconds = time.perf_counter() - self._budget.begin
        judged = attempt.judged
        return ArmPlan(
            replace(plan, seconds=seconds, aim=attempt.aim),
            judged.branch,
            attempt.followed,
            judged.clearance,
            seconds,
            attempts,
        )

    def _attempts(self, path: CameraPath) -> list[_Attempt]:
        """Return what came of a camera path: the first attempt that will do is the last."""
        tried = list(self._unmoved(path))
        if not tried[-1].judged.reason:
            return tried
        mendable = [attempt for attempt in tried if not attempt.judged.is_hidden]
        for attempt in sorted(mendable, key=lambda a: -a.judged.until)[:BRANCHES]:
            if self._late:
                break
            better = self._moved(attempt.path, _begin(attempt), attempt.aim)
            if better is not None:
                tried.append(better)
                if not better.judged.reason:
                    break
        return tried

    def _unmoved(self, path: CameraPath) -> list[_Attempt]:
        """Return what every branch and aim makes of a camera path: the first that will do is the last."""
        if path in self._known:
            return self._known[path]
        tried = self._known[path] = []
        for aim in self._aims():
            if tried and self._late:
                break
            followed = self._follow(path, self._setting.start, aim)
            for branch in followed.branches:
                judged = self._judged(branch, worst=False)
                tried.append(_Attempt(path, judged, followed, aim))
                if not judged.reason:
                    return tried
        return tried

    def _judged(self, branch: JointPath, *, worst: bool = True) -> JudgedBranch:
        return judged_branch(self._setting, self._bodies, branch, self._in_sight, worst=worst)

    def _follow(self, path: CameraPath, start: FloatArray | None, aim: FloatArray | None) -> FollowedPath:
        setting = self._setting
        frames = setting.base_T_initial, setting.flange_T_camera
        return follow_path(setting.arm, path, *frames, start=start, aim=aim, velocity=self._velocity)

    def _aims(self) -> Iterator[FloatArray | None]:
        """Yield what the arm's self-motion is led to; None: nothing."""
        if self._aims_given is not None:
            yield from self._aims_given
            return
        yield None
        if self._setting.arm.dof > 6:
            yield from self._free_at_goal

    @cached_property
    def _free_at_goal(self) -> FloatArray:
        """Joints (k, n) free at the goal, those first that are near the start; none without a start."""
        setting, start = self._setting, self._setting.start
        if start is None:
            return np.empty((0, setting.arm.dof))
        postures = free_postures(self.problem, setting, self._bodies)
        seconds = (np.abs(postures - start) / setting.arm.joint_speed).max(axis=1)
        return postures[np.argsort(seconds)][:AIMS]

    def _moved(self, path: CameraPath, begin: _Begin, aim: FloatArray | None) -> _Attempt | None:
        """Return a camera path moved until the arm can follow it, or as far as it came; None: nowhere."""
        sigma, tau = self.search.degrees.tolist()
        family = path_family(ends_like(self.search.ends, path), sigma, tau)
        x = np.zeros(unknowns(family))
        end_least = self._joint_demands.values(begin.ends)
        if not len(x) or end_least.min() < 0.0:
            return None  # what fails where the path ends cannot be helped on its way there
        controls = _controls(path.rotation, sigma), _controls(path.translation, tau)
        offsets(family, self._ell, *controls, x)
        descent = ArmDescent(self._constraints, family, self._setting, self._joint_demands, self._seen)
        places, joints, until, higher = _PLACES, begin.joints, begin.until, 1.0
        start = begin.ends[0] if self._setting.start is None else self._setting.start
        best = None
        for _ in range(ROUNDS):
            if self._late:
                break
            lowered = descent.lower(x, places, joints, end_least, higher)
            if lowered is None:
                break
            x, reached = lowered
            path = CameraPath(*power_path(family, self._ell, x))
            followed = self._follow(path, start, aim)
            now = _Attempt(path, self._judged(followed.best), followed, aim)
            status, w = prove_whole_path(self._constraints, *path.powers)
            before, until = until, now.judged.until
            if status == PROVEN and until >= (begin.until if best is None else best.judged.until):
                best = now
            stuck = until >= 1.0 or until < before + _FARTHER
            done = status == PROVEN and not now.judged.reason
            if done or now.judged.is_hidden or (stuck and not reached):
                break
            further = [now.judged.w] if now.judged.reason else []
            further += [w] if status != PROVEN else []
            places = np.unique(np.concatenate([places, np.clip(further, 0.01, 0.99)]))
            joints = _at_places(followed.best, places)
            higher *= _HIGHER
        return best


def _begin(attempt: _Attempt) -> _Begin:
    branch = attempt.judged.branch
    ends = branch.positions[[0, -1]] if branch.w[-1] >= 1.0 else branch.positions[:1]
    return _Begin(_at_places(branch, _PLACES), ends, attempt.judged.until)


def _at_places(branch: JointPath, places: FloatArray) -> FloatArray:
    """Return the joints at places as far as the branch goes."""
    return branch(places[places <= branch.w[-1]])


def _controls(powers: FloatArray, degree: int) -> FloatArray:
    """Return the Bernstein coefficients of a higher degree, from powers."""
    missing = degree + 1 - powers.shape[1]
    padded: FloatArray = np.hstack([np.zeros((len(powers), missing)), powers])
    controls: FloatArray = bernstein_from_power(padded)
    return controls
