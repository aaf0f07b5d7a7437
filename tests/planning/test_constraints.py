"""Every family's proof against dense sampling: planted violations, witnesses, tightness."""

import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from scipy.spatial.transform import Rotation

from omniservo.geometry.polynomial import bernstein_from_power, magnitude
from omniservo.geometry.subdivision import PROVEN, REFUTED, UNDECIDED
from omniservo.planning.bernstein_path import camera_controls, camera_count, squares
from omniservo.planning.constraints.collision import prove_outside_ball
from omniservo.planning.constraints.occlusion import prove_clear_sights
from omniservo.planning.constraints.rotation import prove_rotation
from omniservo.planning.constraints.visibility import prove_visible
from omniservo.planning.constraints.workspace import prove_wall

W = np.linspace(0.0, 1.0, 401)
NO_DISC, NO_LIMITS = np.zeros(0), np.zeros((0, 4))


def random_path(rng: np.random.Generator, sigma: int, tau: int) -> tuple[np.ndarray, np.ndarray]:
    """Power coefficients from the identity, bent as planned paths are."""
    phi = rng.normal(size=(4, sigma + 1)) * 0.3
    phi[:, -1] = [0.0, 0.0, 0.0, 1.0]
    t = rng.normal(size=(3, tau + 1)) * 0.2
    t[:, -1] = 0.0
    return phi, t


def horner(coefficients: np.ndarray, w: np.ndarray) -> np.ndarray:
    return np.array([np.polyval(row, w) for row in coefficients]).T


def camera_points(phi: np.ndarray, t: np.ndarray, h: np.ndarray, w: np.ndarray) -> np.ndarray:
    turned = Rotation.from_quat(horner(phi, np.atleast_1d(w)))
    return turned.inv().apply(h - horner(t, np.atleast_1d(w)))


def smallest(value, w=W) -> float:
    """Smallest value over [0, 1]: samples, then a bounded search around the best of them."""
    values = value(w)
    if not np.isfinite(values).all():
        return -np.inf
    k = int(np.argmin(values))
    low, high = w[max(0, k - 1)], w[min(len(w) - 1, k + 1)]
    options = {"xatol": 1e-12}
    fine = minimize_scalar(
        lambda x: float(value(np.array([x]))[0]), bounds=(low, high), method="bounded", options=options
    )
    return min(float(values[k]), float(fine.fun))


def judge_view(phi, t, h, limits, disc) -> tuple[int, float]:
    controls, errors = camera_controls(phi, t, np.ascontiguousarray(h[None]))
    count = float(camera_count(phi.shape[1] - 1, t.shape[1] - 1))
    return prove_visible(controls, errors, count, limits, disc)[:2]


@pytest.mark.parametrize(("sigma", "tau"), [(1, 1), (2, 2), (3, 1), (4, 5)])
def test_camera_controls_bound_the_camera_points(sigma, tau):
    rng = np.random.default_rng(sigma * 10 + tau)
    phi, t = random_path(rng, sigma, tau)
    points = rng.normal(size=(5, 3))
    controls, errors = camera_controls(phi, t, points)
    square = (horner(phi, W) ** 2).sum(axis=1)
    degree = 2 * sigma + tau
    basis = np.array([np.polyval(_bernstein(degree, k), W) for k in range(degree + 1)])
    for j in range(5):
        direct = square[:, None] * camera_points(phi, t, points[j], W)
        assert np.allclose((controls[j] @ basis).T, direct, atol=1e-12)
        assert errors[j] * camera_count(sigma, tau) < 1e-12


def _bernstein(n: int, k: int) -> np.ndarray:
    controls = np.zeros((1, n + 1))
    controls[0, k] = 1.0
    from omniservo.geometry.polynomial import power_from_bernstein

    return power_from_bernstein(controls)[0]


@pytest.mark.slow
@pytest.mark.parametrize("relative", [1e-4, 1e-9])
def test_an_image_limit_is_decided_on_either_side_of_the_truth(relative):
    """Every sign of κ, targets all round the camera."""
    rng = np.random.default_rng(1)
    signs = {-1: 0, 1: 0}
    for case in range(300):
        phi, t = random_path(rng, *((2, 2), (1, 2), (3, 3))[case % 3])
        h = rng.normal(size=3)
        n = rng.normal(size=3)
        n /= np.linalg.norm(n)

        def bearing_gap(w, phi=phi, t=t, h=h, n=n):
            c = camera_points(phi, t, h, w)
            return -(c @ n) / np.linalg.norm(c, axis=1)

        least = smallest(bearing_gap)
        if np.linalg.norm(camera_points(phi, t, h, W), axis=1).min() < 0.02:
            continue
        signs[int(np.sign(-least))] += 1
        outside = np.array([[*n, -least - relative]])
        inside = np.array([[*n, -least + max(relative, 1e-8)]])
        status, w = judge_view(phi, t, h, outside, NO_DISC)
        assert status == REFUTED
        assert bearing_gap(np.array([w]))[0] < least + relative
        assert judge_view(phi, t, h, inside, NO_DISC)[0] == PROVEN
    assert min(signs.values()) > 50


