"""Certificates: guaranteed, not loose, complete, and right about what they do not prove."""

import copy
import json

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.cameras import UnifiedCamera, preset
from omniservo.errors import InputError
from omniservo.planning import (
    CameraPath,
    Degrees,
    Plan,
    PlanningProblem,
    Sphere,
    Workspace,
    certify,
    plan_path,
)
from omniservo.planning.certificate.certificate import ConstraintMargin
from omniservo.planning.certificate.certify import worst_of
from omniservo.planning.certificate.path_ends import ends_off
from omniservo.verification import verify_plan

FINE = np.linspace(0.0, 1.0, 5001)
LOOSE = {"visibility": 0.5, "dead_zone": 0.5, "clearance": 1e-3, "least_distance": 1e-3, "occlusion": 1e-3}


def straight(problem: PlanningProblem) -> CameraPath:
    start = np.array([0.0, 0.0, 0.0, 1.0])
    rotation = np.column_stack([problem.goal_quaternion - start, start])
    return CameraPath(rotation, np.column_stack([problem.goal_translation, np.zeros(3)]))


def bent(problem: PlanningProblem, rng: np.random.Generator, size: float) -> CameraPath:
    """A random path of degrees (2, 2) between the problem's ends."""
    line = straight(problem)
    u, v = rng.normal(size=4) * size, rng.normal(size=3) * size * 0.3
    start = np.array([0.0, 0.0, 0.0, 1.0])
    rotation = np.column_stack([-u, line.rotation[:, 0] + u, start])
    return CameraPath(rotation, np.column_stack([-v, line.translation[:, 0] + v, np.zeros(3)]))


def smallest(certificate, family: str) -> float:
    return min(c.margin for c in certificate.constraints if c.name.startswith(family))


@pytest.mark.parametrize("kind", ["fisheye", "pinhole", "catadioptric", "occlusion"])
def test_margins_are_lower_bounds_and_not_loose(random_problems, look, kind):
    rng = np.random.default_rng(1)
    proven = 0
    for problem in random_problems(kind, 12):
        for size in (0.02, 0.2):
            path = bent(problem, rng, size)
            verdict, certificate = certify(problem, path)
            seen = look(problem, path, FINE)
            lowest = {name: smallest(certificate, name) for name in seen}
            assert verdict != "certified" or min(lowest.values()) >= 0.0
            for name, value in seen.items():
                if name in ("visibility", "dead_zone") and smallest(certificate, "domain") < 0.0:
                    continue
                proven += lowest[name] >= 0.0
                assert lowest[name] <= value + 1e-9
                assert lowest[name] >= value - LOOSE[name]
            assert (verdict == "refuted") == (min(seen.values()) < -1e-9)
    assert proven > 20


def test_every_constraint_of_the_problem_is_in_the_certificate_once(paper):
    problem = paper(3, workspace=Workspace([-1, -1, -1], [1, 1, 1]))
    _, certificate = certify(problem, straight(problem))
    names = [c.name.split(" (point")[0] for c in certificate.constraints]
    assert names == [
        *(f"clearance obstacle {i}" for i in range(6)),
        "visibility left edge",
        "visibility right edge",
        "visibility top edge",
        "visibility bottom edge",
        "visibility max_angle",
        "domain",
        "least_distance",
        *(f"occlusion obstacle {i}" for i in range(1, 6)),
        *(f"workspace {axis} {side}" for side in ("min", "max") for axis in "xyz"),
        "rotation",
    ]
    units = {c.name.split()[0]: c.unit for c in certificate.constraints}
    assert units == {
        "clearance": "m",
        "visibility": "px",
        "domain": "rad",
        "least_distance": "m",
        "occlusion": "m",
        "workspace": "m",
        "rotation": "1",
    }


@pytest.mark.parametrize(("size", "left", "unit"), [(0.1, 0.2, "px"), (10.0, 0.6, "m")])
def test_the_worst_constraint_is_that_of_the_smallest_margin_as_an_angle(paper, size, left, unit):
    """Metres over the points' mean distance, pixels over the focal length: 0.2 m is much of a small one."""
    fields, goal = paper(1).to_dict(), size * paper(1).goal_translation
    fields["goal"]["translation"] = goal.tolist()
    fields |= {
        "points": (size * paper(1).points).tolist(),
        "obstacles": [{"type": "sphere", "center": [0, -left - 10 * size, 0], "radius": 0}],
        "clearance": 10 * size,
        "least_distance": 0.0,
    }
    problem = PlanningProblem.from_dict(fields)
    _, certificate = certify(problem, straight(problem))
    distance = np.linalg.norm(problem.points, axis=1).mean()
    units = {"m": distance, "px": min(problem.camera.fx, problem.camera.fy), "rad": 1.0, "1": 1.0}
    assert certificate.worst == min(certificate.constraints, key=lambda c: c.margin / units[c.unit])
    assert certificate.worst.unit == unit


