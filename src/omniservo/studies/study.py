"""A study: many closed loops over stated distributions, as its file says."""

from __future__ import annotations

import hashlib
import json
from functools import cached_property
from typing import Annotated

from pydantic import BeforeValidator, Field, PlainSerializer, ValidationInfo, field_validator

from omniservo.cameras.models import CentralModel, camera_from_dict
from omniservo.run_methods import METHODS, run_method
from omniservo.studies.distribution import (
    Angles,
    Distribution,
    Lengths,
    NonNegative,
    Number,
    Share,
    constant,
    whole,
)
from omniservo.studies.study_arms import StudyArms, legal_name
from omniservo.tasks.quantities import A_NUMBER, Angle, NonNegativeLength, PositiveLength, Real
from omniservo.tasks.section import Section

FORMAT = "omniservo.study/1"

MOST_ROWS = 10_000_000

Camera = Annotated[
    CentralModel,
    BeforeValidator(lambda given: camera_from_dict(given) if isinstance(given, dict) else given),
    PlainSerializer(lambda camera: camera.to_dict()),
]


class StudyTarget(Section):
    """Points in a cube, seen from every side; nothing but obstacles hides them."""

    points: whole(4, 500) = constant(20)  # type: ignore[valid-type]
    """how many"""
    size: Lengths = constant(0.3)
    """edge of the cube [m]"""
    distance: Lengths = Distribution("uniform", (0.4, 0.7))
    """from the goal camera to the cube's middle [m]"""
    off_axis: Angles = Distribution("uniform", (0.0, 0.35))
    """between the goal camera's axis and the cube's middle [rad]"""
    view_share: Share | None = None
    """in place of ``off_axis``: as a part of the largest angle at which the whole cube is in the image"""


class StudyStart(Section):
    """Where the camera starts, seen from the goal."""

    rotation: Angles = Distribution("uniform", (0.0, 1.0))
    """of the whole turn from start to goal [rad], about any axis, as likely in every direction"""
    distance_ratio: NonNegative = Distribution("uniform", (0.8, 1.5))
    """distance to the cube's middle over that of the goal camera"""
    off_axis: Angles = Distribution("uniform", (0.0, 0.35))
    """between the camera's axis and the cube's middle [rad]"""
    view_share: Share | None = None
    """in place of ``off_axis``, likewise"""


class StudyObstacles(Section):
    """Balls near the straight line from start to goal, clear of both ends and of the target."""

    count: whole(0, 50) = constant(0)  # type: ignore[valid-type]
    """how many are tried; a scene whose ends are too near to it has fewer"""
    radius: Lengths = constant(0.03)
    """[m]"""
    aside: Annotated[Real, Field(ge=0, le=1)] = 0.1
    """standard deviation along each axis of a ball's middle from the line, over the line's length"""
    clearance: NonNegativeLength = 0.03
    """the camera's own radius [m]: nearer to a surface than this, its centre collides"""
    moved: Share = constant(0.0)
    """chance that one ball is put elsewhere near the line's second half, while the camera is on its way"""
    moved_at: NonNegative = Distribution("uniform", (0.5, 1.5))
    """when that is [s]; a method that plans again is given where the ball is, from then on"""


class StudyImages(Section):
    """What an image shows of the points, and when it arrives."""

    noise: NonNegative = constant(0.3)
    """standard deviation of each pixel coordinate [px]"""
    lost: Share = constant(0.0)
    """chance that a point is not found in an image"""
    wrong: Share = constant(0.0)
    """chance that a point is found where another point of the target is"""
    rate: Annotated[Real, Field(ge=1, le=1000)] = 30.0
    """images per second [Hz]"""
    latency: NonNegative = constant(0.02)
    """from exposure to arrival [s]"""
    jitter: NonNegative = constant(0.0)
    """most that an image is later than that, evenly distributed [s]"""
    dropped: Share = constant(0.0)
    """chance that an image never arrives"""
    delayed: Share = constant(0.0)
    """chance that an image arrives later by ``delay``"""
    delay: NonNegative = constant(0.2)
    """[s]"""


class StudyErrors(Section):
    """What the methods are given wrongly; none of it is stated to them."""

    model: NonNegative = constant(0.0)
    """of the camera model: standard deviation of a smooth field over the image [px]"""
    focal: Number = constant(0.0)
    """of the calibrated focal length, as a part of it"""
    centre: Number = constant(0.0)
    """of the calibrated principal point, along each axis [px]"""
    depth: Number = constant(0.0)
    """of the stated distance of the two camera centres, and with it of all depths, as a part of it"""
    mount_translation: Lengths = constant(0.0)
    """of the camera on an arm's flange, in any direction [m]"""
    mount_rotation: Angles = constant(0.0)
    """likewise, about any axis [rad]"""


