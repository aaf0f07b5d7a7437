"""Convex meshes: the support of the vertices' hull, and looks that show a violation."""

import copy
from itertools import pairwise, product

import numpy as np
import pytest
from sampled_plans import problem
from scipy.optimize import nnls

from omniservo.planning import PlanningProblem, plan_path
from omniservo.verification import verify_plan
from omniservo.verification.nearest_point import nearest

BOX = {
    "type": "box",
    "center": [0.03125, -0.078125, 0.09375],
    "quaternion": [0.0, 0.0, 0.0, 1.0],
    "half_extents": [0.0625, 0.0078125, 0.015625],
}


def as_mesh(box):
    """The box's corners and some points inside: the hull is the box, exactly."""
    center, half = np.array(box["center"]), np.array(box["half_extents"])
    signs = np.array([*product((-1, 1), repeat=3), [0, 0, 0], [0.5, 0.5, -0.5]])
    return {"type": "mesh", "vertices": (center + signs * half).tolist()}


@pytest.fixture(scope="module")
def first():
    asked = problem(obstacles=[BOX], clearance=0.01, occlusion=True)
    document = plan_path(PlanningProblem.from_dict(asked)).to_dict()
    assert document["status"] == "certified"
    return document


@pytest.fixture
def honest(first):
    document = copy.deepcopy(first)
    document["problem"]["obstacles"] = [as_mesh(BOX)]
    return document


def reasons(document):
    answer = verify_plan(document)
    assert answer.status == "refuted", answer
    return answer.reasons


def test_the_planes_of_a_box_prove_the_mesh_of_its_corners(honest):
    answer = verify_plan(honest)
    assert answer.status == "certified", answer.reasons


def test_a_missing_or_wrong_plane_refutes(honest):
    separators = honest["certificate"]["separators"]
    changed = copy.deepcopy(honest)
    del changed["certificate"]["separators"][3]
    assert any("is missing" in reason for reason in reasons(changed))
    separators[0]["pieces"][0][2:] = [-x for x in separators[0]["pieces"][0][2:]]
    assert any("does not separate" in reason for reason in reasons(honest))


@pytest.mark.parametrize("vertex", range(8))
def test_each_vertex_counts(honest, vertex):
    middle = [float(np.polyval(row, 0.5)) for row in honest["path"]["translation"]]
    honest["problem"]["obstacles"][0]["vertices"][vertex] = middle
    found = [reason for reason in reasons(honest) if reason.startswith("clearance obstacle 0")]
    assert "left at w" in found[0]


@pytest.mark.parametrize("clearance", [0.0, 0.05, 0.15])
@pytest.mark.parametrize("family", ["clearance", "occlusion"])
def test_a_violation_is_shown_with_its_w(honest, clearance, family):
    honest["certificate"]["separators"] = []
    for line in honest["certificate"]["constraints"]:
        line["margin"] = 0.0
    t = np.array([np.polyval(row, 0.5) for row in honest["path"]["translation"]])
    mesh = honest["problem"]["obstacles"][0]
    to = t if family == "clearance" else 0.3 * t + 0.7 * np.array(honest["problem"]["points"][4])
    mesh["vertices"] = (np.array(mesh["vertices"]) - BOX["center"] + to).tolist()
    mesh["clearance"] = clearance
    found = [reason for reason in reasons(honest) if reason.startswith(f"{family} obstacle 0")]
    assert float(found[0].split(": ")[1].split()[0]) <= (-clearance if family == "clearance" else 0.0)
    assert "left at w" in found[0]


def test_an_end_pose_inside_or_near_a_mesh_is_infeasible():
    rng = np.random.default_rng(5)
    for center, clearance, hit in (
        ([0.0, 0.0, 0.0], 0.0, True),
        ([0.3, 0.0, 0.0], 0.25, True),
        ([0.3, 0.0, 0.0], 0.15, False),
    ):
        corners = rng.normal(size=(60, 3))
        corners *= 0.1 / np.linalg.norm(corners, axis=1)[:, None]
        asked = problem(
            obstacles=[{"type": "mesh", "vertices": (corners + center).tolist(), "clearance": clearance}]
        )
        document = {
            "format": "omniservo.plan/1",
            "problem": asked,
            "status": "infeasible",
            "path": None,
            "certificate": None,
        }
        assert ("infeasible confirmed" in reasons(document)[0]) == hit


@pytest.mark.parametrize(
    "vertices",
    [
        [[0, 0, 0], [1, 0, 0], [0, 1, 0]],
        [[0, 0, 1], [1, 0, 1], [0, 1, 1], [1, 1, 1], [5, 3, 1]],
        [[0, 0, 0], [1, 1, 1], [2, 2, 2], [3, 3, 3]],
        [[1, 1, 1]] * 4,
        [[0, 0, 0]] * 1001,
        [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, float("inf")]],
        None,
    ],
)
def test_a_malformed_mesh_is_refuted(honest, vertices):
    honest["problem"]["obstacles"][0]["vertices"] = vertices
    assert "problem.obstacles[0].vertices" in reasons(honest)[0]


def test_planes_times_vertices_are_bounded(honest):
    mesh = honest["problem"]["obstacles"][0]
    mesh["vertices"] = mesh["vertices"] * 100  # 1000
    separator = honest["certificate"]["separators"][0]
    cuts = np.linspace(0, 1, 50_002).tolist()
    separator["pieces"] = [[a, b, 0.0, 1.0, 0.0] for a, b in pairwise(cuts)]
    answer = verify_plan(honest)
    assert answer.status == "undecided"
    assert "more planes times vertices" in answer.reasons[0]


def test_nearest_points_agree_with_least_squares():
    rng = np.random.default_rng(2)
    for k in range(60):
        corners = rng.normal(size=(int(rng.integers(4, 40)), 3)) * [1.0, 1.0, 0.0 if k % 7 == 0 else 1.0]
        start = rng.normal(size=3) * (0.3 if k % 3 == 0 else 3.0)
        end = start if k % 2 else start + rng.normal(size=3)
        apart, carried = nearest([tuple(c) for c in corners], start, end)
        # min ‖Σ λ(s − c)‖ over all pairs, Σ λ = 1: non-negative least squares with a heavy last row.
        pairs = np.array([s - c for s in (start, end) for c in corners])
        heavy = 1e4
        weights = nnls(np.vstack([pairs.T, heavy * np.ones(len(pairs))]), np.array([0, 0, 0, heavy]))[0]
        truth = np.linalg.norm(weights @ pairs) / weights.sum()
        assert np.linalg.norm(apart) == pytest.approx(truth, abs=1e-6)
        assert sum(c.weight for c in carried) == pytest.approx(1.0)