def test_of_margins_that_are_one_angle_but_for_rounding_the_smaller_is_the_worst(paper):
    """The verifier compares the margins themselves."""
    problem, larger, ell = paper(1), 0.3, 0.57
    smaller = np.nextafter(larger, 0.0)
    assert smaller / ell == larger / ell
    found = [
        ConstraintMargin(f"workspace x {end}", m, "m", 0.0) for end, m in (("min", larger), ("max", smaller))
    ]
    assert worst_of(problem, found, ell) == found[1]


def test_a_violation_is_refuted_with_the_place_where_it_is_worst(paper):
    problem = paper(1)
    verdict, certificate = certify(problem, straight(problem))
    assert verdict == "refuted"
    first = certificate.constraints[0]
    path = straight(problem)
    apart = np.linalg.norm(path.positions(FINE) - problem.obstacles[0].center, axis=1) - 0.055
    assert first.margin == pytest.approx(apart.min(), abs=1e-6)
    assert first.w == pytest.approx(FINE[apart.argmin()], abs=1e-3)


@pytest.mark.parametrize("relative", [1e-6, 1e-9])
def test_a_violation_planted_between_samples_is_never_certified(paper, relative):
    """The radius grows past the true smallest distance by a relative 1e-9."""
    for example in (1, 2, 3):
        problem = paper(example)
        plan = plan_path(problem)
        assert plan.status == "certified"
        for i, c in enumerate(c for c in plan.certificate.constraints if c.name.startswith("clearance")):
            obstacle = problem.obstacles[i]
            own = problem.clearance if obstacle.clearance is None else obstacle.clearance
            reach = _exact_distance(plan.path, obstacle.center) - obstacle.radius
            grown = Sphere(obstacle.center, obstacle.radius, reach * (1.0 + relative))
            kept = Sphere(obstacle.center, obstacle.radius, reach * (1.0 - 1e-6))
            assert reach - own >= c.margin
            assert certify(_with(problem, i, grown), plan.path)[0] != "certified"
            if grown.clearance - own > 1e-6:
                assert certify(_with(problem, i, kept), plan.path)[0] == "certified"


def _with(problem: PlanningProblem, index: int, obstacle: Sphere) -> PlanningProblem:
    fields = problem.to_dict()
    fields["obstacles"][index]["clearance"] = obstacle.clearance
    return PlanningProblem.from_dict(fields)


def _exact_distance(path: CameraPath, center: np.ndarray) -> float:
    """Smallest ‖t − o‖, from the roots of the derivative."""
    offset = path.translation.copy()
    offset[:, -1] -= center
    square = sum(np.polymul(row, row) for row in offset)
    roots = np.roots(np.polyder(square))
    inside = [r.real for r in roots if abs(r.imag) < 1e-9 and 0 < r.real < 1]
    return float(np.sqrt(min(np.polyval(square, w) for w in [0.0, 1.0, *inside])))


def test_an_image_margin_that_is_grown_past_the_truth_is_never_certified(paper):
    """The visibility margin asked for is raised to just over and just under what the path leaves."""
    for example in (1, 2):
        plan = plan_path(paper(example))
        least = smallest(plan.certificate, "visibility")
        over = paper(example, visibility_margin=2.0 + least + 1e-4)
        under = paper(example, visibility_margin=2.0 + least - 1e-4)
        assert certify(over, plan.path)[0] == "refuted"
        assert certify(under, plan.path)[0] == "certified"


def test_a_point_behind_the_camera_that_folds_into_the_image_is_refuted():
    """172° from the axis, ξ = 1.291: its formula gives pixel (439, 206)."""
    lens = preset("fe185")
    camera = UnifiedCamera(lens.fx, lens.fy, lens.cx, lens.cy, lens.xi, lens.width, lens.height)
    angle = np.radians(172.0)
    behind = np.array([[np.sin(angle) * 0.8, -np.sin(angle) * 0.6, np.cos(angle)]])
    goal = RigidTransform.from_components([0.0, 0.0, 0.01], Rotation.identity())
    problem = PlanningProblem(camera, behind, goal)
    verdict, certificate = certify(problem, straight(problem))
    assert verdict == "refuted"
    assert smallest(certificate, "domain") < 0.0
    assert plan_path(problem).status == "infeasible"


