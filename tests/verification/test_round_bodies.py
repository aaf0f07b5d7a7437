"""The verifier's cylinders and ellipsoids against NumPy: distances of both signs, and supports."""

from fractions import Fraction

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from omniservo.planning import Cylinder as PlannedCylinder
from omniservo.planning import Ellipsoid as PlannedEllipsoid
from omniservo.verification.bodies import axes_of
from omniservo.verification.round_bodies import Cylinder, Ellipsoid

NOTHING = Fraction(0)


def exact(values):
    return tuple(Fraction(float(v)) for v in values)


def pairs():
    """The verifier's body and the planner's, of sizes from 1 mm to 1 m, anywhere."""
    for seed in range(30):
        random = np.random.default_rng(seed)
        sizes, center = 10.0 ** random.uniform(-3, 0, 3), random.uniform(-1, 1, 3)
        turn = Rotation.random(rng=random)
        half = turn.apply([0.0, 0.0, sizes[0]])
        start, end = center - half, center + half
        yield (
            Cylinder(exact(start), exact(end), Fraction(float(sizes[1])), NOTHING),
            PlannedCylinder(start, end, sizes[1]),
            random,
        )
        quaternion = turn.as_quat()
        yield (
            Ellipsoid(exact(center), axes_of(exact(quaternion)), exact(sizes), NOTHING),
            PlannedEllipsoid(center, sizes, quaternion),
            random,
        )


def places(body, random):
    """Points inside, near and far: beside and beyond the ends."""
    core = body.core
    factors = [*random.uniform(-1.0, 1.0, (12, 3)), *random.uniform(-3.0, 3.0, (12, 3))]
    return [core.center + (factor * core.half_extents) @ core.axes for factor in factors]


def test_what_is_nearer_than_a_distance_is_decided_from_both_sides():
    inside = outside = 0
    for body, planned, random in pairs():
        for x in places(planned, random):
            distance = float(planned.distance(x[None])[0])
            little = 1e-9 * (1.0 + abs(distance))
            assert body.nearer(exact(x), Fraction(distance + little))
            assert not body.nearer(exact(x), Fraction(distance - little))
            for deeper in (1e-9, 1e-4, 0.01, 1.0):
                assert not body.nearer(exact(x), Fraction(min(distance, 0.0) - deeper))
            inside, outside = inside + (distance < 0.0), outside + (distance > 0.0)
    assert min(inside, outside) > 200


def test_the_hint_is_the_signed_distance_and_its_direction():
    for body, planned, random in pairs():
        for x in places(planned, random):
            found, direction = body.from_core(x.tolist())
            distance = float(planned.distance(x[None])[0])
            assert found == pytest.approx(distance, abs=1e-9)
            ahead = x + 1e-6 * np.array(direction) / np.linalg.norm(direction)
            assert float(planned.distance(ahead[None])[0]) > distance


def test_no_point_of_the_surface_is_beyond_the_support_and_one_nearly_reaches_it():
    for body, planned, random in pairs():
        surface = planned.core.outline()[0]
        n = random.normal(size=3)
        support, most = float(body.support(exact(n))), float((surface @ n).max())
        assert support >= most - 1e-12
        assert support - most < 0.01 * np.linalg.norm(n) * np.linalg.norm(planned.core.half_extents)


@pytest.mark.parametrize("kind", [0, 1])
def test_the_nearest_part_of_a_segment_is_the_one_that_is_nearest(kind):
    for body, planned, random in list(pairs())[kind::2]:
        start, end = random.uniform(-1.5, 1.5, (2, 3))
        share = body.share_of(start.tolist(), end.tolist())
        best = planned.distance(start + np.linspace(0, 1, 2001)[:, None] * (end - start)).min()
        assert float(planned.distance((start + share * (end - start))[None])[0]) <= best + 1e-6