class StudyServo(Section):
    """How the methods are run."""

    gain: Annotated[Real, Field(gt=0, le=100)] = 1.0
    """λ of the methods without a plan [1/s]"""
    tolerance_px: Annotated[Real, Field(gt=0, le=100)] = 0.2
    """rms distance to the goal image at which the goal counts as reached, beyond the estimate's noise [px]"""
    linear_speed: PositiveLength = 0.5
    """most [m/s]; a larger twist is scaled down"""
    angular_speed: Annotated[Angle, Field(gt=0)] = 1.5
    """most [rad/s]; likewise"""
    clearance_margin: NonNegativeLength = 0.005
    """what planning keeps beyond the clearance, and an arm's links to everything around [m]"""
    visibility_margin: Annotated[Real, Field(ge=0)] = 5.0
    """what planning keeps to the image's limits [px]"""
    risk: Annotated[Real, Field(ge=1e-4, le=0.5)] | None = None
    """certified plans violate clearance, visibility or occlusion with at most this probability, because the
    estimate is uncertain (`plan_with_risk`); where no path keeps that, and where None is given, the estimate
    is taken as exact"""
    depth_sigma: Annotated[Real, Field(ge=0, le=0.5)] = 0.0
    """standard deviation of ``errors.depth`` as it is stated; a plan at a stated risk counts with it"""


class StudyLimits(Section):
    """What counts as success."""

    translation: PositiveLength = 0.01
    """largest final distance to the goal [m]"""
    rotation: Annotated[Angle, Field(gt=0)] = 0.0175
    """largest final angle to the goal [rad]"""
    seconds: Annotated[Real, Field(gt=0, le=600)] = 15.0
    """most time that a run takes [s]"""


class Study(Section):
    """Rows = scenes × cameras × methods; see `omniservo.studies.load_study`."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9._-]{1,80}$")]
    seed: Annotated[int, Field(ge=0, lt=2**63), A_NUMBER] = 0
    """of all draws"""
    scenes: Annotated[int, Field(ge=1, le=MOST_ROWS), A_NUMBER]
    """drawn for each camera; all methods meet the same"""
    cameras: Annotated[dict[str, Camera], Field(min_length=1, max_length=50)]
    """by the names that rows have"""
    methods: Annotated[tuple[str, ...], Field(min_length=1, max_length=50)]
    arms: StudyArms = StudyArms()
    """what carries the camera, drawn for each scene"""
    target: StudyTarget = StudyTarget()
    start: StudyStart = StudyStart()
    obstacles: StudyObstacles = StudyObstacles()
    images: StudyImages = StudyImages()
    errors: StudyErrors = StudyErrors()
    servo: StudyServo = StudyServo()
    limits: StudyLimits = StudyLimits()

    @field_validator("cameras")
    @classmethod
    def _named(cls, cameras: dict[str, CentralModel]) -> dict[str, CentralModel]:
        for name in cameras:
            legal_name(name)
        return cameras

    @field_validator("methods")
    @classmethod
    def _known(cls, names: tuple[str, ...], info: ValidationInfo) -> tuple[str, ...]:
        for name in set(names).difference((info.context or {}).get("own", ())):
            if run_method(name).source is not None:
                raise ValueError(f"a study file names methods of the package alone: {', '.join(METHODS)}")
        if len(set(names)) != len(names):
            raise ValueError("a method is given twice")
        return names

    @property
    def rows(self) -> int:
        """How many closed loops there are."""
        return self.scenes * len(self.cameras) * len(self.methods)

    def place(self, row: int) -> tuple[int, str, str]:
        """Return a row's scene, camera and method. The method changes fastest, then the camera."""
        cell, method = divmod(row, len(self.methods))
        return cell, list(self.cameras)[cell % len(self.cameras)], self.methods[method]

    @cached_property
    def hash(self) -> str:
        """16 hexadecimal digits of all that the file says, its cameras included."""
        return hashlib.sha256(self.to_json().encode()).hexdigest()[:16]

    def __hash__(self) -> int:
        return hash(self.hash)

    def to_json(self) -> str:
        """Return the study complete by itself: cameras in it, lengths in m, angles in rad."""
        return json.dumps({"format": FORMAT, **self.model_dump(mode="json")})