def test_targets_beyond_ninety_degrees_are_certified():
    camera = preset("para-catadioptric")
    angle = np.radians(100.0)
    around = np.linspace(-0.3, 0.3, 4)
    points = np.array([[np.sin(angle) * np.cos(a), np.sin(angle) * np.sin(a), np.cos(angle)] for a in around])
    assert camera.project(points)[1].all()
    if not camera.in_image(camera.project(points)[0]).all():
        points = points[:, [1, 0, 2]]
    goal = RigidTransform.from_components([0.02, -0.03, 0.01], Rotation.from_rotvec([0.02, 0.0, 0.3]))
    problem = PlanningProblem(camera, points, goal)
    plan = plan_path(problem)
    assert plan.status == "certified"
    assert verify_plan(plan).status == "certified"


def test_a_constraint_that_is_just_met_is_undecided_and_not_certified():
    """Standing exactly at the clearance: neither proven nor refuted."""
    goal = RigidTransform.from_components([0.0, 0.25, 0.0], Rotation.identity())
    problem = PlanningProblem(
        preset("fe185"), [[0.0, 0.1, 1.0]], goal, (Sphere([0.5, 0.125, 0.0]),), clearance=0.5
    )
    verdict, certificate = certify(problem, straight(problem))
    assert verdict == "undecided"
    assert abs(certificate.constraints[0].margin) < 1e-6


@pytest.mark.parametrize("margin", [0.0, 3.0])
def test_margins_agree_with_the_cameras_own_limits(random_problems, margin):
    """A path is certified with margin m exactly where its margins are at least m."""
    for kind in ("fisheye", "pinhole", "catadioptric"):
        for problem in random_problems(kind, 4):
            fields = problem.to_dict() | {"visibility_margin": margin, "clearance": 0.0, "obstacles": []}
            asked = PlanningProblem.from_dict(fields)
            verdict, certificate = certify(asked, straight(asked))
            left = min(smallest(certificate, "visibility"), smallest(certificate, "domain") * 1e3)
            if asked.camera.dead_zone is not None:
                left = min(left, smallest(certificate, "dead_zone"))
            assert verdict == ("certified" if left >= 0.0 else "refuted")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda u, v: (u, v + np.array([[0, 0, 1e-6]] * 3)), "its start misses the identity by"),
        (lambda u, v: (u + np.array([[-1e-6, 0, 1e-6]] * 4), v), "its start misses the identity by"),
        (lambda u, v: (u, v + np.array([[0, 1e-6, 0]] * 3)), "its end misses the goal by"),
        (lambda u, v: (u + np.array([[0, 1e-6, 0]] * 4), v), "its end misses the goal by"),
        (lambda u, v: (np.hstack([np.zeros((4, 2)), u]), v), "degrees 4 and 2 given; legal: 1 to 2"),
        (lambda u, v: (u, np.hstack([np.zeros((3, 2)), v])), "degrees 2 and 4 given; legal: 1 to 2"),
        (lambda u, v: (u, v[:, -1:]), "degrees 2 and 0 given"),
        (lambda u, v: (u * 0.0, v), "the quaternion is 0"),
    ],
)
def test_a_path_of_another_problem_is_refused(paper, change, message):
    plan = plan_path(paper(1))
    with pytest.raises(InputError, match=message):
        certify(plan.problem, CameraPath(*change(plan.path.rotation, plan.path.translation)))


def test_every_coordinate_of_both_ends_is_looked_at(paper):
    plan = plan_path(paper(1))
    for which, rows in ((0, 3), (1, 3)):
        for row in range(rows):
            for end in ("start", "end"):
                parts = [plan.path.rotation.copy(), plan.path.translation.copy()]
                parts[which][row, 0] += 1e-6 if end == "end" else -1e-6
                parts[which][row, -1] += 0.0 if end == "end" else 1e-6
                with pytest.raises(InputError, match=f"its {end} misses"):
                    certify(plan.problem, CameraPath(*parts))


def test_an_end_with_one_component_of_the_other_sign_is_off_and_with_all_is_the_same():
    start, goal = np.array([0.0, 0.0, 0.0, 1.0]), np.array([0.1, -0.3, 0.5, np.sqrt(0.65)])
    still = np.zeros((3, 2))
    for signs, off in [(np.ones(4), 0.0), (-np.ones(4), 0.0)] + [
        (1.0 - 2.0 * np.eye(4)[c], 2.0 * abs(goal[c])) for c in range(3)
    ]:
        rotation = np.column_stack([signs * goal - start, start])
        assert ends_off(rotation, still, goal, np.zeros(3)) == pytest.approx((0.0, off), abs=1e-12)


