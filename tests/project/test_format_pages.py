"""docs/formats.md lists every field that problem and plan files have."""

import re
from functools import cache
from pathlib import Path

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo import PlanningProblem, UnifiedCamera, plan_path
from omniservo.planning import Box, Capsule, Cloud, Degrees, HalfSpace, Mesh, Sphere, Workspace

PAGE = (Path(__file__).resolve().parents[2] / "docs/formats.md").read_text()
STILL = np.zeros((3, 1))


@cache
def everything():
    """A plan in which every optional field stands."""
    camera = UnifiedCamera(
        300, 300, 330, 216, 1.2, 659, 432, skew=0.1, distortion=(-0.01, 0, 0, 0), max_angle=1.5,
        dead_zone={"center": [330.0, 300.0], "radius": 5.0}, mask=[[[0, 400], [20, 400], [0, 431]]],
        deviation_px=0.1,
    )  # fmt: skip
    away = np.array([0.0, 0.0, -3.0])
    upright = [0, 0, 0, 1]
    obstacles = (
        Sphere(away, 0.1, clearance=0.2, motion=STILL),
        Box(away, [0.1, 0.1, 0.1], upright),
        Capsule(away, away + 0.1, 0.1),
        HalfSpace([0, 0, 1], -4.0),
        Mesh(away + 0.1 * np.eye(4, 3)),
        Cloud(away[None], 0.1),
    )
    goal = RigidTransform.from_components([0, 0, 0.1], Rotation.identity())
    problem = PlanningProblem(
        camera, [[0.0, 0.0, 0.6], [0.1, 0.0, 0.6]], goal,
        obstacles=obstacles, occlusion=True, degrees=Degrees(2, 2), initial_velocity=[0, 0, 0.1, 0, 0, 0],
        workspace=Workspace([-1, -1, -1], [1, 1, 1], (HalfSpace([0, 0, 1], -1.0),)),
    )  # fmt: skip
    return plan_path(problem).to_dict()


def names_in(value):
    if isinstance(value, dict):
        yield from value
        for held in value.values():
            yield from names_in(held)
    elif isinstance(value, list):
        for held in value:
            yield from names_in(held)


def test_every_field_of_a_plan_and_its_problem_is_on_the_page():
    plan = everything()
    assert plan["status"] == "certified"
    assert set(names_in(plan)) - set(re.findall(r"`(\w+)`", PAGE)) == set()


def test_every_obstacle_kind_is_on_the_page():
    kinds = {obstacle["type"] for obstacle in everything()["problem"]["obstacles"]}
    assert kinds <= set(re.findall(r"(?m)^\| `(\w+)` \|", PAGE))
