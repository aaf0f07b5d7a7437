"""Minima between the places that are looked at: what is claimed is proven for all w, not seen."""

import numpy as np
import pytest

from omniservo.planning import CameraPath, PlanningProblem, certify
from omniservo.planning.bernstein_path import ROTATION_FLOOR
from omniservo.verification import verify_plan

BLOCK = [[x, y, z] for x in (-0.9, -0.8) for y in (-0.05, 0.05) for z in (-0.05, 0.05)]
BODIES = {
    "half-space": {"type": "half_space", "normal": [1, 0, 0], "offset": -0.8},
    "moving half-space": {"type": "half_space", "normal": [1, 0, 0], "offset": -0.8, "motion": [[0, 0]] * 3},
    "sphere": {"type": "sphere", "center": [-0.9, 0, 0], "radius": 0.1},
    "capsule": {"type": "capsule", "from": [-0.9, -0.1, 0], "to": [-0.9, 0.1, 0], "radius": 0.1},
    "cylinder": {"type": "cylinder", "from": [-0.9, 0, 0], "to": [-0.8, 0, 0], "radius": 0.1},
    "ellipsoid": {
        "type": "ellipsoid",
        "center": [-0.85, 0, 0],
        "quaternion": [0, 0, 0, 1],
        "radii": [0.05, 0.1, 0.2],
    },
    "box": {
        "type": "box",
        "center": [-0.85, 0, 0],
        "quaternion": [0, 0, 0, 1],
        "half_extents": [0.05, 0.1, 0.1],
    },
    "mesh": {"type": "mesh", "vertices": BLOCK},
    "cloud": {"type": "cloud", "points": BLOCK, "radius": 0.01},
}


def dipping_path():
    """x = 4 (w − p)²(w − r)² − ε(w − p) less its start: two dips, p on a look at k/32, r between two.

    At r it is lower by 0.13 mm, but the looks next to r see it higher by as much.
    """
    w, p, r = np.polynomial.Polynomial([0.0, 1.0]), 8.0 / 32.0, 24.5 / 32.0
    x = (4.0 * (w - p) ** 2 * (w - r) ** 2 - 2.5e-4 * (w - p)).coef[::-1]
    x[-1] = 0.0
    translation = np.zeros((3, 5))
    translation[0] = x
    return CameraPath([[0.0, 0.0]] * 3 + [[0.0, 1.0]], translation)


PATH = dipping_path()
LOWEST = float(np.polyval(PATH.translation[0], np.linspace(0.7, 0.8, 200_001)).min())


def asked(**constraints):
    goal = {"translation": PATH.translation.sum(axis=1).tolist(), "quaternion": [0, 0, 0, 1]}
    camera = {
        "model": "unified", "fx": 300.0, "fy": 300.0, "cx": 500.0, "cy": 300.0, "xi": 0.0,
        "width": 1001, "height": 601,
    }  # fmt: skip
    lens = camera | constraints.pop("camera", {})
    fields = {"format": "omniservo.problem/1", "camera": lens, "points": [[0.0, 0.0, 1.0]], "goal": goal}
    degrees = {"rotation": 1, "translation": 4}
    return PlanningProblem.from_dict(fields | {"degrees": degrees, "least_distance": 0.0} | constraints)


def margin_of(problem, name, path=PATH):
    """The certified margin of one constraint, checked in exact arithmetic."""
    verdict, certificate = certify(problem, path)
    assert verdict == "certified"
    lines = [c for c in certificate.constraints if c.name.startswith(name)]
    plan = {
        "format": "omniservo.plan/1", "problem": problem.to_dict(), "status": "certified",
        "path": {"rotation": path.rotation.tolist(), "translation": path.translation.tolist()},
        "certificate": certificate.to_dict(),
    }  # fmt: skip
    answer = verify_plan(plan)
    assert answer.status == "certified", answer.reasons
    return lines[0].margin


def test_the_lowest_dip_lies_between_two_looks():
    seen = np.polyval(PATH.translation[0], np.arange(33) / 32.0)
    assert np.argmin(seen) == 8
    assert seen.min() > LOWEST + 1e-4


