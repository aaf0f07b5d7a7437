"""Cylinders and ellipsoids: distances against SciPy's constrained minimum, plans against dense sampling."""

from functools import cache

import mpmath
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.planning.solids import asked, displaced, margins_of, sight_distance, true_clearance

from omniservo.errors import InputError
from omniservo.planning import Box, Cylinder, Ellipsoid, plan_path
from omniservo.planning.body_arrays import bodies_of, hulls_of
from omniservo.planning.constraints.round_gap import _SAFE_SIDE, ellipsoid_distance
from omniservo.planning.constraints.solid_gap import core_support, hull_of, solid_gap
from omniservo.verification import verify_plan

TURN = Rotation.from_rotvec([0.4, -0.7, 0.2])


def random_body(random):
    """A cylinder or an ellipsoid of sizes from 1 mm to 1 m, anywhere."""
    sizes = 10.0 ** random.uniform(-3, 0, 3)
    center, turn = random.uniform(-1, 1, 3), Rotation.random(random_state=random)
    if random.uniform() < 0.5:
        half = turn.apply([0.0, 0.0, sizes[0]])
        return Cylinder(center - half, center + half, sizes[1])
    return Ellipsoid(center, sizes, turn.as_quat())


def gap(body, t, h):
    problem = asked(body)
    row = bodies_of(problem)[0]
    return solid_gap(row, hull_of(row, hulls_of(problem)), *t, *h)


def own_frame(body, x):
    """x in units in which the body is the unit cylinder or ball."""
    if isinstance(body, Cylinder):
        axis = body.end - body.start
        half, middle = 0.5 * np.linalg.norm(axis), 0.5 * (body.start + body.end)
        along = (x - middle) @ axis / np.linalg.norm(axis)
        off = x - middle - along[..., None] * axis / np.linalg.norm(axis)
        return np.abs(along) / half, np.linalg.norm(off, axis=-1) / body.radius
    return (
        np.linalg.norm(
            Rotation.from_quat(body.quaternion).inv().apply(x - body.center) / body.radii, axis=-1
        ),
    )


def is_inside(body, x):
    return np.max(own_frame(body, x), axis=0) <= 1.0


@pytest.mark.parametrize("seed", range(40))
def test_the_distance_of_a_segment_is_scipys_least_one(seed):
    random = np.random.default_rng(seed)
    body = random_body(random)
    t, h = random.uniform(-1.5, 1.5, (2, 3))
    *n, found, s = gap(body, t, h)
    inside = is_inside(body, t + np.linspace(0, 1, 4001)[:, None] * (h - t))
    if inside.any():
        assert found < 0.0
        return
    assert found == pytest.approx(sight_distance(body, t, h), abs=2e-7)
    near = t + s * (h - t)
    assert np.linalg.norm(n) == pytest.approx(1.0, abs=1e-12)
    problem = asked(body)
    row = bodies_of(problem)[0]
    beyond = min(np.dot(n, t - row[:3]), np.dot(n, h - row[:3])) - core_support(row, hulls_of(problem), *n)
    assert found - 1e-6 <= beyond <= found + 1e-12
    assert body.distance(near[None])[0] == pytest.approx(found, abs=1e-9)


def exact_distance(radii, p):
    """Distance of a point outside an ellipsoid in its own axes: the root by 60 digits and 220 halvings."""
    with mpmath.workdps(60):
        radii, p = [mpmath.mpf(float(r)) for r in radii], [mpmath.mpf(float(x)) for x in p]
        low, high = mpmath.mpf(0), mpmath.sqrt(sum((r * x) ** 2 for r, x in zip(radii, p, strict=True))) + 1
        for _ in range(220):
            t = (low + high) / 2
            beyond = sum((r * x / (t + r**2)) ** 2 for r, x in zip(radii, p, strict=True)) > 1
            low, high = (t, high) if beyond else (low, t)
        return mpmath.sqrt(sum((x - r**2 * x / (low + r**2)) ** 2 for r, x in zip(radii, p, strict=True)))


