"""Samples executed a block at a time leave what each leaves by itself: none that misses is passed over."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.cameras import preset
from omniservo.planning import Box, PlanningProblem, Sphere, Workspace
from omniservo.planning.certificate.seen_margins import smallest_at
from omniservo.planning.problem_arrays import constraint_table_of
from omniservo.risk import Executions
from omniservo.risk.sample_blocks import LANES, resting_twists
from omniservo.risk.servo_response import servo_response

PLACES = np.array([0.0, 0.4, 1.0])
COUNT = LANES + 5
GOAL = RigidTransform.from_components([0.08, -0.03, 0.1], Rotation.from_rotvec([0.1, -0.2, 0.3]))


def straight(w):
    """A path."""
    turns = Rotation.from_rotvec(np.outer(w, GOAL.rotation.as_rotvec()))
    return RigidTransform.from_components(np.outer(w, GOAL.translation), turns)


@pytest.fixture(params=["fe185", "perspective", "distorted"])
def executions(request):
    """Points up to a decimetre off, among a ball, a box and walls, seen by a camera that is off, too."""
    rng = np.random.default_rng(94)
    camera = preset("fe185" if request.param == "distorted" else request.param)
    if request.param == "distorted":
        camera = replace(camera, distortion=(-0.02, 0.0, 0.0, 0.0))
    points = rng.uniform([-0.2, -0.2, 0.35], [0.2, 0.2, 0.6], (7, 3))
    problem = PlanningProblem(
        camera, points, GOAL, (Sphere([0.1, 0.1, 0.2], 0.01), Box([0.05, -0.1, 0.3], [0.02, 0.02, 0.02])),
        clearance=0.02, least_distance=0.3, visibility_margin=3.0, occlusion=True,
        workspace=Workspace(np.full(3, -0.5), np.full(3, 0.5)),
    )  # fmt: skip
    moved = points + 0.06 * rng.standard_normal((COUNT, 7, 3))
    return Executions(problem, moved, rng.standard_normal((COUNT, 5)) * [2.0, 2.0, 3.0, 3.0, 0.01])


def twist_alone(executions, response, k, i):
    """−J⁺(s − s_p) of one sample at one place."""
    rotation, centre = response.rotations[i], response.translations[i]
    seen = (executions.points[k] - centre) @ rotation
    gaps = seen / np.linalg.norm(seen, axis=1, keepdims=True) - response.planned[i]
    return -response.inverse[i] @ (gaps + response.lens[i] @ executions.camera[k]).ravel()


def left_alone(executions, response, k, i):
    """What every entry leaves to one sample at one place, by the function that certifies plans."""
    problem, points = executions.problem, executions.points[k]
    table, twist = constraint_table_of(problem), twist_alone(executions, response, k, i)
    x, y, z, w = phi = response.quaternions[i]
    a, b, d = 0.5 * twist[3:]
    turned = [w * a + y * d - z * b, w * b + z * a - x * d, w * d + x * b - y * a, -x * a - y * b - z * d]
    phi = phi + np.array(turned)
    turn = Rotation.from_quat(phi).as_matrix()
    centre = response.translations[i] + response.rotations[i] @ twist[:3]
    seen = (points - centre) @ turn
    distances = np.linalg.norm(seen, axis=1, keepdims=True)
    seen = seen + distances * (response.lens[i] @ executions.camera[k])
    pose = np.concatenate((turn.ravel(), centre, [phi @ phi, response.places[i]]))
    c = np.hstack((seen, 1.0 / distances))
    left = [smallest_at(e, table.constraints, table.optics, pose, c, points)[0] for e in table.table]
    if not problem.camera.is_distorted:
        return [*left, np.inf, np.inf]
    (u, v), camera = problem.camera.project(seen)[0].T, problem.camera
    border = np.min([u + 0.5, camera.width - 0.5 - u, v + 0.5, camera.height - 0.5 - v])
    return [*left, border - problem.image_margin, np.inf]


def response_of(executions):
    """At the three places."""
    problem = executions.problem
    return servo_response(problem.camera, problem.points, straight, PLACES, executions.camera.shape[1])


def test_blocks_of_samples_leave_what_every_sample_leaves_by_itself(executions):
    """Every constraint, at every place; the last block is not full."""
    response = response_of(executions)
    active = np.ones((len(PLACES), len(constraint_table_of(executions.problem).entries) + 2), dtype=np.bool_)
    each = executions._run(response, active, executions.points, executions.camera, len(PLACES))
    least = executions._run(response, active, executions.points, executions.camera, 1)[:, 0]
    expected = [[left_alone(executions, response, k, i) for i in range(3)] for k in range(COUNT)]
    np.testing.assert_allclose(each, expected, rtol=1e-6, atol=1e-9)
    np.testing.assert_array_equal(least, each.min(axis=1))
    assert ((each < 0.0).any(axis=(0, 1)) & (each > 0.0).any(axis=(0, 1))).sum() >= 3


def test_blocks_of_samples_rest_where_every_sample_does(executions):
    response, twists = response_of(executions), np.empty((len(PLACES), COUNT, 6))
    resting_twists(response, executions.points, executions.camera, twists)
    expected = [[twist_alone(executions, response, k, i) for k in range(COUNT)] for i in range(3)]
    np.testing.assert_allclose(twists, expected, atol=1e-12)
