"""Planning again while the camera moves: when what is known has changed, and what is done then."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from time import perf_counter
from typing import Literal

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.errors import Blocked, InputError, NotFinite
from omniservo.geometry.arrays import FloatArray, finite_number
from omniservo.geometry.subdivision import PROVEN
from omniservo.planning import CameraPath, Plan, PlanningProblem
from omniservo.planning.constraints.constraints import Constraints
from omniservo.planning.obstacles.obstacle import Obstacle
from omniservo.planning.problem_arrays import searched_constraints
from omniservo.planning.search.prove_path import prove_whole_path
from omniservo.replanning import replan, replan_with_arm
from omniservo.robots import ArmBodies, JointPath, Solid, arm_clearance
from omniservo.servoing import RestOfLaw
from omniservo.tracking.following_arm import FollowingArm
from omniservo.tracking.goal_image import GoalImage
from omniservo.tracking.leg import Leg
from omniservo.tracking.path_tracker import PathTracker
from omniservo.tracking.replan_options import ReplanOptions
from omniservo.tracking.replanning import Replanning
from omniservo.whole_arm import ArmSetting
from omniservo.whole_arm.part_of_joints import part_of_joints

LEAST_REST = 1e-3
"""Where less than this part of a leg is left nothing is planned any more."""

SLOWED = 0.4
"""The clock's pace on the old way where the new one is entered too fast for its bend,"""

SLOWING = 0.3
"""[s] after which the new way is planned from there"""

_SHORTEST = 1e-9
"""part of a leg that is worth a look"""


@dataclass(frozen=True, eq=False)
class _Fork:
    """Where a way is left."""

    leg: Leg
    joints: JointPath | None
    time: float
    before: tuple[Leg, ...] = ()
    """legs to be entered before"""
    joints_before: tuple[JointPath | None, ...] = ()

    @cached_property
    def s(self) -> float:
        return self.leg.law(self.time)[0]

    @cached_property
    def pose(self) -> RigidTransform:
        """In the plan's frame."""
        return self.leg.path(self.s)


@dataclass(frozen=True, eq=False)
class _Known:
    """What is known now, prepared for all that is required of it."""

    problem: PlanningProblem
    constraints: Constraints
    """of a camera path"""
    setting: ArmSetting | None
    """what the arm has to keep; None: no arm"""
    bodies: ArmBodies | None
    """the arm among the obstacles; None: no arm"""