@pytest.mark.slow
def test_the_stated_distance_is_never_less_than_the_exact_one_however_flat_the_ellipsoid():
    """Radii from 1e-9 to 1e6 m, points from 1e-15 of them outside to 1000 km away."""
    random, outside = np.random.default_rng(0), 0
    for i in range(200):
        radii = 10.0 ** random.uniform(-9, 6, 3)
        on = random.normal(size=3)
        on *= radii / np.linalg.norm(on)
        p = (
            on * (1 + 10.0 ** random.uniform(-15, -3))
            if i % 2
            else on + random.normal(size=3) * 10.0 ** random.uniform(-9, 5)
        )
        if np.sum((p / radii) ** 2) <= 1.0:
            continue
        size, exact = float(np.abs(p).sum() + radii.sum()), exact_distance(radii, p)
        short = float(exact - ellipsoid_distance(tuple(radii.tolist()), *p.tolist())[3])
        assert -1e-9 * size < short < 0.01 * _SAFE_SIDE * size
        outside += 1
    assert outside > 100


@pytest.mark.parametrize("seed", range(30))
def test_the_depth_inside_is_one_that_the_point_has(seed):
    """The ball of that radius about the point lies in the body; a cylinder's is the largest."""
    random = np.random.default_rng(seed)
    body = random_body(random)
    core = body.core
    x = core.center + (0.55 * random.uniform(-1, 1, 3) * core.half_extents) @ core.axes
    depth = -body.distance(x[None])[0]
    assert depth > 0.0
    around = random.normal(size=(4000, 3))
    around /= np.linalg.norm(around, axis=1)[:, None]
    assert is_inside(body, x + (1 - 1e-9) * depth * around).all()
    if isinstance(body, Cylinder):
        assert not is_inside(body, x + 1.2 * depth * around).all()


def test_the_support_of_far_and_flat_bodies_is_that_of_their_surface():
    random = np.random.default_rng(1)
    for _ in range(20):
        body = random_body(random)
        row, hulls = bodies_of(asked(body))[0], hulls_of(asked(body))
        n = random.normal(size=3)
        n /= np.linalg.norm(n)
        surface = body.core.outline()[0]
        most = float(np.max((surface - row[:3]) @ n))
        size = float(np.linalg.norm(body.core.half_extents))
        assert most - 1e-12 <= core_support(row, hulls, *n) <= most + 0.01 * size


ROLL = np.array([[-0.2, 0.0], [0.0, 0.0], [0.02, 0.0]])

RODS = {
    "pipe": Cylinder([-0.3, 0.02, 0.12], [0.3, 0.02, 0.12], 0.02),
    "post": Cylinder([0.0, -0.06, 0.1], [0.0, -0.04, 0.3], 0.03),
    "disc": Cylinder([0.0, -0.05, 0.1], [0.0, -0.05, 0.105], 0.05),
    "egg": Ellipsoid([0.0, -0.05, 0.1], [0.05, 0.02, 0.03], TURN.as_quat()),
    "needle": Ellipsoid([0.0, -0.05, 0.1], [0.2, 0.004, 0.002], TURN.as_quat()),
    "moving": Ellipsoid(
        [0.1, -0.05, 0.1], [0.03, 0.02, 0.01], TURN.as_quat(), motion=[[-0.2, 0], [0, 0], [0.02, 0]]
    ),
    "rolling": Cylinder([0.1, -0.1, 0.1], [0.1, 0.1, 0.1], 0.02, motion=ROLL),
}


HIDING = {
    "pipe": Cylinder([-0.019, -0.012, 0.177], [0.171, -0.012, 0.177], 0.008),
    "post": Cylinder([-0.001, -0.042, 0.03], [-0.001, -0.036, 0.089], 0.012),
    "disc": Cylinder([0.031, -0.044, 0.106], [0.031, -0.044, 0.107], 0.02),
    "egg": RODS["egg"],
    "needle": RODS["needle"],
    "moving": RODS["moving"],
}
"""Bodies that hide no point from the ends of a path, and would on the straight way."""


def planned_past(obstacle, **more):
    plan = plan_path(asked(obstacle, clearance=0.015, **more))
    assert plan.status == "certified", plan.reason
    return plan


@cache
def planned_past_hiding(name):
    return planned_past(HIDING[name], occlusion=True)


@pytest.mark.parametrize("name", RODS)
def test_a_path_past_it_is_certified_true_and_verified(name):
    obstacle = RODS[name]
    plan = planned_past(obstacle)
    certified = margins_of(plan.certificate)["clearance obstacle 0"]
    true = true_clearance(obstacle, plan.path) - 0.015
    assert 0.0 <= certified <= true + 1e-9
    assert true - certified < 2e-4 + 1e-9
    verdict = verify_plan(plan.to_dict())
    assert verdict.status == "certified", verdict.reasons


