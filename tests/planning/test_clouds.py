"""Point clouds: every ball of a cloud is kept off and seen past, proven through a tree of balls."""

import itertools

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.cameras import preset
from omniservo.errors import InputError
from omniservo.geometry.polynomial import bernstein_from_power, magnitude
from omniservo.geometry.subdivision import PROVEN
from omniservo.planning import CameraPath, Cloud, Plan, PlanningProblem, Sphere, Workspace, certify, plan_path
from omniservo.planning.bernstein_path import squares
from omniservo.planning.constraints.cloud import prove_off_cloud
from omniservo.planning.constraints.cloud_sight import prove_sights_past_cloud
from omniservo.planning.end_poses import violation_at_end
from omniservo.planning.obstacles.ball_tree import ball_tree, nearest_point
from omniservo.replanning.frame_change import problem_from
from omniservo.verification import verify_plan

FINE = np.linspace(0.0, 1.0, 2001)
POINTS = np.array([[-0.1, -0.1, 0.6], [0.1, -0.1, 0.55], [0.1, 0.1, 0.6], [-0.1, 0.1, 0.62], [0, 0, 0.58]])
GOAL = np.array([0.0, -0.10, 0.20])


def asked(*obstacles, points=POINTS, **changes):
    pose = RigidTransform.from_components(GOAL, Rotation.identity())
    return PlanningProblem(
        preset("fe185"), points, pose, obstacles, **({"clearance": 0.01, "least_distance": 0.02} | changes)
    )


def detour(dip):
    """A path to GOAL that bends by ``dip`` in the middle."""
    bend = np.array(dip)
    rotation = np.array([[0.0, 0.0]] * 3 + [[0.0, 1.0]])
    return CameraPath(rotation, np.column_stack([-4.0 * bend, GOAL + 4.0 * bend, np.zeros(3)]))


def shell(rng, count, center=(0.005, -0.05, 0.1), radius=0.03):
    """Points on a ball across the straight way to GOAL."""
    v = rng.normal(size=(count, 3))
    return np.array(center) + radius * v / np.linalg.norm(v, axis=1, keepdims=True)


def sight_distances(t, h, points):
    """Distances (p,) of points from the segment from t to h: the definition, in NumPy."""
    along = h - t
    share = np.clip((points - t) @ along / (along @ along), 0.0, 1.0)
    return np.linalg.norm(points - t - share[:, None] * along, axis=1)


def distances(path, points, w=FINE):
    """Smallest distance of each point (p,) from the path at the samples w."""
    best = np.full(len(points), np.inf)
    for t in path.positions(w):
        best = np.minimum(best, np.linalg.norm(points - t, axis=1))
    return best


def true_distance(path, points):
    """The smallest distance of any point from the path, by the roots of its derivative."""
    nearest = points[np.argsort(distances(path, points, FINE[::20]))[:50]]
    found = []
    for p in nearest:
        rows = [np.polynomial.Polynomial(row[::-1]) for row in path.translation]
        square = sum(
            ((row - x) ** 2 for row, x in zip(rows, p, strict=True)), np.polynomial.Polynomial([0.0])
        )
        at = [r.real for r in square.deriv().roots() if abs(r.imag) < 1e-9 and 0.0 < r.real < 1.0]
        found.append(min(float(square(w)) for w in [0.0, 1.0, *at]))
    return float(np.sqrt(min(found)))


def margins_of(certificate):
    return {c.name.split(" (")[0]: c.margin for c in certificate.constraints}


SETS = {
    "one point": np.array([[0.3, -0.1, 0.2]]),
    "nine": np.random.default_rng(1).normal(size=(9, 3)),
    "all equal": np.tile([0.1, 0.2, 0.3], (100, 1)),
    "collinear": np.linspace(0.0, 1.0, 333)[:, None] * np.array([0.1, -0.2, 0.3]),
    "in a plane": np.column_stack([np.random.default_rng(2).normal(size=(500, 2)), np.zeros(500)]),
    "random": np.random.default_rng(3).normal(size=(1001, 3)),
    "two far clusters": np.repeat([[-1e6, 0.0, 0.0], [1e6, 0.0, 0.0]], 20, axis=0)
    + np.random.default_rng(4).normal(size=(40, 3)),
}


