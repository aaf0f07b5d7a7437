"""Random tasks for a whole arm: a target before the camera, a goal view from elsewhere, obstacles between."""

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.cameras import preset
from omniservo.errors import InputError
from omniservo.planning import Degrees, PlanningProblem, Sphere
from omniservo.robots import CAMERA_HOUSING, load_arm
from omniservo.whole_arm import ArmSetting, plan_with_arm

FLANGE_T_CAMERA = RigidTransform.from_components(
    [0.0, 0.0, 0.0905], Rotation.from_euler("z", 90, degrees=True)
)
"""The housing's back lies on the flange."""


def random_task(arm, random, *, obstacles=(1, 4), degree=2, clearance=0.01, points=9, spread=0.09, depth=0.5):
    """A problem that `plan_path` can be given, and the arm standing at its start; the goal is within reach.

    Nine points (or so many) 0.35 to 0.6 m before the camera; the goal looks at them from up to 40 degrees
    aside, turned about the view by up to 70, from 0.25 to 0.6 m; balls of 2 to 5 cm about the middle of the
    way.
    """
    low, high = np.maximum(arm.joint_range[:, 0] + 0.1, -2.2), np.minimum(arm.joint_range[:, 1] - 0.1, 2.2)
    while True:
        q = random.uniform(low, high)
        base_T_initial = arm.base_T_flange(q) * FLANGE_T_CAMERA
        if base_T_initial.translation[2] < 0.15:
            continue
        middle = np.array([0.0, 0.0, random.uniform(0.35, 0.6)])
        target = middle + random.uniform(-spread, spread, (points, 3)) * [1.0, 1.0, depth]
        goal = _view(target.mean(axis=0), random)
        try:
            arm.inverse(base_T_initial * goal * FLANGE_T_CAMERA.inv())
        except InputError:
            continue
        middle = goal.translation * random.uniform(0.3, 0.7)
        problem = PlanningProblem(
            camera=preset("fe185"),
            points=target,
            initial_T_goal=goal,
            obstacles=tuple(
                Sphere(middle + random.normal(size=3) * 0.12, random.uniform(0.02, 0.05))
                for _ in range(random.integers(*obstacles))
            ),
            clearance=0.02,
            degrees=Degrees(degree, degree),
        )
        setting = ArmSetting(
            arm, base_T_initial, FLANGE_T_CAMERA, start=q, mounted=CAMERA_HOUSING, clearance=clearance
        )
        return problem, setting


def led_tasks():
    """Tasks of a Panda that ends where it is stretched or in the way unless it is led; with what is found."""
    for seed in (1, 70, 98, 101):
        problem, setting = random_task(load_arm("panda"), np.random.default_rng([2026, seed]))
        found = plan_with_arm(problem, setting)
        if found.plan.aim is not None:
            yield problem, setting, found


def _view(center, random):
    aside = Rotation.from_rotvec(random.normal(size=3) * random.uniform(0.2, 0.7))
    turned = aside * Rotation.from_euler("z", random.uniform(-1.2, 1.2))
    place = center - turned.apply([0.0, 0.0, random.uniform(0.25, 0.6)]) + random.normal(size=3) * 0.02
    return RigidTransform.from_components(place, turned)