@pytest.mark.parametrize("name", HIDING)
def test_lines_of_sight_past_it_are_certified_true_and_verified(name):
    obstacle, plan = HIDING[name], planned_past_hiding(name)
    certified = margins_of(plan.certificate)["occlusion obstacle 0"]
    w = np.linspace(0.0, 1.0, 41)
    places = zip(plan.path.positions(w), displaced(obstacle, w), strict=True)
    sights = [(t - m, h - m) for t, m in places for h in plan.problem.points]
    shares = np.linspace(0.0, 1.0, 101)[:, None]
    nearest = np.argsort([obstacle.distance(t + shares * (h - t)).min() for t, h in sights])[:12]
    true = min(sight_distance(obstacle, *sights[k]) for k in nearest)
    assert 0.0 <= certified <= true + 1e-6
    verdict = verify_plan(plan.to_dict())
    assert verdict.status == "certified", verdict.reasons


@pytest.mark.parametrize("name", ["disc", "egg", "moving"])
def test_the_verifier_refutes_a_larger_margin_and_a_larger_body(name):
    """As it is, the plan is certified: `test_lines_of_sight_past_it_are_certified_true_and_verified`."""
    plan = planned_past_hiding(name).to_dict()
    for family in ("clearance", "occlusion"):
        lines = plan["certificate"]["constraints"]
        line = next(c for c in lines if c["name"].startswith(f"{family} obstacle"))
        honest = line["margin"]
        line["margin"] = honest + 0.001
        assert verify_plan(plan).status == "refuted", family
        line["margin"] = honest
    obstacle = plan["problem"]["obstacles"][0]
    larger = "radii" if "radii" in obstacle else "radius"
    obstacle[larger] = (np.array(obstacle[larger]) + 0.001).tolist()
    assert verify_plan(plan).status == "refuted"


@pytest.mark.parametrize("name", ["pipe", "egg"])
def test_an_end_within_the_clearance_is_infeasible_and_verified(name):
    obstacle = RODS[name]
    inside = obstacle.core.center
    for goal in (inside, inside + np.array([0.0, 0.0, 0.04])):
        plan = plan_path(asked(obstacle, goal=goal, clearance=0.05))
        assert plan.status == "infeasible"
        assert "clearance obstacle 0" in plan.reason


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Cylinder([0, 0, 0], [0, 0, 0], 0.1), "to: 0 m from the other end"),
        (lambda: Cylinder([0, 0, 0], [0, 0, 1], 0.0), "radius"),
        (lambda: Cylinder([0, 0, 0], [0, np.nan, 1], 0.1), "to"),
        (lambda: Ellipsoid([0, 0, 0], [0.1, 0.0, 0.1], [0, 0, 0, 1]), "radii"),
        (lambda: Ellipsoid([0, 0, 0], [0.1, 1e-320, 0.1], [0, 0, 0, 1]), "radii"),
        (lambda: Ellipsoid([0, 0, 0], [0.1, 0.1, 0.1], [0, 0, 0, 2]), "quaternion"),
    ],
)
def test_what_is_no_body_is_named(make, words):
    with pytest.raises(InputError, match=words):
        make()


@pytest.mark.parametrize("make", [Box, Ellipsoid])
def test_without_a_rotation_it_lies_along_the_axes_of_its_frame(make):
    body = make([0.1, 0.2, 0.3], [0.01, 0.02, 0.03])
    assert body.distance(np.array([[0.1, 0.2, 0.34], [0.12, 0.2, 0.3]])) == pytest.approx([0.01, 0.01])
    assert body.quaternion.tolist() == [0.0, 0.0, 0.0, 1.0]


@pytest.mark.parametrize("body", [RODS["pipe"], RODS["egg"]], ids=["cylinder", "ellipsoid"])
def test_a_grown_body_holds_all_near_it(body):
    random = np.random.default_rng(2)
    surface = body.core.outline()[0]
    away = random.normal(size=surface.shape)
    away *= 0.01 / np.linalg.norm(away, axis=1)[:, None]
    assert body.grown(0.01).distance(surface + away).max() <= 1e-12
