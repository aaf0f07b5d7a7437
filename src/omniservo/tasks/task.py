"""The task: everything that one run needs, read from a YAML file and validated.

The file's frames: target, obstacles and surroundings are stated in the *initial camera frame* (what a person
measures from the camera), or in the ``frame`` that they name; the start pose in the world. A `Task` has all
of them in the initial camera frame.
"""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import (
    AliasChoices,
    Field,
    PrivateAttr,
    StrictBool,
    field_validator,
    model_validator,
)
from scipy.spatial.transform import RigidTransform

from omniservo.geometry.covariances import is_covariance
from omniservo.geometry.quick_poses import composed
from omniservo.planning import Workspace
from omniservo.renamed import renamed_attribute
from omniservo.replanning.frame_change import seen_workspace
from omniservo.robots import TrackingTube
from omniservo.tasks.move import Move
from omniservo.tasks.obstacles import ObstacleSection
from omniservo.tasks.placed import Frame, FramedBlock, Turned
from omniservo.tasks.quantities import A_NUMBER, Angle, NonNegativeLength, Point, PositiveLength, Real
from omniservo.tasks.section import Section
from omniservo.tasks.sensor import SensorSection
from omniservo.tasks.simulation import SimulationSection
from omniservo.tasks.target import TargetSection
from omniservo.tasks.task_sources import TaskSources

FORMAT = "omniservo.task/1"
"""The task format that this version reads."""

MOST_LOOKS = 10


class Pose(Turned):
    """A pose: translation, and how it is turned."""

    translation: Point = (0.0, 0.0, 0.0)
    """[m]"""

    @property
    def transform(self) -> RigidTransform:
        """The pose as SciPy's RigidTransform."""
        return RigidTransform.from_components(np.asarray(self.translation), self.rotation)


FARTHEST_MOUNT = 3.0
"""A camera that sits farther from the flange was stated in another unit [m]."""


class ArmMount(Section):
    """The arm, where it stands, and how the camera sits on it."""

    model: str = "rx60"
    """a shipped arm's name, or the path of an MJCF or URDF file; in the task's file: inside its folder"""
    flange: Annotated[str | None, Field(validation_alias=AliasChoices("flange", "tool"))] = None
    """the arm's site or link that carries the camera; where absent: see `omniservo.robots.Arm`"""
    packages: dict[str, str] = Field(default_factory=dict)
    """folders of ROS packages by name, where the arm's meshes lie; in the task's file: inside its folder"""
    foot: Point = (0.0, 0.0, 0.0)
    """the arm's foot in the world [m]"""
    flange_T_camera: Annotated[Pose, Field(validation_alias=AliasChoices("flange_T_camera", "tool_T_camera"))]
    """the camera in the flange frame; a file may name that of a hand-eye calibration in its folder, and says
    ``tool_T_camera``, and ``tool`` above, where it is older"""
    mount_covariance: tuple[tuple[Real, ...], ...] | None = None
    """(6, 6) of flange_T_camera: translation in the flange's frame [m], rotation vector on the right [rad];
    the file of a hand-eye calibration states it. Plans with a risk count with it"""

    @model_validator(mode="before")
    @classmethod
    def _one_name(cls, fields: Any) -> Any:
        for name, older in (("flange", "tool"), ("flange_T_camera", "tool_T_camera")):
            if isinstance(fields, dict) and {name, older} <= set(fields):
                raise ValueError(f"give {name} or {older}, which mean the same; not both")
        return fields

    tool: ClassVar[Any] = renamed_attribute("tool", "flange")

    @field_validator("flange_T_camera")
    @classmethod
    def _near(cls, pose: Pose) -> Pose:
        far = float(np.linalg.norm(pose.translation))
        if far > FARTHEST_MOUNT:
            raise ValueError(
                f"the camera is {far:g} m from the flange; legal: {FARTHEST_MOUNT:g} m at most; millimetres "
                "for metres? units: {length: mm} says so"
            )
        return pose

    @field_validator("mount_covariance")
    @classmethod
    def _square(cls, rows: tuple[tuple[float, ...], ...] | None) -> tuple[tuple[float, ...], ...] | None:
        if rows is None:
            return None
        if len(rows) != 6 or any(len(row) != 6 for row in rows):
            raise ValueError("six rows of six numbers are needed")
        if not is_covariance(np.array(rows)):
            raise ValueError("a symmetric matrix without negative eigenvalues is needed")
        return rows