def test_a_plan_survives_its_file_exactly(paper, tmp_path):
    plan = plan_path(paper(3))
    plan.save(tmp_path / "plan.json")
    again = Plan.load(tmp_path / "plan.json")
    assert again.to_dict() == plan.to_dict()
    assert np.array_equal(again.path.rotation, plan.path.rotation)
    assert certify(again.problem, again.path)[0] == "certified"
    with pytest.raises(InputError, match="exists"):
        plan.save(tmp_path / "plan.json")
    assert verify_plan(tmp_path / "plan.json").status == "certified"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"format": "omniservo.plan/9"}, "not a plan"),
        ({"status": "maybe"}, "status: 'maybe' given; legal: certified"),
        ({"extra": 1}, "extra: no such field"),
        ({"seconds": "soon"}, "seconds: 'soon' given"),
        ({"path": {"rotation": [[1]]}}, "translation: missing"),
        ({"path": {"rotation": [[1]], "translation": [[1]]}}, "path.rotation: shape"),
        ({"path": [1, 2]}, "path: \\[1, 2\\] given; a mapping"),
        ({"certificate": {"constraints": [{}]}}, "worst: missing"),
        ({"certificate": []}, "certificate: \\[\\] given; a mapping of fields is needed"),
        ({"certificate": "yes"}, "certificate: 'yes' given; a mapping"),
        ({"certificate": {"constraints": 3, "worst": {}}}, "certificate.constraints: 3 given; a list"),
        ({"problem": {}}, "problem: format: missing"),
    ],
)
def test_a_broken_plan_file_is_named(paper, tmp_path, change, message):
    file = tmp_path / "plan.json"
    file.write_text(json.dumps(plan_path(paper(1)).to_dict() | change))
    with pytest.raises(InputError, match=message) as caught:
        Plan.load(file)
    assert str(caught.value).startswith(str(file))


NONSENSE = (None, True, 3, -1.5, float("nan"), "x", "", [], {}, [1], [[]], {"a": 1}, 10**400, [["x"] * 5])


def nodes(value, place=()):
    """Every place of a document."""
    inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, part in inner:
        yield (*place, key)
        yield from nodes(part, (*place, key))


def test_a_plan_with_any_field_replaced_is_read_or_named(paper):
    """Separators, polygon, margins, path: one field of a plan with all of them is replaced by nonsense."""
    plan = plan_path(paper(1)).to_dict()
    pieces = {"pieces": [[0.0, 1.0, 0.0, 0.0, 1.0]]}
    plan["certificate"] |= {
        "separators": [
            {"constraint": "clearance obstacle 0", **pieces},
            {"constraint": "occlusion obstacle 0", "point": 0, **pieces},
        ],
        "polygon": [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]],
    }
    Plan.from_dict(plan)
    places = [p for p in nodes(plan) if p[0] in ("path", "certificate", "seconds", "status")]
    refused = 0
    for k, (*above, last) in enumerate(places):
        changed = copy.deepcopy(plan)
        holder = changed
        for step in above:
            holder = holder[step]
        holder[last] = NONSENSE[k % len(NONSENSE)]
        try:
            Plan.from_dict(changed)
        except InputError:
            refused += 1
    assert refused > 0.5 * len(places)


def test_a_separator_of_no_point_is_refused(paper):
    plan = plan_path(paper(1)).to_dict()
    for point in ("x", -1, 1.5, True):
        separator = {"constraint": "c", "point": point, "pieces": [[0.0, 1.0, 0.0, 0.0, 1.0]]}
        with pytest.raises(InputError, match="separators.point"):
            Plan.from_dict(plan | {"certificate": plan["certificate"] | {"separators": [separator]}})


def test_degrees_may_be_any(paper):
    for sigma, tau in ((1, 1), (1, 4), (5, 2), (16, 16)):
        problem = paper(1, degrees=Degrees(sigma, tau))
        line = straight(problem)
        raised = CameraPath(
            np.hstack([np.zeros((4, sigma - 1)), line.rotation]),
            np.hstack([np.zeros((3, tau - 1)), line.translation]),
        )
        margins = [c.margin for c in certify(problem, raised)[1].constraints]
        plain = [c.margin for c in certify(problem, line)[1].constraints]
        assert np.allclose(margins, plain, atol=1e-3, rtol=1e-4)