@pytest.mark.parametrize("name", SETS)
def test_every_point_is_in_every_ball_above_it_and_once_in_a_leaf(name):
    points = SETS[name]
    tree = ball_tree(points)
    assert sorted(map(tuple, tree.points)) == sorted(map(tuple, points))
    leaves = []
    for i, (*center, radius, first, end, after) in enumerate(tree.nodes):
        inside = tree.points[int(first) : int(end)]
        assert np.all(np.linalg.norm(inside - center, axis=1) <= radius)
        assert i < after <= len(tree.nodes)
        if after == i + 1:
            assert 1 <= end - first <= 8
            leaves += range(int(first), int(end))
        else:
            left, right = tree.nodes[i + 1], tree.nodes[int(tree.nodes[i + 1, 6])]
            assert (left[4], left[5], right[5], right[6]) == (first, right[4], end, after)
    assert leaves == list(range(len(points)))
    assert np.array_equal(ball_tree(points).points, tree.points)


@pytest.mark.parametrize("name", SETS)
def test_the_nearest_point_is_that_of_all(name):
    points = SETS[name]
    tree, rng = ball_tree(points), np.random.default_rng(7)
    for k in range(60):
        t = rng.normal(size=3)
        h = t if k % 3 == 0 else rng.normal(size=3)
        truth = np.linalg.norm(points - t, axis=1) if k % 3 == 0 else sight_distances(t, h, points)
        index, distance = nearest_point(tree.points, tree.nodes, tuple(t), tuple(h), np.inf)
        assert abs(distance - truth.min()) <= 1e-12 * (1.0 + truth.min())
        found = np.linalg.norm(tree.points[index] - t) if k % 3 == 0 else None
        assert found is None or abs(found - distance) <= 1e-12 * (1.0 + distance)
        limit = 0.999 * truth.min()
        assert nearest_point(tree.points, tree.nodes, tuple(t), tuple(h), limit) == (-1, limit)


def random_path(rng, degree):
    """Powers (3, degree + 1) of a path of about 0.5 m."""
    return np.column_stack([rng.normal(size=(3, degree)) * 0.2, np.zeros(3)])


@pytest.mark.parametrize("degree", [1, 2, 3, 5])
@pytest.mark.parametrize("count", [1, 40, 3000])
def test_a_proof_agrees_with_all_points_on_both_sides(degree, count):
    rng = np.random.default_rng([degree, count])
    for _ in range(6):
        t = random_path(rng, degree)
        path = CameraPath(np.array([[0.0, 0.0]] * 3 + [[0.0, 1.0]]), t)
        points = rng.normal(size=(count, 3)) * 0.3 + rng.normal(size=3) * 0.2
        tree, truth = ball_tree(points), true_distance(path, points)
        square, raised = squares(t)
        near = 1e-8 + 1e-12 / truth**2  # squares are known to about 1e-13 m²
        for part, expected in ((1.0 - near, True), (1.0 + near, False), (0.5, True), (2.0, False)):
            status, w = prove_off_cloud(square, raised, magnitude(t), *tree, part * truth)
            assert (status == PROVEN) == expected
            if not expected:
                assert np.linalg.norm(points - path.positions(w), axis=1).min() < part * truth


def test_sights_agree_with_all_points_on_both_sides():
    rng = np.random.default_rng(8)
    decided = 0
    for _ in range(12):
        t = random_path(rng, 2)
        path = CameraPath(np.array([[0.0, 0.0]] * 3 + [[0.0, 1.0]]), t)
        points = rng.normal(size=(500, 3)) * [0.2, 0.2, 0.02] + [0.4, 0.0, 0.4]
        targets = rng.normal(size=(4, 3)) * 0.1 + [0.0, 0.0, 1.0]
        seen = min(sight_distances(a, h, points).min() for a in path.positions(FINE[::5]) for h in targets)
        if seen < 1e-3:
            continue
        decided += 1
        centre, size = bernstein_from_power(t), magnitude(t)
        tree = ball_tree(points)
        assert prove_sights_past_cloud(centre, size, targets, *tree, 0.98 * seen)[0] == PROVEN
        status, w, j = prove_sights_past_cloud(centre, size, targets, *tree, seen * (1.0 + 1e-6))
        assert status != PROVEN
        assert sight_distances(path.positions(w), targets[j], points).min() < seen * (1.0 + 1e-6)
    assert decided > 4