class StartSection(Section):
    """Where the camera is at the beginning; a file may state the arm's ``joints`` alone in its place."""

    world_T_camera: Pose
    """the initial camera pose in the world; +Z of the world is up"""
    joints_near: Annotated[tuple[Angle, ...], Field(min_length=6, max_length=7)]
    """chooses among the inverse-kinematics branches: the nearest is taken; one number a joint [rad]"""


class Teach(Section):
    """How the goal is taught: the arm is brought there and an image is taken."""

    initial_T_goal: Pose
    """where the operator brings the camera, relative to its initial pose"""


class KnownLength(Section):
    """The distance between two dots, numbered as in the initial image (top to bottom, left to right)."""

    dots: tuple[Annotated[int, Field(ge=0), A_NUMBER], Annotated[int, Field(ge=0), A_NUMBER]]
    length: PositiveLength
    """[m]"""

    @field_validator("dots")
    @classmethod
    def _two_dots(cls, dots: tuple[int, int]) -> tuple[int, int]:
        if dots[0] == dots[1]:
            raise ValueError("the two dots must differ")
        return dots


class Scale(Section):
    """What makes the estimate metric: exactly one of the first four."""

    displacement: PositiveLength | None = None
    """distance between initial and goal camera centre [m], the paper's α"""
    known_length: KnownLength | None = None
    odometry: StrictBool = False
    """the displacement follows from the arm's joint readings at both poses"""
    tags: StrictBool = False
    """sizes and places of the target's tags are known as the task states them"""
    sigma: Annotated[Real, Field(ge=0, le=0.5)] = 0.0
    """standard deviation of the displacement or length over itself; plans with a risk count with it"""

    @model_validator(mode="after")
    def _exactly_one(self) -> Scale:
        given = (self.displacement is not None, self.known_length is not None, self.odometry, self.tags)
        if sum(given) != 1:
            raise ValueError("give exactly one of displacement, known_length, odometry: true, tags: true")
        if self.tags and self.sigma > 0.0:
            raise ValueError("sigma goes with a displacement, a known_length or odometry, not with tags")
        return self


class WorkspaceSection(Pose):
    """A box that the camera centre must not leave; how its axes stand in the initial camera frame."""

    min: Point
    max: Point

    def transformed(self, a_T_b: RigidTransform) -> WorkspaceSection:
        """Return the same, stated in frame b, in frame a."""
        pose = a_T_b * self.transform
        return self.model_copy(
            update={
                "translation": tuple(pose.translation.tolist()),
                "quaternion": tuple(pose.rotation.as_quat().tolist()),
                "rotation_vector": None,
            }
        )

    @property
    def workspace(self) -> Workspace:
        """The planner's."""
        return seen_workspace(Workspace(np.array(self.min), np.array(self.max)), self.transform)

    @model_validator(mode="after")
    def _ordered(self) -> WorkspaceSection:
        if any(a >= b for a, b in zip(self.min, self.max, strict=True)):
            raise ValueError("every coordinate of min must be smaller than that of max")
        return self


class DegreesSection(Section):
    """Highest polynomial degrees of the path."""

    rotation: Annotated[int, Field(ge=1, le=8), A_NUMBER] = 2
    translation: Annotated[int, Field(ge=1, le=8), A_NUMBER] = 2


