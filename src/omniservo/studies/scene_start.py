"""What all methods of a scene begin with: its two images, and what is estimated of them."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.estimation import TwoViewEstimate, estimate_two_view
from omniservo.geometry.arrays import FloatArray, IntArray
from omniservo.studies.study import Study
from omniservo.studies.study_camera import StudyCamera, StudyImage
from omniservo.studies.study_scene import NoScene, StudyScene, draw_scene, generators
from omniservo.tracking import TrackerOptions

_HERE = RigidTransform.identity()


@dataclass(frozen=True, eq=False)
class Estimated:
    """Motion and structure of the points that are found in both images."""

    estimate: TwoViewEstimate
    goal: RigidTransform
    """initial_T_goal as estimated"""
    followed: IntArray
    """(m,) the scene's points that belong: these are servoed on"""
    points: FloatArray
    """(m, 3) as estimated, in the initial camera frame [m]"""
    initial_pixels: FloatArray | None
    """(m, 2) [px]; None: the points are known, and not refined on the way"""
    goal_pixels: FloatArray
    """(m, 2) [px]"""


@dataclass(frozen=True, eq=False)
class SceneStart:
    """A scene before anything moves; nothing in it is changed by a run."""

    scene: StudyScene
    estimated: Estimated | str
    """or why there is no estimate"""
    random: np.random.Generator
    """of the images that come after the first two"""

    def camera(self) -> StudyCamera:
        """Return a camera that goes on from the first two images, alike for every method."""
        return StudyCamera(self.scene, deepcopy(self.random))


@lru_cache(maxsize=1)
def scene_start(study: Study, number: int, camera: str) -> SceneStart | NoScene:
    """Return where all methods begin in scene ``number``: rows that follow each other share it."""
    try:
        scene = draw_scene(study, number, study.cameras[camera])
    except NoScene as none:
        return none
    _, random = generators(study, number)
    return SceneStart(scene, estimate_of_scene(study, scene, StudyCamera(scene, random)), random)


def images_at_ends(scene: StudyScene, camera: StudyCamera) -> tuple[StudyImage, StudyImage]:
    """Return the images that are taken at the start and at the goal, in this order."""
    ends = _HERE, scene.initial_T_goal
    initial, goal = (camera.take(p.rotation.as_matrix(), np.array(p.translation)) for p in ends)
    return initial, goal


def estimate_of_scene(study: Study, scene: StudyScene, camera: StudyCamera) -> Estimated | str:
    """Return what the camera's images at the scene's two ends say, or why that is nothing."""
    initial, goal = images_at_ends(scene, camera)
    matched = np.flatnonzero(initial.found & goal.found)
    length = float(np.linalg.norm(scene.initial_T_goal.translation)) * (1.0 + scene.conditions.depth)
    if len(matched) < TrackerOptions().least_features:
        return f"{len(matched)} points are found in both images"
    if length <= 0.0:
        return f"the distance of the two views is stated as {length:.3g} m"
    pixels = initial.pixels[matched], goal.pixels[matched]
    estimate = estimate_two_view(scene.camera, *pixels, scale=length, scale_sigma=study.servo.depth_sigma)
    pose = estimate.initial_T_goal
    if pose is None:
        return f"{estimate.status}: {estimate.message}"
    rows = np.flatnonzero(estimate.inliers)
    followed = matched[rows]
    return Estimated(estimate, pose, followed, estimate.points[rows], *(image[rows] for image in pixels))
