"""An RX60 before a target of 20 points, as it stands and near a singularity, with an uncertain estimate."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.cameras import preset
from omniservo.estimation import estimate_two_view
from omniservo.estimation.arm_views import ArmViews, KnownErrors, LengthPrior
from omniservo.estimation.estimate_arm_views import estimate_arm_views
from omniservo.looks import ViewingState
from omniservo.planning import PlanningProblem, Sphere
from omniservo.robots import CAMERA_HOUSING, load_arm, shipped_tube
from omniservo.whole_arm import ArmSetting

FLANGE_T_CAMERA = RigidTransform.from_components(
    [0.0, 0.0, 0.0905], Rotation.from_euler("z", 90, degrees=True)
)
START = np.radians([10.0, 20.0, 110.0, 5.0, 50.0, 0.0])
SINGULAR = np.radians([10.0, 20.0, 110.0, 5.0, 3.0, 0.0])
"""axes 4 and 6 are all but parallel"""

MOUNT = np.diag(np.square(np.repeat([2e-3, np.radians(0.2)], 3)) / 3.0)
GOAL = RigidTransform.from_components([0.12, 0.03, 0.08], Rotation.from_rotvec([0.1, -0.25, 0.2]))


@pytest.fixture(scope="session")
def arm():
    return load_arm("rx60")


@pytest.fixture(scope="session")
def tube():
    return shipped_tube("rx60").at(0.005)


@pytest.fixture
def standing(arm):
    """Make where the arm stands: its start, obstacles, pixel noise, tube, number of points."""

    def make(start=START, obstacles=(), noise=0.5, tube=None, clearance=0.01, count=20):
        random, camera = np.random.default_rng(4), preset("fe185")
        points = np.array([0.0, 0.0, 0.45]) + random.uniform(-0.12, 0.12, (count, 3)) * [1.0, 1.0, 0.6]
        pixels = [
            camera.project(pose.inv().apply(points))[0] + noise * random.standard_normal((count, 2))
            for pose in (RigidTransform.identity(), GOAL)
        ]
        length = float(np.linalg.norm(GOAL.translation))
        known = KnownErrors(MOUNT, None, LengthPrior(length, 0.02))
        views = ArmViews(
            camera, np.array(pixels), np.ones((2, count), dtype=bool), np.full((2, count), noise),
            (RigidTransform.identity(), None), known,
        )  # fmt: skip
        first = estimate_two_view(camera, *pixels, scale=length, scale_sigma=0.02, noise=noise)
        estimate, optimum = estimate_arm_views(views, first)
        balls = tuple(Sphere(np.array(centre), radius) for centre, radius in obstacles)
        asked = PlanningProblem(
            camera, points, GOAL, obstacles=balls, clearance=0.02, least_distance=0.05, visibility_margin=2.0
        )
        setting = ArmSetting(
            arm, arm.base_T_flange(start) * FLANGE_T_CAMERA, FLANGE_T_CAMERA, start=start,
            mounted=CAMERA_HOUSING, clearance=clearance,
        )  # fmt: skip
        return replace(ViewingState(asked, setting, tube, estimate, optimum, MOUNT))

    return make
