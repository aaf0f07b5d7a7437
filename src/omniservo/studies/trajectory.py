"""The way of a scene's camera, as it truly went."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.geometry.arrays import FloatArray
from omniservo.planning import Sphere
from omniservo.studies.placed_arm import PlacedArm
from omniservo.studies.study_scene import StudyScene


@dataclass(eq=False)
class Trajectory:
    """Where the camera truly was: at every image, when its twist changed, and often between."""

    times: list[float] = field(default_factory=list)
    """[s]"""
    rotations: list[FloatArray] = field(default_factory=list)
    """(3, 3) of initial_T_camera"""
    places: list[FloatArray] = field(default_factory=list)
    """(3,) of the camera's centre in the initial camera frame [m]"""
    joints: list[FloatArray] = field(default_factory=list)
    """(n,) [rad] of the arm that carries it, likewise; none without an arm"""
    feature_lost: bool = False
    """a point left the image, or an obstacle hid it"""
    images: int = 0
    """that were taken"""

    @classmethod
    def standing(cls) -> Trajectory:
        """Return that of a camera that never moved."""
        return cls([0.0], [np.eye(3)], [np.zeros(3)])

    def note(self, time: float, rotation: FloatArray, centre: FloatArray) -> None:
        """Add where the camera is at a time [s]."""
        self.times.append(time)
        self.rotations.append(rotation)
        self.places.append(centre)

    @property
    def centres(self) -> FloatArray:
        """(k, 3) [m]."""
        return np.array(self.places)

    @property
    def end(self) -> RigidTransform:
        """The last initial_T_camera."""
        return RigidTransform.from_components(self.places[-1], Rotation.from_matrix(self.rotations[-1]))

    @property
    def length(self) -> float:
        """Of the camera's way [m]."""
        return float(np.linalg.norm(np.diff(self.centres, axis=0), axis=1).sum())

    def farthest(self, place: FloatArray) -> float:
        """Return the largest distance of the camera's centre to a place (3,) [m]."""
        return float(np.linalg.norm(self.centres - place, axis=1).max())

    def least_gap(self, scene: StudyScene) -> float | None:
        """Return the smallest distance of the camera's centre to an obstacle [m]; None: there is none."""
        if not scene.obstacles:
            return None
        centres = self.centres
        return min(_gap(centres[part], ball) for part, balls in scene.phases(self.times) for ball in balls)

    def nearness(self, placed: PlacedArm, scene: StudyScene) -> tuple[float, bool]:
        """Return how near the arm came to what stands around, and whether anything touched, see there."""
        joints = np.array(self.joints)
        found = [placed.nearness(joints[part], balls) for part, balls in scene.phases(self.times)]
        return min(least for least, _ in found), any(touch for _, touch in found)


def _gap(begin: FloatArray, ball: Sphere) -> float:
    """Return the smallest distance of a way through places (k, 3) to a ball [m]."""
    way = np.diff(begin, axis=0, append=begin[-1:])
    squared = np.maximum((way**2).sum(axis=1), 1e-30)
    along = np.clip(((ball.center - begin) * way).sum(axis=1) / squared, 0.0, 1.0)
    near = begin + along[:, None] * way
    return float(np.linalg.norm(near - ball.center, axis=1).min()) - ball.radius