class Planning(Section):
    """What the path must keep."""

    obstacles: tuple[ObstacleSection, ...] = ()
    """as the planner knows them"""
    clearance: NonNegativeLength = 0.0
    """camera centre to every obstacle's surface, as executed [m]"""
    tracking_margin: NonNegativeLength = 0.0
    """added to both clearances when planning, because the arm does not follow exactly [m]"""
    tracking_tube: Any = None
    """a `TrackingTube` once loaded; in the file "shipped", or the file of one that was measured on runs of
    the own arm: what the arm deviates is added to all margins, instead of a ``tracking_margin``"""
    arm_clearance: NonNegativeLength | None = 0.005
    """every link and the camera's housing to every obstacle and the floor, as executed [m]; 5 mm where the
    file says nothing; null: obstacles are there for the camera's centre alone, as points that stand for
    bodies already are"""
    visibility_margin: Annotated[Real, Field(ge=0)] = 2.0
    """[px]"""
    least_distance: PositiveLength = 0.02
    """camera centre to every target point [m]; 20 mm where the file says nothing"""
    occlusion: StrictBool = False
    workspace: WorkspaceSection | None = None
    degrees: DegreesSection = DegreesSection()
    risk: Annotated[Real, Field(ge=1e-4, le=0.5)] | None = None
    """probability that the executed path leaves any of these unmet because the estimate is uncertain: margins
    are widened for it; where absent the estimate is planned with as if it were exact"""
    looks: Annotated[int, Field(ge=0, le=MOST_LOOKS), A_NUMBER] = 2
    """how often the arm may move a little and look again, where no plan fits the risk or it starts near a
    singularity; 0: never"""

    @model_validator(mode="after")
    def _one_tracking(self) -> Planning:
        if self.tracking_tube is not None and not isinstance(self.tracking_tube, TrackingTube):
            raise ValueError('tracking_tube: "shipped" or the name of a file is needed')
        if self.tracking_tube is not None and self.tracking_margin > 0.0:
            raise ValueError("give tracking_margin or tracking_tube, not both")
        return self

    @property
    def common_obstacles(self) -> tuple[int, ...]:
        """Indices of the obstacles that ask for `clearance`, not for one of their own."""
        return tuple(i for i, section in enumerate(self.obstacles) if section.clearance is None)


class Servo(Section):
    """How the path is followed."""

    feature: Literal["bearing", "virtual-plane"] = "bearing"
    time_law: Literal["rest-to-rest", "time-optimal", "exponential"] = "rest-to-rest"
    """rest-to-rest: smooth acceleration. time-optimal: the fastest within half of the arm's joint speeds and
    accelerations. exponential: the paper's (42), whatever the limits"""
    duration: Annotated[Real, Field(gt=0, le=600)] | None = None
    """of the rest-to-rest law [s]; where absent: the shortest that keeps half of the arm's joint speeds and
    accelerations, at least 4 s"""
    image_speed: Annotated[Real, Field(gt=0, le=1e6)] | None = None
    """fastest that a followed point may move through the image, against motion blur [px/s]; by the plan"""
    rate: Annotated[Real, Field(gt=0, le=100)] = 1.0
    """λ₁ of the exponential law (42), and λ of methods without a plan [1/s]"""
    gain: Annotated[Real, Field(gt=0, le=100)] = 3.0
    """λ₂ of (43) [1/s]"""
    tolerance_px: Annotated[Real, Field(gt=0, le=10)] = 0.1
    """rms distance to the goal image at which the job is done [px]"""
    time_limit: Annotated[Real, Field(gt=0, le=3600)] = 30.0
    """[s]"""

    @model_validator(mode="after")
    def _law_takes_what_is_given(self) -> Servo:
        if self.duration is not None and self.time_law != "rest-to-rest":
            raise ValueError(f"duration goes with time_law: rest-to-rest, not with {self.time_law}")
        if self.image_speed is not None and self.time_law == "exponential":
            raise ValueError("image_speed bounds rest-to-rest and time-optimal; exponential is not stretched")
        return self