def test_a_half_space_limit_is_decided_on_either_side_of_the_truth():
    """κ = 0: the edges of a perspective image."""
    rng = np.random.default_rng(2)
    zero = 0
    for _ in range(100):
        phi, t = random_path(rng, 2, 2)
        h = np.array([0.0, 0.0, 1.5]) + rng.normal(size=3) * 0.2

        def slope(w, phi=phi, t=t, h=h):
            c = camera_points(phi, t, h, w)
            return np.where(c[:, 2] > 0, c[:, 0] / c[:, 2], -np.inf)

        least = smallest(slope)
        if not np.isfinite(least):
            continue
        zero += 1
        domain = [0.0, 0.0, -1.0, 0.0]
        for gap, expected in ((1e-8, PROVEN), (-1e-9, REFUTED)):
            limits = np.array([domain, [-1.0, 0.0, least - gap, 0.0]])
            assert judge_view(phi, t, h, limits, NO_DISC)[0] == expected
    assert zero > 50


@pytest.mark.parametrize("xi", [0.0, 0.8, 1.0, 1.291, 2.2])
def test_a_dead_zone_off_the_centre_is_decided_on_either_side_of_the_truth(xi):
    rng = np.random.default_rng(int(10 * xi))
    fx, fy, skew = 300.0, -310.0, 3.0
    decided = 0
    while decided < 60:
        phi, t = random_path(rng, 2, 2)
        h = np.array([0.0, 0.0, 1.2]) + rng.normal(size=3) * 0.4
        cu, cv = rng.normal(size=2) * 40.0

        def away(w, phi=phi, t=t, h=h, cu=cu, cv=cv):
            c = camera_points(phi, t, h, w)
            d = c[:, 2] + xi * np.linalg.norm(c, axis=1)
            pixel = np.array([(fx * c[:, 0] + skew * c[:, 1]) / d + cu, fy * c[:, 1] / d + cv])
            return np.where(d > 0.1, np.hypot(*pixel), -np.inf)

        least = smallest(away)
        if not least > 5.0:
            continue
        decided += 1
        for radius, expected in ((least - 1e-6, PROVEN), (least + 1e-7, REFUTED)):
            disc = np.array([fx, skew, fy, cu, cv, radius, xi])
            status, w = judge_view(phi, t, h, NO_LIMITS, disc)
            assert status == expected
            if status == REFUTED:
                assert away(np.array([w]))[0] < radius


@pytest.mark.parametrize("relative", [1e-4, 1e-9])
def test_a_clearance_is_decided_on_either_side_of_the_truth(relative):
    rng = np.random.default_rng(3)
    for case in range(300):
        _, t = random_path(rng, 1, 1 + case % 5)
        o = rng.normal(size=3) * 0.3

        def apart(w, t=t, o=o):
            return np.linalg.norm(horner(t, w) - o, axis=1)

        least = smallest(apart)
        if least < 0.05:
            continue
        square, raised = squares(t)
        status, w = prove_outside_ball(square, raised, magnitude(t), o, least * (1.0 + relative))
        assert status == REFUTED
        assert apart(np.array([w]))[0] < least * (1.0 + relative)
        status, _ = prove_outside_ball(square, raised, magnitude(t), o, least * (1.0 - relative))
        assert status == PROVEN


def test_an_occlusion_is_decided_on_either_side_of_the_truth():
    rng = np.random.default_rng(4)
    decided = 0
    while decided < 300:
        _, t = random_path(rng, 1, 1 + decided % 4)
        h = rng.normal(size=3)
        o = 0.5 * h + rng.normal(size=3) * 0.2

        def sight(w, t=t, h=h, o=o):
            at = horner(t, w)
            line, p = h - at, at - o
            s = np.clip(-(p * line).sum(axis=1) / (line**2).sum(axis=1), 0.0, 1.0)
            return np.linalg.norm(p + s[:, None] * line, axis=1)

        least = smallest(sight)
        if least < 0.02:
            continue
        decided += 1
        centre = bernstein_from_power(t)
        for radius, expected in ((least * (1 - 1e-7), PROVEN), (least * (1 + 1e-9), REFUTED)):
            status, w, _ = prove_clear_sights(centre, magnitude(t), h[None], o, radius)
            assert status == expected
            if status == REFUTED:
                assert sight(np.array([w]))[0] < radius


