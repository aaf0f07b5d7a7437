"""The peers of the planning benchmark: the constraints that they see, and the examples solved."""

import dataclasses
import importlib

import numpy as np
import pytest

pytest.importorskip("benchmarks.comparisons.planning", reason="benchmarks/ is not part of this copy")

import itertools

from benchmarks.comparisons.planning.neutral import neutral_of
from benchmarks.comparisons.planning.path_space import PathSpace
from benchmarks.comparisons.planning.peers.compiled_rows import CompiledRows
from benchmarks.comparisons.planning.peers.local_search import EFFORT_WITH_MARGIN, floors
from benchmarks.comparisons.planning.peers.motion_check import motion_is_free, motion_is_free_numpy
from benchmarks.comparisons.planning.pose_check import least_values
from benchmarks.comparisons.planning.samples import Samples
from benchmarks.planning_speed import shipped_problem

from omniservo.cameras import UnifiedCamera
from omniservo.planning import Box, CameraPath, PlanningProblem, Sphere

W = np.linspace(0.05, 0.95, 5)


def crowded_problem(kind: str) -> PlanningProblem:
    """Example 1 seen past a dead zone, with spheres that hide points, or with boxes."""
    example = shipped_problem("paper-example-1")
    turned, half = np.array([0.0, 0.6, 0.0, 0.8]), 0.47 * example.goal_translation
    others = {
        "hidden": (
            Sphere(0.5 * example.points[0], 0.02),
            Sphere(0.5 * (example.points[1] + half), 0.03),
            Sphere([0.3, 0.3, 0.3], 0.0, 0.0),
        ),
        "boxes": (Box(half, [0.01, 0.03, 0.04], turned), Box(half + 0.1, [0.02, 0.03, 0.01], turned, 0.02)),
    }[kind]
    camera = UnifiedCamera.from_dict(
        example.camera.to_dict() | {"dead_zone": {"center": [300.0, 230.0], "radius": 20.0}}
    )
    obstacles = (*example.obstacles, *others)
    return dataclasses.replace(example, camera=camera, obstacles=obstacles, occlusion=kind == "hidden")


def peer(name: str, library: str):
    pytest.importorskip(library, reason=f"{library} is not installed: requirements-bench.lock")
    return importlib.import_module(f"benchmarks.comparisons.planning.peers.{name}")


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["hidden", "boxes"])
def test_compiled_rows_are_the_neutral_ones(kind):
    space = PathSpace(neutral_of(crowded_problem(kind)), 3, 2)
    plain, compiled = Samples(space, W), CompiledRows(space, W)
    rng = np.random.default_rng(1)
    for start in space.starts(4):
        x = start + 0.05 * rng.normal(size=space.size)
        g, jacobian = plain.linearised(x)
        assert compiled.shape == g.shape
        np.testing.assert_allclose(compiled.values(x), g, atol=1e-12)
        awake = rng.random(g.shape) < 0.3
        some, slopes = compiled.linearised(x, awake)
        np.testing.assert_allclose(some, g[awake], atol=1e-12)
        np.testing.assert_allclose(slopes, jacobian[awake], atol=1e-10)


@pytest.mark.parametrize("kind", ["hidden", "boxes"])
def test_casadi_rows_are_the_neutral_ones(kind):
    ca = pytest.importorskip("casadi", reason="casadi is not installed: requirements-bench.lock")
    from benchmarks.comparisons.planning.peers import ipopt_model

    space = PathSpace(neutral_of(crowded_problem(kind)), 3, 2)
    model = ipopt_model.model_of(ipopt_model.structure_of(space), W)
    look = ca.Function("g", [model.x, model.parameters], [model.g, ca.jacobian(model.g, model.x)])
    parameters = ipopt_model.parameters_of(space.neutral)
    for x in space.starts(3):
        g, jacobian = Samples(space, W).linearised(x)
        found, slopes = (np.array(part) for part in look(x, parameters))
        np.testing.assert_allclose(found.ravel(), g.ravel(), atol=1e-9)
        np.testing.assert_allclose(slopes, jacobian.reshape(-1, space.size), atol=1e-7)


def test_what_is_kept_is_at_most_half_of_what_the_ends_leave():
    space = PathSpace(neutral_of(shipped_problem("paper-example-1")), 2, 2)
    ends = Samples(space, np.array([0.0, 1.0])).values(np.zeros(space.size)).min(axis=0)
    np.testing.assert_allclose(floors(space, 0.02), np.minimum(0.02, 0.5 * ends))
    assert floors(space, 0.0).max() == 0.0


@pytest.mark.parametrize("check", [motion_is_free, motion_is_free_numpy])
def test_a_motion_is_free_or_not_wherever_the_obstacle_lies_on_it(check):
    base = dataclasses.replace(shipped_problem("paper-example-1"), obstacles=(), visibility_margin=0.0)
    start = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    end = np.array([*base.goal_translation, *base.goal_quaternion])
    assert check(neutral_of(base), start, end)
    spacing = 0.003 * neutral_of(base).ell
    for part in np.linspace(0.01, 1.0, 34):
        at = part * base.goal_translation
        for radius, free in ((0.6 * spacing, False), (0.0, True)):
            problem = dataclasses.replace(base, obstacles=(Sphere(at, radius, 0.0),))
            assert check(neutral_of(problem), start, end) == free
    back = np.array([*base.goal_translation, 0.0, 1.0, 0.0, 0.0])
    assert not check(neutral_of(base), start, back)


@pytest.mark.parametrize(("name", "library"), [("snopt", "pydrake"), ("ipopt", "casadi")])
@pytest.mark.parametrize("task", ["paper-example-1", "paper-example-2"])
def test_a_local_solver_solves_the_examples(name, library, task):
    solver, problem = peer(name, library), shipped_problem(task)
    neutral = neutral_of(problem)
    attempt = solver.solve(problem, neutral, 60.0, EFFORT_WITH_MARGIN)
    assert attempt.claimed
    assert attempt.seconds > 0.0
    assert isinstance(attempt.path, CameraPath)
    poses = attempt.path(np.linspace(0.0, 1.0, 2001))
    assert least_values(neutral, poses.rotation.as_quat(), poses.translation)[0].min() > 0.0


@pytest.mark.parametrize("function", ["solve", "solve_numpy"])
def test_rrtconnect_solves_the_first_example(function):
    planner, problem = peer("rrtconnect", "ompl"), shipped_problem("paper-example-1")
    neutral = neutral_of(problem)
    attempt = getattr(planner, function)(problem, neutral, 20.0)
    assert attempt.claimed
    line = attempt.path
    np.testing.assert_allclose(line.positions[[0, -1]], [np.zeros(3), neutral.translation], atol=1e-12)
    np.testing.assert_allclose(line.quaternions[-1], neutral.quaternion, atol=1e-12)
    poses = [np.concatenate(pair) for pair in zip(line.positions, line.quaternions, strict=True)]
    for start, end in itertools.pairwise(poses):
        assert motion_is_free(neutral, start, end)
