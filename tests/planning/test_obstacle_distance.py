"""Distances to obstacles, against the nearest of many points on their surface."""

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from omniservo.planning import Box, Capsule, HalfSpace, Sphere

RNG = np.random.default_rng(3)
TURN = Rotation.from_rotvec([0.3, -0.5, 0.9])
BOX = Box([0.1, 0.2, 0.3], [0.05, 0.1, 0.2], TURN.as_quat())
OUTSIDE = RNG.uniform(-0.6, 0.9, (30, 3))


@pytest.mark.parametrize("point", OUTSIDE[BOX.distance(OUTSIDE) > 0.0])
def test_the_distance_to_a_box_is_that_of_its_nearest_point(point):
    def square(y):
        return float(np.sum((BOX.center + TURN.apply(y) - point) ** 2))

    nearest = minimize(square, np.zeros(3), bounds=[(-h, h) for h in BOX.half_extents], tol=1e-14)
    assert BOX.distance(point[None])[0] == pytest.approx(np.sqrt(nearest.fun), abs=1e-6)


def test_inside_a_box_the_distance_is_minus_the_depth():
    inside = BOX.center + TURN.apply([[0.0, 0.0, 0.0], [0.0, 0.09, 0.0], [0.0, 0.0, 0.19]])
    assert BOX.distance(inside) == pytest.approx([-0.05, -0.01, -0.01])


def test_the_distance_to_a_capsule_is_that_to_its_spheres():
    capsule = Capsule([0.0, 0.1, 0.2], [0.3, -0.1, 0.2], 0.04)
    along = np.linspace(capsule.start, capsule.end, 2001)
    spheres = np.linalg.norm(OUTSIDE[:, None] - along, axis=2).min(axis=1) - 0.04
    assert capsule.distance(OUTSIDE) == pytest.approx(spheres, abs=1e-6)
    assert Capsule([0.0, 0.0, 0.1], [0.0, 0.0, 0.1], 0.04).distance(np.zeros((1, 3)))[0] == pytest.approx(
        0.06
    )


def test_the_distance_to_a_sphere_and_a_half_space():
    assert Sphere([0.0, 0.0, 1.0], 0.25).distance(np.zeros((1, 3)))[0] == 0.75
    assert HalfSpace([0.0, 0.0, -1.0], -0.5).distance(np.array([[9.0, 9.0, 0.1]]))[0] == pytest.approx(0.4)