class Task(Section):
    """One whole job. Build it with `load_task`; every length is in m, every angle in rad."""

    name: Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9-]{0,63}$")]
    summary: Annotated[str, Field(max_length=200)]
    camera: Any
    """a `CentralModel` once loaded; in the file: a preset's name, a calibration file, or a camera"""
    sensor: SensorSection = SensorSection()
    arm: ArmMount
    start: StartSection
    target: TargetSection
    obstacles: tuple[FramedBlock, ...] = ()
    """the bodies that are really there, known to the planner as ``planning.obstacles`` says"""
    surroundings: tuple[FramedBlock, ...] = ()
    """the bodies that are there and that the planner knows of as they are: the arm and the camera's housing
    keep ``planning.arm_clearance`` from them; a table, a wall"""
    teach: Teach
    scale: Scale
    planning: Planning = Planning()
    servo: Servo = Servo()
    simulation: SimulationSection = SimulationSection()
    """what the simulator alone knows: how its images differ from what the program takes them for"""
    moves: tuple[Move, ...] = ()
    """what is put elsewhere while the arm moves; the path is planned again then"""
    _sources: TaskSources | None = PrivateAttr(None)

    @property
    def sources(self) -> TaskSources | None:
        """The files that it was read from; None where it was made otherwise."""
        return self._sources

    def read_from(self, sources: TaskSources) -> Task:
        """Return the same, which knows its files."""
        known = self.model_copy()
        known._sources = sources
        return known

    @model_validator(mode="after")
    def _true_camera_of_that_size(self) -> Task:
        lens = self.simulation.true_camera
        if lens is not None and (lens.width, lens.height) != (self.camera.width, self.camera.height):
            raise ValueError(
                f"simulation.true_camera: an image of {lens.width} × {lens.height} px given; legal: that of "
                f"the camera, {self.camera.width} × {self.camera.height} px"
            )
        return self

    @model_validator(mode="after")
    def _scale_of_the_target(self) -> Task:
        if self.scale.tags and self.target.tags is None:
            raise ValueError("scale.tags: true needs a target of tags")
        if self.scale.known_length is not None and not self.target.dots:
            raise ValueError("scale.known_length needs a target of dots")
        return self

    @model_validator(mode="after")
    def _moves_name_what_there_is(self) -> Task:
        for i, move in enumerate(self.moves):
            for name, there in (("bodies", self.obstacles), ("known", self.planning.obstacles)):
                worst = max(getattr(move, name))
                if worst >= len(there):
                    raise ValueError(
                        f"moves.{i}.{name}: {worst} given; there are {len(there)}, counted from 0"
                    )
        return self

    @model_validator(mode="after")
    def _stated_in_the_initial_frame(self) -> Task:
        initial_T_base = self.base_T_initial.inv()
        initial_T: dict[Frame, RigidTransform] = {
            "base": initial_T_base,
            "goal": self.teach.initial_T_goal.transform,
        }
        known = tuple(section.in_initial(initial_T) for section in self.planning.obstacles)
        for name, value in (
            ("target", self.target.in_initial(initial_T)),
            ("obstacles", tuple(block.in_initial(initial_T) for block in self.obstacles)),
            ("surroundings", tuple(block.in_initial(initial_T) for block in self.surroundings)),
            ("planning", self.planning.model_copy(update={"obstacles": known})),
        ):
            object.__setattr__(self, name, value)
        return self

    @property
    def base_T_initial(self) -> RigidTransform:
        """The initial camera in the arm's base frame, which stands upright at ``arm.foot``."""
        foot_T_world = RigidTransform.from_translation(-np.asarray(self.arm.foot))
        return composed(foot_T_world, self.start.world_T_camera.transform)

    def known_obstacles(self, time: float) -> tuple[ObstacleSection, ...]:
        """Return `planning.obstacles` as they are known at ``time`` [s] since the servo's start."""
        known = list(self.planning.obstacles)
        for move in self.moves:
            if move.time <= time:
                for i in move.known:
                    known[i] = known[i].transformed(RigidTransform.from_translation(move.by))
        return tuple(known)
