"""Everything that one run produced: what the report is made from."""

from __future__ import annotations

from dataclasses import dataclass, field

from omniservo.cameras.conversion import to_unified
from omniservo.estimation import TwoViewEstimate
from omniservo.geometry.arrays import ByteArray, FloatArray, IntArray
from omniservo.perception import MatchedPoints
from omniservo.planning import Plan
from omniservo.recording.run_recording import RecordedAs
from omniservo.results.run_log import RunLog
from omniservo.results.taken_look import TakenLook
from omniservo.results.whole_arm import WholeArm
from omniservo.risk import RiskPlan
from omniservo.tasks.task import Task
from omniservo.tasks.taught_goal import TaughtGoal
from omniservo.tracking import Replanning
from omniservo.tracking.followed_way import FollowedWay
from omniservo.tracking.planned_motion import PlannedMotion


@dataclass(frozen=True)
class Seen:
    """The two images and the points matched between them."""

    initial_image: ByteArray
    """(height, width)"""
    goal_image: ByteArray
    """(height, width)"""
    matched: MatchedPoints
    """n points"""


@dataclass(frozen=True)
class Film:
    """Images taken during the servo, for the animation."""

    times: tuple[float, ...]
    """[s]"""
    camera: tuple[ByteArray, ...]
    """(height, width) each, what the camera saw"""
    outside: tuple[ByteArray, ...]
    """(rows, columns, 3) each, a bystander's view; none on a real robot"""


@dataclass(frozen=True)
class Truth:
    """The truth, for scoring and for the report's figures only."""

    initial_T_goal: FloatArray
    """(4, 4)"""
    points: FloatArray
    """(m, 3) the followed points, initial camera frame [m]"""
    obstacle_corners: tuple[FloatArray, ...]
    """(8, 3) of each obstacle block, initial camera frame [m]"""


@dataclass(frozen=True)
class RunResult:
    """One run of one method on one task."""

    task: Task
    method: str
    """a name of `omniservo.run_methods.METHODS`, or FILE.CLASS of one from a file"""
    goal: TaughtGoal
    seen: Seen
    estimate: TwoViewEstimate
    """of all n matched points"""
    followed: IntArray
    """(m,) rows of the points that are planned for and servoed on"""
    plan: Plan | None
    """None where the method plans nothing"""
    risk: RiskPlan | None
    """what is known of the plan's risk, where the task states one"""
    motion: PlannedMotion | None
    """the plan in joints and in time; None where nothing was planned"""
    whole_arm: WholeArm | None
    """the clearance of all links; None where nothing was planned"""
    log: RunLog
    final_image: ByteArray
    outside: tuple[ByteArray, ByteArray] | None
    """(rows, columns, 3) robot and obstacle at the start and at the end; None on a real robot"""
    film: Film
    truth: Truth | None
    """None on a real robot"""
    way: FollowedWay | None
    """the plan's way and what was entered after it; None where nothing was planned"""
    replannings: tuple[Replanning, ...]
    """every time when something had changed on the way"""
    seconds: dict[str, float]
    """perception, estimation, planning, each as it was done, with what of it was loading or compiling code
    (perception_code, …); control (median of a step); whole run"""
    metrics: dict[str, object] = field(default_factory=dict)
    """as in metrics.json"""
    looks: tuple[TakenLook, ...] = ()
    """small moves before the plan; the task, and its initial camera frame, begin after the last of them"""

    recorded: RecordedAs | None = None
    """how much of it a recording has; None: it has none"""

    @property
    def notices(self) -> tuple[str, ...]:
        """What a person must know of camera and problem, and of how fast the plan is followed."""
        problem = () if self.plan is None else self.plan.problem.notices
        motion = () if self.motion is None else self.motion.notices
        recorded = "" if self.recorded is None else self.recorded.notice
        return (*filter(None, [to_unified(self.task.camera).cost, recorded]), *problem, *motion)

    @property
    def is_filmed(self) -> bool:
        """Whether it can be shown moving; a run that was stopped before its first step stands still."""
        return bool(self.film.times) or not self.log.rows

    @property
    def points(self) -> FloatArray:
        """(m, 3) the followed points as estimated, initial camera frame [m]."""
        return self.estimate.points[self.followed]

    @property
    def initial_pixels(self) -> FloatArray:
        """(m, 2) the followed points in the initial image [px]."""
        return self.seen.matched.initial[self.followed]

    @property
    def goal_pixels(self) -> FloatArray:
        """(m, 2) the followed points in the goal image [px]."""
        return self.seen.matched.goal[self.followed]
