"""What is proven of what moves or is far away allows for rounding: no claim is above the exact truth."""

from fractions import Fraction

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from omniservo.cameras import preset
from omniservo.geometry.polynomial import bernstein_from_power, magnitude
from omniservo.geometry.subdivision import PROVEN
from omniservo.planning import Capsule, PlanningProblem
from omniservo.planning.bernstein_path import squares
from omniservo.planning.body_arrays import bodies_of, hulls_of
from omniservo.planning.constraints.cloud import prove_off_cloud
from omniservo.planning.constraints.collision import prove_outside_ball
from omniservo.planning.constraints.free_side import prove_free_side
from omniservo.planning.constraints.motion import point_from_body, seen_from_body
from omniservo.planning.constraints.occlusion import prove_clear_sights
from omniservo.planning.constraints.separation import separate
from omniservo.planning.constraints.workspace import prove_wall
from omniservo.planning.obstacles.ball_tree import ball_tree

LARGE = 1e6


def cases(count):
    """t and m of 10⁶ m whose difference is about 1 m, and a plane whose least gap is at the path's end."""
    rng = np.random.default_rng(12)
    for _ in range(count):
        motion = np.zeros((1, 3, 3))
        motion[0] = rng.uniform(-LARGE, LARGE, (3, 3))
        translation = motion[0] + rng.uniform(-1.0, 1.0, (3, 3))
        translation[:, 2] = 0.0  # at the origin where the path begins
        motion[0, :, 2] = rng.uniform(-1.0, 1.0, 3)
        normal = rng.normal(size=3)
        normal /= np.linalg.norm(normal)
        yield translation, motion, normal


def exact_gap(translation, motion, normal):
    """n·(t − m) at w = 1."""
    ends = [sum(map(Fraction, row.tolist())) for row in translation - 0.0]
    moved = [sum(map(Fraction, row.tolist())) for row in motion]
    return sum(Fraction(float(n)) * (t - m) for n, t, m in zip(normal, ends, moved, strict=True))


def test_no_half_space_is_proven_by_an_ulp_more_than_the_truth():
    proven = 0
    for translation, motion, normal in cases(300):
        truth = exact_gap(translation, motion[0], normal)
        centre, size = bernstein_from_power(translation), magnitude(translation)
        path, largest = seen_from_body(centre, translation, size, motion, 0.0)
        plane = np.array([*normal, 0.0, 0.0, 0.0])
        above = np.nextafter(float(truth), np.inf)
        while Fraction(float(above)) <= truth:
            above = np.nextafter(above, np.inf)
        assert prove_free_side(path, largest, plane, float(above))[0] != PROVEN
        proven += prove_free_side(path, largest, plane, float(truth) - 1e-3)[0] == PROVEN
    assert proven > 20, "and where a millimetre is left it often is proven: the gap may be least elsewhere"


def test_no_half_space_far_from_the_origin_is_proven_by_an_ulp_more_than_the_truth():
    """A way of 10⁶ m within 10⁻⁶ of along the plane: what is left is what the products of n·t cancel to."""
    rng, proven = np.random.default_rng(13), 0
    for _ in range(300):
        way, normal = LARGE * rng.normal(size=(2, 3)) / 3.0
        normal -= way * (normal @ way) / (way @ way)
        normal = normal / np.linalg.norm(normal) - 1e-6 * rng.random() * way / np.linalg.norm(way)
        translation = np.column_stack([way, np.zeros(3)])
        truth = sum(Fraction(float(n)) * Fraction(float(t)) for n, t in zip(normal, way, strict=True))
        above = np.nextafter(float(truth), np.inf)
        path, size = bernstein_from_power(translation), magnitude(translation)
        for margin, stands in ((above, False), (float(truth) - 1e-7, True)):
            found = prove_free_side(path, size, np.array([*normal, margin, 0.0, -1.0]), 0.0)[0]
            assert stands or found != PROVEN
            proven += found == PROVEN
    assert proven == 300