def test_many_lines_of_sight_are_decided_as_one_by_one():
    rng = np.random.default_rng(8)
    seen = {PROVEN: 0, REFUTED: 0}
    for _ in range(200):
        _, t = random_path(rng, 1, 2)
        points = rng.normal(size=(6, 3)) * 0.3 + [0.0, 0.0, 1.0]
        o, centre = rng.normal(size=3) * 0.3 + [0.0, 0.0, 0.5], bernstein_from_power(t)
        radius = rng.uniform(0.02, 0.2)
        status, w, j = prove_clear_sights(centre, magnitude(t), points, o, radius)
        single = [prove_clear_sights(centre, magnitude(t), points[i : i + 1], o, radius)[0] for i in range(6)]
        assert status == min(single)
        seen[status] += 1
        if status == REFUTED:
            at = horner(t, np.array([w]))[0]
            line, p = points[j] - at, at - o
            s = np.clip(-(p @ line) / (line @ line), 0.0, 1.0)
            assert np.linalg.norm(p + s * line) < radius
    assert min(seen.values()) > 20


def test_the_plane_form_of_occlusion_agrees_with_the_polynomial_form():
    """A ≥ 0 and C ≥ 0 and (B ≥ 0 or AC − B² ≥ 0) at a standing camera."""
    rng = np.random.default_rng(5)
    for _ in range(500):
        p, q = rng.normal(size=3), rng.normal(size=3)
        r = rng.uniform(0.0, 1.0)
        a, b, c = p @ p - r * r, p @ q - r * r, q @ q - r * r
        clear = a >= 0 and c >= 0 and (b >= 0 or a * c - b * b >= 0)
        standing = np.ascontiguousarray(p[:, None])
        status, _, _ = prove_clear_sights(standing, abs(p).max(), q[None], np.zeros(3), r)
        assert (status == PROVEN) == clear


def test_a_wall_is_decided_on_either_side_of_the_truth():
    rng = np.random.default_rng(6)
    for case in range(200):
        _, t = random_path(rng, 1, 1 + case % 4)
        axis = case % 3
        low = smallest(lambda w, t=t, axis=axis: horner(t, w)[:, axis])
        controls, size = bernstein_from_power(t), magnitude(t)
        assert prove_wall(controls, size, 0, axis, low - 1e-9)[0] == PROVEN
        assert prove_wall(controls, size, 0, axis, low + 1e-10)[0] == REFUTED
        high = -smallest(lambda w, t=t, axis=axis: -horner(t, w)[:, axis])
        assert prove_wall(controls, size, 1, axis, high + 1e-9)[0] == PROVEN
        assert prove_wall(controls, size, 1, axis, high - 1e-10)[0] == REFUTED
    assert prove_wall(controls, size, 0, 0, -np.inf)[0] == PROVEN


def test_a_quaternion_that_vanishes_is_refuted_and_one_that_does_not_is_proven():
    through_zero = np.array([[0.0, 0.0], [0.0, 0.0], [0.0, 0.0], [-2.0, 1.0]])
    assert prove_rotation(through_zero, 0.01)[0] == REFUTED
    rng = np.random.default_rng(7)
    for _ in range(100):
        phi, _ = random_path(rng, 2, 1)
        least = smallest(lambda w, phi=phi: (horner(phi, w) ** 2).sum(axis=1))
        assert prove_rotation(phi, least - 1e-9)[0] == PROVEN
        assert prove_rotation(phi, least + 1e-10)[0] == REFUTED


def test_a_camera_that_runs_through_the_point_is_never_proven():
    """At c = 0 every cone reads 0 ≤ 0."""
    phi = np.array([[0.0, 0.0], [0.0, 0.0], [0.0, 0.0], [0.0, 1.0]])
    t = np.array([[0.0, 0.0], [0.0, 0.0], [1.0, 0.0]])
    limits = np.array([[0.0, 0.0, -1.0, 1.0]])
    assert judge_view(phi, t, np.array([0.0, 0.0, 0.5]), limits, NO_DISC)[0] != PROVEN


def test_the_domain_of_the_model_is_open():
    """A point that stays exactly on the rim is not proven, and not refuted."""
    phi = np.array([[0.0, 0.0], [0.0, 0.0], [0.0, 0.0], [0.0, 1.0]])
    t = np.zeros((3, 2))
    limits = np.array([[0.0, 0.0, -1.0, 0.6]])
    assert judge_view(phi, t, np.array([0.8, 0.0, -0.6]), limits, NO_DISC)[0] == UNDECIDED