def test_one_point_among_thousands_between_the_samples_is_never_certified():
    rng, path = np.random.default_rng(9), detour([0.05, 0.0, 0.0])
    many = rng.uniform([0.12, -0.3, -0.1], [0.2, 0.2, 0.4], (5000, 3))
    w, off = 0.5078125 + 1e-5, np.array([0.0, 0.6, 0.8])
    # straight across the path, so that the path is nowhere nearer to it
    off -= (
        off
        @ (tangent := np.diff(path.positions(np.array([w - 1e-6, w + 1e-6])), axis=0)[0])
        * tangent
        / (tangent @ tangent)
    )
    for beyond, expected in ((1e-3, True), (1e-8, True), (-1e-9, False), (-1e-6, False), (-1e-3, False)):
        planted = path.positions(w) + off / np.linalg.norm(off) * (0.012 + beyond)
        problem = asked(Cloud(np.insert(many, 2500, planted, axis=0), 0.002))
        truth = true_distance(path, problem.obstacles[0].points) - 0.012
        assert abs(truth - beyond) < 2e-10
        verdict, certificate = certify(problem, path)
        assert (verdict == "certified") == expected
        assert certificate.worst.name == "clearance obstacle 0" or expected
        if beyond in (1e-8, -1e-9):
            plan = Plan(problem, "certified", path, certificate, 0.0, "certified")
            assert verify_plan(plan).status == ("certified" if expected else "refuted")
        assert margins_of(certificate)["clearance obstacle 0"] <= truth + 1e-12


@pytest.mark.parametrize("occlusion", [False, True])
def test_the_plan_round_a_cloud_keeps_what_it_states(occlusion):
    points = shell(np.random.default_rng(10), 3000)
    plan = plan_path(asked(Cloud(points, 0.002), occlusion=occlusion))
    assert plan.status == "certified", plan.reason
    assert verify_plan(plan).status == "certified"
    found = margins_of(plan.certificate)
    seen = true_distance(plan.path, points) - 0.012
    assert 0.0 <= found["clearance obstacle 0"] <= seen + 1e-12
    assert seen < found["clearance obstacle 0"] + 1e-5
    if occlusion:
        sights = itertools.product(plan.path.positions(FINE[::20]), POINTS)
        seen = min(sight_distances(t, h, points).min() for t, h in sights) - 0.002
        assert 0.0 <= found["occlusion obstacle 0"] <= seen < found["occlusion obstacle 0"] + 1e-4
    assert ("occlusion obstacle 0" in found) == occlusion


def test_a_cloud_is_its_points_as_spheres():
    points = shell(np.random.default_rng(11), 200)
    path = detour([0.08, 0.0, 0.0])
    for occlusion in (False, True):
        cloud = certify(asked(Cloud(points, 0.002), occlusion=occlusion), path)
        spheres = certify(asked(*(Sphere(p, 0.002) for p in points), occlusion=occlusion), path)
        assert cloud[0] == spheres[0]
        for family in ("clearance", "occlusion") if occlusion else ("clearance",):
            of_spheres = min(m for name, m in margins_of(spheres[1]).items() if name.startswith(family))
            assert abs(margins_of(cloud[1])[f"{family} obstacle 0"] - of_spheres) < 1e-7


def test_a_cloud_of_radius_0_hides_nothing_and_without_clearance_asks_nothing():
    points = np.linspace([0.0, 0.0, 0.0], GOAL, 50)
    plan = plan_path(asked(Cloud(points), clearance=0.0, occlusion=True))
    assert plan.status == "certified"
    assert "occlusion obstacle 0" not in margins_of(plan.certificate)