def test_no_wall_far_from_the_origin_is_proven_by_an_ulp_more_than_the_truth():
    """A way of 10⁵ m out and back to a millimetre behind its start, where it comes nearest to the wall."""
    rng, proven = np.random.default_rng(14), 0
    for _ in range(300):
        size, bend = LARGE * rng.uniform(0.5, 1.0), rng.uniform(-0.5, 2.0)
        powers = np.array([[-size * bend, size * (bend - 1.0), size - 1e-3, 0.0]] * 3)
        truth = sum(map(Fraction, powers[0].tolist()))
        controls, size = bernstein_from_power(powers), magnitude(powers)
        for bound, stands in ((np.nextafter(float(truth), np.inf), False), (float(truth) - 1e-7, True)):
            found = prove_wall(controls, size, 0, 0, bound)[0]
            assert stands or found != PROVEN
            proven += found == PROVEN
    assert proven == 300


def far_ends(count):
    """Paths that come straight towards a place 10⁵ m away as they end a metre before it, and just more."""
    rng = np.random.default_rng(15)
    for _ in range(count):
        powers = np.column_stack([rng.uniform(-1e5, 1e5, (3, 2)), np.zeros(3)])
        ahead = 2.0 * powers[:, 0] + powers[:, 1]
        ahead /= np.linalg.norm(ahead)
        place = powers.sum(axis=1) + ahead
        ends = (sum(map(Fraction, row.tolist())) for row in powers)
        squared = sum((t - Fraction(float(o))) ** 2 for t, o in zip(ends, place, strict=True))
        more = float(squared) ** 0.5
        while Fraction(more) ** 2 <= squared:
            more = float(np.nextafter(more, np.inf))
        yield powers, ahead, place, more


def proofs_of_reach(powers, ahead, place):
    """What decides whether a path stays so far from a place: a ball, a cloud, a rod, a ball by a sight."""
    square, raised = squares(powers)
    centre, size, behind = bernstein_from_power(powers), magnitude(powers), (place - 2e5 * ahead)[None]
    asked = PlanningProblem(
        preset("fe185"), behind, RigidTransform.identity(), (Capsule(place, place + ahead, 0.1),)
    )
    rod, hulls, tree = bodies_of(asked)[0], hulls_of(asked), ball_tree(place[None])
    nothing, planes = np.empty((3, 0)), np.empty((0, 5))
    yield lambda reach: prove_outside_ball(square, raised, size, place, reach)
    yield lambda reach: prove_off_cloud(square, raised, size, *tree, reach)
    yield lambda reach: separate(centre, size, nothing, rod, hulls, reach, planes)
    yield lambda reach: prove_clear_sights(centre, size, behind, place, reach)


def test_no_distance_far_from_the_origin_is_proven_by_an_ulp_more_than_the_truth():
    for powers, ahead, place, more in far_ends(100):
        for proof in proofs_of_reach(powers, ahead, place):
            assert proof(more)[0] != PROVEN
            assert proof(0.9 * more)[0] == PROVEN


@pytest.mark.parametrize("index", [0.0, -1.0])
def test_the_magnitude_covers_the_rounding_of_all_control_points(index):
    unit = 2.0**-53
    for translation, motion, _ in cases(100):
        centre, size = bernstein_from_power(translation), magnitude(translation)
        path, largest = seen_from_body(centre, translation, size, motion, index)
        h = np.array([1 / 3, -0.7, 0.9])
        target = point_from_body(h, motion, index)
        for c in range(3):
            moved = motion[0, c] if index >= 0.0 else np.zeros(3)
            for controls, powers in ((path, translation[c]), (target, [0.0, 0.0, h[c]])):
                exact = [Fraction(float(a)) - Fraction(float(b)) for a, b in zip(powers, moved, strict=True)]
                quadratic = exact[2], exact[2] + exact[1] / 2, sum(exact)
                if controls.shape[1] == 1:
                    quadratic = (exact[2],)
                for found, truth in zip(controls[c], quadratic, strict=True):
                    off = abs(Fraction(float(found)) - truth)
                    assert off <= (2 + 3) * unit * (largest + abs(h[c]))