@pytest.mark.parametrize("body", BODIES)
def test_a_dip_that_no_look_sees_is_in_the_clearance(body):
    problem = asked(obstacles=[BODIES[body]], occlusion=True)
    truth = LOWEST + 0.8
    if body == "cloud":  # its points are corners of a block
        truth = np.hypot(truth, np.hypot(0.05, 0.05)) - 0.01
    assert truth - 1e-3 <= margin_of(problem, "clearance obstacle 0") <= truth + 1e-9
    if "half-space" not in body:  # the line of sight leads away from the body
        assert truth - 1e-3 <= margin_of(problem, "occlusion obstacle 0") <= truth + 1e-9


@pytest.mark.parametrize(
    ("constraints", "name", "truth"),
    [
        ({"workspace": {"min": [-0.8, -1, -1], "max": [1, 1, 1]}}, "workspace x min", LOWEST + 0.8),
        (
            {"workspace": {"half_spaces": [{"normal": [1, 0, 0], "offset": -0.8}]}},
            "workspace half-space 0",
            LOWEST + 0.8,
        ),
        ({"points": [[-0.3, 0.0, 1e-3], [0, 0, 1]]}, "least_distance", np.hypot(LOWEST + 0.3, 1e-3)),
        ({}, "visibility right edge", 500.5 + 300.0 * LOWEST),
        ({"camera": {"max_angle": 0.9}}, "visibility max_angle", 300.0 * (np.tan(0.9) + LOWEST)),
        (
            {"camera": {"dead_zone": {"center": [700.0, 300.0], "radius": 9.0}}},
            "dead_zone",
            191.0 + 300.0 * LOWEST,
        ),
        (
            {"camera": {"mask": [[[700.0, 200.0], [800.0, 200.0], [800.0, 400.0], [700.0, 400.0]]]}},
            "visibility mask 0",
            200.0 + 300.0 * LOWEST,
        ),
    ],
)
def test_a_dip_that_no_look_sees_is_in_every_other_margin(constraints, name, truth):
    if name == "least_distance":  # the point is beside the camera: any lens sees it
        constraints = {"camera": {"xi": 2.0, "cx": 5e4, "width": 100_000}} | constraints
    margin = margin_of(asked(**constraints), name)
    loose = 0.5 if "visib" in name or name == "dead_zone" else 1e-3
    assert truth - loose <= margin <= truth + 1e-9


def test_a_dip_that_no_look_sees_is_in_the_margin_of_the_quaternion():
    """Its length alone dips, 1 + x: nothing turns."""
    length = PATH.translation[0] + [0.0, 0.0, 0.0, 0.0, 1.0]
    path = CameraPath(np.vstack([np.zeros((3, 5)), length]), PATH.translation)
    margin = margin_of(asked(degrees={"rotation": 4, "translation": 4}), "rotation", path)
    truth = (1.0 + LOWEST) ** 2 - ROTATION_FLOOR
    assert truth - 1e-3 <= margin <= truth + 1e-9


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("axis", range(3))
def test_a_dip_that_no_look_sees_is_in_the_margin_of_every_side(axis, sign):
    """The path dips along x, y or z, one way or the other; walls are 0.8 m off on all sides."""
    translation = np.zeros((3, 5))
    translation[axis] = sign * PATH.translation[0]
    path = CameraPath(PATH.rotation, translation)
    goal = {"translation": translation.sum(axis=1).tolist(), "quaternion": [0, 0, 0, 1]}
    problem = asked(goal=goal, workspace={"min": [-0.8] * 3, "max": [0.8] * 3})
    side = "min" if sign > 0.0 else "max"
    margin = margin_of(problem, f"workspace {'xyz'[axis]} {side}", path)
    assert LOWEST + 0.8 - 1e-3 <= margin <= LOWEST + 0.8 + 1e-9
    if axis < 2:
        edge = (("right", "left"), ("bottom", "top"))[axis][int(sign < 0.0)]
        truth = (500.5, 300.5)[axis] + 300.0 * LOWEST
        assert truth - 0.5 <= margin_of(problem, f"visibility {edge} edge", path) <= truth + 1e-9