def test_two_clouds_have_a_line_each_and_their_own_clearance():
    rng = np.random.default_rng(12)
    clouds = [Cloud(shell(rng, 40, [x, -0.05, 0.1], 0.01), 0.001, c) for x, c in ((0.1, 0.02), (-0.15, None))]
    path = detour([0.0, 0.0, 0.0])
    verdict, certificate = certify(asked(clouds[0], Sphere([0.3, 0.0, 0.0]), clouds[1]), path)
    assert verdict == "certified"
    found = margins_of(certificate)
    for name, cloud, clearance in (("0", clouds[0], 0.02), ("2", clouds[1], 0.01)):
        truth = true_distance(path, cloud.points) - 0.001 - clearance
        assert truth - 1e-6 < found[f"clearance obstacle {name}"] <= truth + 1e-12


def test_a_wall_of_points_is_passed_through_its_hole():
    x, y = np.meshgrid(np.arange(-0.3, 0.3, 0.006), np.arange(-0.3, 0.3, 0.006))
    points = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, 0.1)])
    hole = np.array([0.07, 0.0])
    points = points[np.linalg.norm(points[:, :2] - hole, axis=1) > 0.035]
    room = Workspace([-0.28, -0.28, -1.0], [0.28, 0.28, 1.0])  # no way round the wall
    plan = plan_path(asked(Cloud(points, 0.002), workspace=room))
    assert plan.status == "certified", plan.reason
    t = plan.path.positions(FINE)
    crossing = t[np.argmin(np.abs(t[:, 2] - 0.1))]
    assert np.linalg.norm(crossing[:2] - hole) < 0.035
    assert distances(plan.path, points).min() >= 0.012


def test_an_end_pose_in_a_cloud_is_named():
    points = np.concatenate(
        [shell(np.random.default_rng(13), 500, [0.2, 0.0, 0.0]), [GOAL + np.array([0, 0.009, 0])]]
    )
    says = violation_at_end(asked(Cloud(points, 0.002)))
    assert "goal pose (w = 1) violates clearance obstacle 0: falls short by 0.003 m" in says
    hidden = np.concatenate([points[:-1], [0.5 * POINTS[4] + [0.001, 0.0, 0.0]]])
    says = violation_at_end(asked(Cloud(hidden, 0.002), occlusion=True))
    assert "start pose (w = 0) violates occlusion obstacle 0 (point 4): falls short by 0.001 m" in says


def test_a_cloud_seen_from_a_pose_on_the_way_keeps_its_place():
    points = shell(np.random.default_rng(15), 30)
    pose = RigidTransform.from_components([0.1, 0.2, -0.3], Rotation.from_rotvec([0.3, -0.5, 1.0]))
    moved = problem_from(asked(Cloud(points, 0.002, 0.03)), pose, 0.0, None).obstacles[0]
    assert np.abs(pose.apply(moved.points) - points).max() < 1e-15
    assert (moved.radius, moved.clearance) == (0.002, 0.03)


ACROSS = np.array([[0.0, 0.1, -0.04], [0.02, -0.08, 0.03], [0.0, 0.03, 0.0]])
"""A motion (3, 3) of some centimetres, highest power of w first."""


SWEEP = np.array([[0.3, -0.15], [0.0, 0.0], [0.0, 0.0]])
"""... from one side of the straight way to the other."""


def displaced(motion, w):
    return np.array([np.polyval(row, w) for row in motion])


@pytest.mark.parametrize("occlusion", [False, True])
def test_the_plan_round_a_cloud_that_moves_keeps_what_it_states(occlusion):
    points = shell(np.random.default_rng(16), 300, radius=0.02)
    problem = asked(Cloud(points, 0.002, motion=SWEEP), occlusion=occlusion)
    straight = detour([0.0, 0.0, 0.0])
    assert certify(problem, straight)[0] == "refuted"
    plan = plan_path(problem)
    assert plan.status == "certified", plan.reason
    assert verify_plan(plan).status == "certified"
    found = margins_of(plan.certificate)
    places = [(w, t) for w, t in zip(FINE[::4], plan.path.positions(FINE[::4]), strict=True)]
    seen = min(np.linalg.norm(points + displaced(SWEEP, w) - t, axis=1).min() for w, t in places) - 0.012
    assert 0.0 <= found["clearance obstacle 0"] <= seen < found["clearance obstacle 0"] + 1e-4
    if occlusion:
        seen = min(
            sight_distances(t, h, points + displaced(SWEEP, w)).min() for w, t in places for h in POINTS
        )
        assert 0.0 <= found["occlusion obstacle 0"] <= seen - 0.002 < found["occlusion obstacle 0"] + 1e-3