class Replanner:
    """Keeps a tracker on proven ways while obstacles move and the estimate changes.

    After every command `look` is called. Where something has changed the rest of the way is proven again for
    what is known now; where that fails, another way is planned from where the reference will be in a moment,
    with its pose and velocity, near the old one if that can be (`replan`), and entered there: the reference
    has no jump in pose or twist, and the joints that follow it have none in position or, six of them, in
    speed. Its law is what is left of the old one, its clock slowed down where the joints ask for it
    (`RestOfLaw`); a way that would be entered too fast for its bend is planned anew from the old one slowed
    down. If no way on is proven, `look` raises `Blocked`, and the robot is braked. What has changed counts as
    answered only once a way is proven for it: until then, whatever was raised, every later `look` answers it
    anew, and a way that is blocked stays blocked.

    Args:
        tracker: follows the plan.
        plan: with which it was made.
        arm: that carries the camera; None: the camera alone is planned for, and laws are carried on.
        required: what a way has to keep where none is proven that keeps all that the plan does, which is more
            where it was planned at a stated risk; obstacles that are stated anew replace its own. None: all.
        options: see ReplanOptions.

    Raises:
        InputError: a plan without a path, or obstacles with a motion.
    """

    def __init__(
        self,
        tracker: PathTracker,
        plan: Plan,
        *,
        arm: FollowingArm | None = None,
        required: PlanningProblem | None = None,
        options: ReplanOptions | None = None,
    ) -> None:
        self.options = options or ReplanOptions()
        """as given"""
        self.events: list[Replanning] = []
        """every look at which something had changed"""
        if plan.path is None:
            raise InputError(f"plan: status {plan.status!r} without a path; a plan with a path is needed")
        self._tracker, self._plan, self._arm, self._required = tracker, plan, arm, required
        self._problem = self._asked = plan.problem
        self._time = -math.inf
        self._judged: tuple[GoalImage, PlanningProblem] | None = None
        self._solids: tuple[Solid, ...] = ()
        self._joints = [None if arm is None else arm.joints]
        self._around: ArmBodies | None = None
        self.set_obstacles(plan.problem.obstacles)
        self._rehearse()

    @property
    def obstacles(self) -> tuple[Obstacle, ...]:
        """As known now, in the plan's initial camera frame."""
        return self._asked.obstacles

    @property
    def change(self) -> float:
        """How far the tracker's estimate has moved from what is planned for [m].

        The largest of: the goal's centre, the goal's rotation times the points' mean distance, and the
        points, root mean square.
        """
        problem, pose = self._problem, self._tracker.goal.pose
        shift = pose[4:] - problem.goal_translation
        turned = abs(float(pose[:4] @ problem.goal_quaternion)) / float(np.linalg.norm(pose[:4]))
        distance = float(np.linalg.norm(problem.points - problem.goal_translation, axis=1).mean())
        moved = self._tracker.points - problem.points
        parts = [
            float(np.linalg.norm(shift)),
            distance * 2.0 * math.acos(min(turned, 1.0)),
            float(np.sqrt(np.mean(np.sum(moved * moved, axis=1)))),
        ]
        return float(np.max(parts))  # NaN where any of them is

    def set_obstacles(self, obstacles: Iterable[Obstacle]) -> None:
        """Say where obstacles are now, all of them: what is not among them is gone.

        Args:
            obstacles: in the plan's initial camera frame; each keeps its own clearance, or the problem's.

        Raises:
            InputError: what a problem refuses; or an obstacle with a motion, which runs over a plan's own w.
                What was said before still counts then.
        """
        asked = replace(self._problem, obstacles=tuple(obstacles))
        for i, obstacle in enumerate(asked.obstacles):
            if obstacle.motion is not None:
                raise InputError(f"obstacles[{i}]: motion given; legal: where it is now, again as it moves")
        if self._arm is not None:
            self._solids = self._arm.setting.solids(asked.obstacles)  # refuses what it cannot judge
        self._asked = asked

    @property
    def legs(self) -> tuple[Leg, ...]:
        """The tracker's."""
        return self._tracker.legs

    @property
    def joints(self) -> tuple[JointPath | None, ...]:
        """What follows each of the tracker's legs; None without an arm."""
        return tuple(self._joints)

    def leg_number(self, time: float) -> int:
        """Return which of the tracker's legs is followed at ``time`` [s]."""
        return max([k for k, leg in enumerate(self._tracker.legs) if leg.time <= time], default=0)

    def posture(self, time: float) -> tuple[FloatArray, FloatArray]:
        """Return the joints (n,) [rad] and their speeds [rad/s] at ``time`` [s] since the servo's start.

        Raises:
            InputError: no arm was given.
        """
        leg, joints = self._at(time)
        if joints is None:
            raise InputError("posture: no arm was given")
        s, speed = leg.law(time)
        return joints(s), speed * joints(s, 1)

    def look(self, time: float) -> Replanning | None:
        """Plan again where something has changed; return what came of it, None where nothing had changed.

        Args:
            time: of the last image, since the servo's start [s]; it does not run backwards.

        Raises:
            Blocked: no way on is proven.
            NotFinite: the tracker's estimate is not.
            InputError: the time is not finite, or before that of the last look.
        """
        self._time = finite_number("time", time, minimum=self._time)
        cause, problem = self._changed()
        if cause is None:
            return None
        begin = perf_counter()
        event = self._answer(time, cause, self._known(problem), begin)
        if event.outcome == "blocked" and self._required is not None:
            event = self._answer(time, cause, self._least(self._required, problem), begin)
        event = replace(event, seconds=perf_counter() - begin)
        self.events.append(event)
        if event.outcome == "blocked":
            raise Blocked(f"{cause} changed at {time:.3f} s and no way on is proven: {event.reason}")
        for leg, joints in zip(event.legs, event.joints, strict=True):
            self._tracker.take_up(leg)
            self._joints.append(joints)
        self._problem = problem  # last: whatever is raised above, the next look answers the change anew
        return event

    def _changed(self) -> tuple[Literal["obstacles", "estimate"] | None, PlanningProblem]:
        """Return what has changed since a way was last proven, and what is known now."""
        cause: Literal["obstacles", "estimate"] | None = None
        problem = self._problem
        asked, known = self._asked.obstacles, problem.obstacles
        if not _are_same(asked, known):
            cause, problem = "obstacles", replace(problem, obstacles=asked)
        if self._has_moved():
            cause, pose = cause or "estimate", self._tracker.goal.pose
            goal = RigidTransform.from_components(pose[4:], Rotation.from_quat(pose[:4]))
            problem = replace(problem, points=self._tracker.points, initial_T_goal=goal)
        return cause, problem

    def _has_moved(self) -> bool:
        """Return whether the tracker's estimate is farther from what is planned for than the tube."""
        judged = self._tracker.goal, self._problem  # the goal is another one whenever the estimate is
        if self._judged is not None and all(a is b for a, b in zip(judged, self._judged, strict=True)):
            return False
        change = self.change
        if not math.isfinite(change):
            raise NotFinite("the tracker's estimate of points and goal is not finite")
        if change > self.options.tube:
            return True
        self._judged = judged
        return False

    def _least(self, required: PlanningProblem, problem: PlanningProblem) -> _Known:
        """Return what is required of what is known now."""
        stated = _are_same(problem.obstacles, self._plan.problem.obstacles)
        least = replace(
            required,
            points=problem.points,
            initial_T_goal=problem.initial_T_goal,
            obstacles=required.obstacles if stated else problem.obstacles,
        )
        known = self._known(least)
        arm_keeps = known.setting if self._arm is None else self._arm.required or known.setting
        return replace(known, setting=arm_keeps)

    def _answer(
        self, time: float, cause: Literal["obstacles", "estimate"], known: _Known, begin: float
    ) -> Replanning:
        """Return what is to be done; how long that took is stated by `look`."""
        # A way that is to be entered only later is entered first: no leg begins before the last one.
        problem, later = known.problem, max(time + self.options.ahead, self._tracker.legs[-1].time)
        same_goal = problem.initial_T_goal is self._problem.initial_T_goal

        kept = Replanning(time, cause, "kept", self._at(later)[0].w(later)[0], problem, 0.0)
        if same_goal and self._is_clear(known, time, np.inf):
            return kept
        if not self._is_clear(known, time, later):
            reason = "what is gone before another way could be taken up is not clear"
            return replace(kept, outcome="blocked", reason=reason)
        fork: _Fork | None = _Fork(*self._at(later), later)
        reason = ""
        while fork is not None and not reason:
            plan, joints = self._planned(known, fork)
            reason = "" if plan.status == "certified" else plan.reason
            budget = self.options.time_budget
            if budget is not None and perf_counter() - begin > budget:
                reason = f"planning took longer than {budget:g} s"
            elif plan.path is not None and not reason:
                path = plan.path.seen_in(fork.pose)
                law = self._law(fork, path, joints)
                if law is not None:
                    legs = (*fork.before, Leg(path, law, fork.time, fork.leg.w(fork.time)[0]))
                    after = (*fork.joints_before, joints)
                    return replace(kept, outcome="replanned", legs=legs, joints=after, plan=plan)
                fork = None if fork.before else self._slowed(known, fork)
        words = "the joints cannot turn into the way found as fast as they move"
        return replace(kept, outcome="blocked", reason=reason or words)

    def _slowed(self, known: _Known, fork: _Fork) -> _Fork | None:
        """Return a later place to leave the old way from, more slowly; None if the way there is not clear."""
        arm, leg, s = self._arm, fork.leg, fork.s
        if arm is None or arm.limits is None or fork.joints is None:
            return None
        path, joints = leg.path.part(s, 1.0), part_of_joints(arm.setting, fork.joints, s, 1.0)
        law = RestOfLaw(leg.law, fork.time, SLOWED, SLOWING)
        slow = Leg(path, law, fork.time, leg.w(fork.time)[0])
        end = law(fork.time + SLOWING)[0]
        if 1.0 - end < LEAST_REST or not law.keeps(arm.limits(path, joints)):
            return None
        if not self._keeps(known, path, joints, 0.0, max(end, _SHORTEST)):
            return None
        return _Fork(slow, joints, fork.time + SLOWING, (slow,), (joints,))

    def _rehearse(self) -> None:
        """Go through all of it once, so that compiling does not delay a twist."""
        known, later = self._known(self._problem), self.options.ahead
        self._is_clear(known, 0.0, later)
        fork = _Fork(*self._at(later), later)
        plan, joints = self._planned(known, fork)
        if plan.path is not None and plan.status == "certified":
            self._law(fork, plan.path, joints)

    def _known(self, problem: PlanningProblem) -> _Known:
        """Return a problem with the obstacles that were stated last, prepared."""
        if self._arm is not None and (
            self._around is None or not self._around.move_surroundings(self._solids)
        ):
            self._around = self._arm.setting.bodies(problem.obstacles)
        setting = None if self._arm is None else self._arm.setting
        return _Known(problem, searched_constraints(problem), setting, self._around)

    def _law(self, fork: _Fork, path: CameraPath, joints: JointPath | None) -> RestOfLaw | None:
        """Return how another way is gone from there; None: the joints are too fast for it."""
        limits = None
        if self._arm is not None and self._arm.limits is not None and joints is not None:
            limits = self._arm.limits(path, joints)
        return RestOfLaw.within(fork.leg.law, fork.time, limits)

    def _planned(self, known: _Known, fork: _Fork) -> tuple[Plan, JointPath | None]:
        seed, budget = self.options.seed, self.options.time_budget
        followed, problem = replace(self._plan, path=fork.leg.path), known.problem
        if 1.0 - fork.s < LEAST_REST:
            reason = "it is too near to the goal to plan again"
            return replace(followed, status="not_found", reason=reason), None
        if fork.s == 0.0 and fork.leg.law(fork.time)[1] > 0.0:  # to be taken up just then: it moves already
            problem = replace(problem, initial_velocity=fork.leg.path(0.0, 1))
        if known.setting is None or fork.joints is None:
            found = replan(followed, fork.s, problem, pose=fork.pose, time_budget=budget, seed=seed)
            return found, None
        with_arm = replan_with_arm(
            followed, fork.joints, fork.s, problem, known.setting,
            pose=fork.pose, bodies=known.bodies, time_budget=budget, seed=seed,
        )  # fmt: skip
        return with_arm.plan, with_arm.branch

    def _is_clear(self, known: _Known, since: float, until: float) -> bool:
        """Return whether the way between two times [s] is proven for what is known, camera and arm."""
        legs = self._tracker.legs
        for k, (leg, joints) in enumerate(zip(legs, self._joints, strict=True)):
            left = legs[k + 1].time if k + 1 < len(legs) else np.inf
            last = min(until, left)
            if last <= since or leg.time >= until:
                continue
            begin = leg.law(max(since, leg.time))[0]
            end = 1.0 if last == np.inf else leg.law(last)[0]
            if not self._keeps(known, leg.path, joints, begin, max(end, begin + _SHORTEST)):
                return False
        return True

    def _keeps(
        self, known: _Known, path: CameraPath, joints: JointPath | None, begin: float, end: float
    ) -> bool:
        """Return whether a part of a way is proven for what is known."""
        if prove_whole_path(known.constraints, *path.part(begin, end).powers)[0] != PROVEN:
            return False
        setting = known.setting
        if setting is None or known.bodies is None or joints is None:
            return True
        found = arm_clearance(
            known.bodies,
            joints,
            clearance=setting.clearance_around,
            self_clearance=setting.self_clearance,
            span=(begin, end),
            worst=False,
        )
        points = setting.points_in_sight(known.problem)
        if found.status != "clear" or points is None:
            return found.status == "clear"
        return setting.own_sight(joints, points, (begin, end)).status == "free"

    def _at(self, time: float) -> tuple[Leg, JointPath | None]:
        """Return the leg that is followed at ``time`` [s], and the joints that do."""
        k = self.leg_number(time)
        return self._tracker.legs[k], self._joints[k]


def _are_same(obstacles: tuple[Obstacle, ...], others: tuple[Obstacle, ...]) -> bool:
    """Return whether nothing was stated anew."""
    return len(obstacles) == len(others) and all(a is b for a, b in zip(obstacles, others, strict=True))
