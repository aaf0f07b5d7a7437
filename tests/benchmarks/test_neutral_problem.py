"""What the benchmark's peers are given: values, exact derivatives, energy, the same answers as ours."""

import numpy as np
import pytest
from scipy.integrate import quad_vec
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.cameras import preset
from omniservo.planning import Box, Degrees, PlanningProblem, Sphere, certify

pytest.importorskip("benchmarks.comparisons.planning", reason="benchmarks/ is not part of this copy")

from benchmarks.comparisons.planning.neutral import neutral_of
from benchmarks.comparisons.planning.path_space import PathSpace
from benchmarks.comparisons.planning.pose_check import FAMILIES, least_values
from benchmarks.comparisons.planning.samples import Samples

W = np.linspace(0.0, 1.0, 21)


def problem(camera: str, *, boxes: bool = False, occlusion: bool = False) -> PlanningProblem:
    rng = np.random.default_rng(7)
    goal = RigidTransform.from_components([0.12, -0.05, 0.2], Rotation.from_rotvec([0.2, -0.3, 0.4]))
    obstacles: list[Sphere | Box] = [Sphere([0.05, -0.02, 0.1], 0.02), Sphere([0.3, 0.2, 0.1])]
    if boxes:
        turn = Rotation.from_rotvec([0.3, 0.5, 0.1]).as_quat()
        obstacles += [
            Box([0.06, -0.02, 0.12], [0.05, 0.04, 0.03], turn),
            Box([0.3, 0.0, 0.1], [0.1] * 3, turn),
        ]
    points = np.array([0.1, 0.05, 0.6]) + rng.uniform(-0.1, 0.1, (9, 3))
    margins = {"clearance": 0.03, "least_distance": 0.03, "visibility_margin": 2.0}
    return PlanningProblem(
        preset(camera), points, goal, tuple(obstacles), occlusion=occlusion, degrees=Degrees(3, 3), **margins
    )


PROBLEMS = {
    "fisheye": problem("fe185"),
    "boxes": problem("perspective", boxes=True),
    "dead zone": problem("para-catadioptric"),
    "occlusion": problem("fe185", occlusion=True),
}


@pytest.mark.parametrize("kind", PROBLEMS)
def test_derivatives_are_those_of_central_differences(kind: str) -> None:
    space = PathSpace(neutral_of(PROBLEMS[kind]), 3, 3)
    samples = Samples(space, W)
    x = 0.2 * np.random.default_rng(1).normal(size=space.size)
    g, jacobian = samples.linearised(x)
    np.testing.assert_array_equal(g, samples.values(x))
    steps = 1e-6 * np.eye(space.size)
    slopes = [(samples.values(x + h) - samples.values(x - h)) / 2e-6 for h in steps]
    np.testing.assert_allclose(jacobian, np.stack(slopes, axis=-1), atol=1e-7)


@pytest.mark.parametrize("kind", PROBLEMS)
def test_compiled_values_are_those_of_numpy(kind: str) -> None:
    neutral = neutral_of(PROBLEMS[kind])
    space = PathSpace(neutral, 3, 3)
    samples = Samples(space, W)
    x = 0.2 * np.random.default_rng(2).normal(size=space.size)
    poses = samples.poses(x)
    least, worst = least_values(neutral, poses.phi, poses.t)
    g = samples.values(x)[:, :-1]  # without the rotation's own
    assert least.min() == pytest.approx(g.min(), abs=1e-12)
    assert worst == np.argmin(g.min(axis=1))


@pytest.mark.parametrize("kind", PROBLEMS)
def test_values_have_the_sign_of_the_certificate(kind: str) -> None:
    planned = PROBLEMS[kind]
    neutral = neutral_of(planned)
    space = PathSpace(neutral, 2, 2)
    samples, signs = Samples(space, np.linspace(0.0, 1.0, 2001)), set()
    for x in 0.25 * np.random.default_rng(3).normal(size=(12, space.size)):
        verdict, certificate = certify(planned, space.path(x))
        poses = samples.poses(x)
        least = dict(zip(FAMILIES, least_values(neutral, poses.phi, poses.t)[0], strict=True))
        for name, value in least.items():
            margins = [c.margin for c in certificate.constraints if c.name.startswith(name)]
            margins += [
                c.margin for c in certificate.constraints if name == "visibility" and "domain" in c.name
            ]
            if np.isfinite(value) and abs(value) > 1e-3:
                assert (value > 0) == (min(margins) > 0), name
                signs.add(value > 0)
        assert verdict in ("certified", "refuted")
    assert signs == {True, False}


def test_bending_is_the_integral_of_squared_second_derivatives() -> None:
    neutral = neutral_of(PROBLEMS["fisheye"])
    space = PathSpace(neutral, 3, 4)
    x = np.random.default_rng(4).normal(size=space.size)
    path = space.path(x)

    def integrand(w: float) -> float:
        turn = 0.0
        for row, unit in [(r, 1.0) for r in path.rotation] + [(r, neutral.ell) for r in path.translation]:
            turn += (np.polyval(np.polyder(row, 2), w) / unit) ** 2
        return float(turn)

    assert space.energy(x) == pytest.approx(quad_vec(integrand, 0.0, 1.0)[0], rel=1e-9)


def test_every_start_ends_at_the_goal_and_the_first_is_the_straight_line() -> None:
    planned = PROBLEMS["fisheye"]
    space = PathSpace(neutral_of(planned), 2, 3)
    starts = list(space.starts(5))
    assert not starts[0].any()
    for x in starts:
        end = space.path(x)(1.0)
        np.testing.assert_allclose(end.translation, planned.goal_translation, atol=1e-12)
        assert (end.rotation.inv() * planned.initial_T_goal.rotation).magnitude() < 1e-9