def test_a_cloud_that_moves_as_the_camera_keeps_its_distance_exactly():
    path, points = detour([0.05, 0.02, 0.0]), shell(np.random.default_rng(17), 100, [0.2, 0.0, 0.0])
    truth = np.linalg.norm(points, axis=1).min()
    for beyond, expected in ((1e-8, "refuted"), (-1e-8, "certified")):
        cloud = Cloud(points, 0.002, truth - 0.002 + beyond, path.translation)
        assert certify(asked(cloud), path)[0] == expected


def test_sights_past_a_moving_cloud_on_both_sides():
    path = detour([0.0, 0.05, 0.0])
    points = shell(np.random.default_rng(18), 60, [0.2, 0.15, 0.3], 0.01)
    places = [(w, t) for w, t in zip(FINE[::4], path.positions(FINE[::4]), strict=True)]
    for motion in (ACROSS, 0.0 * ACROSS, ACROSS[:, 1:], np.column_stack([0.01 * ACROSS, ACROSS])):
        seen = min(
            sight_distances(t, h, points + displaced(motion, w)).min() for w, t in places for h in POINTS
        )
        assert seen > 1e-3
        for radius, expected in ((seen * 0.99, "certified"), (seen * (1.0 + 1e-9), "refuted")):
            problem = asked(Cloud(points, radius, 0.0, motion), occlusion=True)
            assert certify(problem, path)[0] == expected


BAD_CLOUDS = {
    "none": ({"points": []}, "points: 0 given; legal: 1 to 100000"),
    "a million": ({"points": np.zeros((1_000_000, 3))}, "points: 1000000 given; legal: 1 to 100000"),
    "holes": (
        {"points": [[0, 0, 1], [0, float("nan"), 1], [0, 0, float("inf")]]},
        r"points: 2 of 3 are not finite, the first is number 1: \[0.0, nan, 1.0\]",
    ),
    "flat": ({"points": [[0, 0]]}, r"points: shape \(1, 2\) given"),
    "words": ({"points": "cloud"}, "points: "),
    "far": ({"points": [[0, 0, 2e6]]}, "points: 2e.06 given; legal: -1e6 to 1e6"),
    "radius": ({"points": [[0, 0, 1]], "radius": -0.1}, "radius: -0.1 given"),
    "motion": ({"points": [[0, 0, 1]], "motion": [[1, 2]]}, "motion: "),
    "clearance": ({"points": [[0, 0, 1]], "radius": 0.1, "clearance": -1}, "clearance: -1 given"),
}


@pytest.mark.parametrize("name", BAD_CLOUDS)
def test_a_wrong_cloud_is_refused_by_name(name):
    fields, says = BAD_CLOUDS[name]
    with pytest.raises(InputError, match=says):
        Cloud(**({"radius": 0.01} | fields))
    if name != "a million":
        document = asked().to_dict()
        document["obstacles"] = [{"type": "cloud", "radius": 0.01} | fields]
        with pytest.raises(InputError, match=r"obstacles\[0\]." + says):
            PlanningProblem.from_dict(document)


def test_all_clouds_together_are_bounded():
    cloud = Cloud(np.random.default_rng(14).normal(size=(60_000, 3)))
    with pytest.raises(InputError, match="clouds of 120000 points together given; legal: at most 100000"):
        asked(cloud, cloud)


def test_the_papers_search_takes_no_cloud():
    with pytest.raises(InputError, match="where an obstacle is not a sphere"):
        plan_path(asked(Cloud([[0.0, 0.0, 0.1]])), method="paper")
