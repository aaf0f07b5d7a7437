"""Plans without a planner and a camera that moves exactly as told: the reference of the tracking tests."""

from __future__ import annotations

from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.cameras import UnifiedCamera
from omniservo.errors import InputError

FISHEYE = UnifiedCamera(296.9365, 298.4197, 316.8076, 254.9012, 1.291, 659, 432, max_angle=np.radians(92.5))
WIDE = UnifiedCamera(296.9365, 298.4197, 316.8076, 254.9012, 1.291, 659, 432)
"""The same lens model with nothing but its own domain, to 140° from the axis."""
PERSPECTIVE = UnifiedCamera(420.0, 420.0, 319.5, 239.5, 0.0, 640, 480)
PARABOLIC = UnifiedCamera(180.0, -180.0, 319.5, 239.5, 1.0, 640, 480)
HYPERBOLIC = UnifiedCamera(200.0, 205.0, 319.5, 239.5, 0.9, 640, 480, skew=0.3)

FRONT = np.array(
    [
        [0.08 * i, 0.06 * k - 0.08, 0.4 - 0.07 * abs(i) + 0.004 * (-1) ** (i + k)]
        for k in (-1, 0, 1)
        for i in (-1, 0, 1)
    ]
)
"""The paper's target: two boards that meet at a ridge."""


def ring(angles_deg):
    """Points all round the camera at the given angles from the optical axis."""
    turns = np.linspace(0.0, 2 * np.pi, len(angles_deg), endpoint=False)
    angles = np.radians(angles_deg)
    directions = np.column_stack(
        (np.sin(angles) * np.cos(turns), np.sin(angles) * np.sin(turns), np.cos(angles))
    )
    return directions * np.linspace(0.6, 0.9, len(angles))[:, None]


@dataclass
class Path:
    """(23) evaluated by NumPy's polynomials, with derivatives by differences."""

    rotation: np.ndarray
    translation: np.ndarray

    @property
    def powers(self):
        return np.array(self.rotation, order="C"), np.array(self.translation, order="C")

    def __call__(self, w):
        quaternion = np.stack([np.polyval(row, w) for row in self.rotation], axis=-1)
        position = np.stack([np.polyval(row, w) for row in self.translation], axis=-1)
        return RigidTransform.from_components(position, Rotation.from_quat(quaternion))

    def twist(self, w):
        """Camera-frame twist per unit w by central differences."""
        step = 1e-5
        between = (self(w - step).inv() * self(w + step)).as_exp_coords() / (2 * step)
        return np.concatenate((between[3:], between[:3]))


def bent_path(translation=(5e-5, -0.1, 0.2), rotation_vector=(0.1, -0.2, 0.15), bend=(0.05, 0.06, 0.01)):
    """Degree 2 in rotation and translation, from the identity to the given pose."""
    quaternion = Rotation.from_rotvec(rotation_vector).as_quat()
    quadratic = np.array([0.05, 0.03, -0.02, 0.1])
    start = np.array([0.0, 0.0, 0.0, 1.0])
    rotation = np.column_stack((quadratic, quaternion - start - quadratic, start))
    shift = np.asarray(bend)
    return Path(rotation, np.column_stack((shift, np.asarray(translation) - shift, np.zeros(3))))


def plan_of(points=FRONT, path=None):
    """What the tracker reads of a plan."""
    return SimpleNamespace(
        path=bent_path() if path is None else path,
        problem=SimpleNamespace(points=np.asarray(points)),
        status="certified",
    )


@dataclass
class Loop:
    """A camera that is moved by the twists, looking at the true points."""

    camera: UnifiedCamera
    points: np.ndarray = field(default_factory=lambda: FRONT)
    pose: RigidTransform = field(default_factory=RigidTransform.identity)
    noise: float = 0.0
    delay: int = 0
    """control periods between exposure and the twist's effect"""
    period: float = 0.01
    """[s]"""
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(7))
    positions: list = field(default_factory=list)
    deviations: list = field(default_factory=list)
    errors: list = field(default_factory=list)
    twists: list = field(default_factory=list)

    def look(self):
        pixels, valid = self.camera.project(self.pose.inv().apply(self.points))
        if not valid.all():
            raise InputError("the test's scene leaves the camera's domain")
        return pixels + self.noise * self.rng.standard_normal(pixels.shape)

    def run(self, tracker, path, seconds, lost=None, start=0.0):
        """Servo; ``lost(step)`` gives the mask of valid points."""
        progress = []
        for k in range(round(seconds / self.period)):
            time = start + k * self.period
            pixels = self.look()
            valid = None if lost is None else lost(k)
            if valid is not None:
                pixels[~valid] = np.nan
            self.twists.append(tracker.step(time, pixels, valid))
            twist = self.twists[-1 - self.delay] if k >= self.delay else np.zeros(6)
            self.pose = self.pose * RigidTransform.from_exp_coords(
                np.concatenate((twist[3:], twist[:3])) * self.period
            )
            self.positions.append(self.pose.translation)
            progress.append(tracker.time_law(time + self.period)[0])
            self.errors.append(tracker.report.error_px)
            if tracker.done:
                break
        off = np.array(self.positions[-len(progress) :]) - path(np.array(progress)).translation
        self.deviations += np.linalg.norm(off, axis=1).tolist()
        return tracker.report
