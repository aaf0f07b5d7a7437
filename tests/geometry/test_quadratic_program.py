"""Quadratic programs against SciPy and against their own optimality conditions."""

import numpy as np
from scipy.optimize import minimize, nnls

from omniservo.geometry.quadratic_program import nonnegative_minimum, quadratic_step


def random_program(rng: np.random.Generator, n: int, m: int):
    root = rng.normal(size=(n, n))
    hessian = root @ root.T + 0.1 * np.eye(n)
    inside = rng.normal(size=n)
    rows = rng.normal(size=(m, n))
    right = rows @ inside - rng.uniform(0.0, 0.5, m)
    return hessian, rng.normal(size=n) * 3.0, rows, right


def solve(hessian, gradient, rows, right):
    step, multipliers = np.empty(len(gradient)), np.empty(len(right))
    assert quadratic_step(hessian, gradient, rows, right, step, multipliers)
    return step, multipliers


def test_the_optimality_conditions_hold_and_scipy_finds_no_less():
    rng = np.random.default_rng(1)
    active = 0
    for case in range(60):
        n = 2 + case % 20
        hessian, gradient, rows, right = random_program(rng, n, 1 + case % 30)
        step, multipliers = solve(hessian, gradient, rows, right)
        slack = rows @ step - right
        scale = 1.0 + abs(multipliers).max()
        assert slack.min() > -1e-7 * scale
        assert multipliers.min() >= 0.0
        assert abs(slack @ multipliers) < 1e-6 * scale
        assert np.allclose(hessian @ step + gradient, rows.T @ multipliers, atol=1e-8 * scale)
        active += (multipliers > 0.0).sum()
        if n <= 8:
            found = minimize(
                lambda d, h=hessian, c=gradient: 0.5 * d @ h @ d + c @ d,
                np.zeros(n),
                jac=lambda d, h=hessian, c=gradient: h @ d + c,
                constraints={"type": "ineq", "fun": lambda d, a=rows, b=right: a @ d - b},
                method="SLSQP",
                options={"ftol": 1e-12, "maxiter": 500},
            )
            value = 0.5 * step @ hessian @ step + gradient @ step
            assert value <= found.fun + 1e-5 * (1.0 + abs(found.fun))
    assert active > 100


def test_the_dual_is_scipys_nonnegative_least_squares():
    rng = np.random.default_rng(2)
    for case in range(50):
        m = 1 + case % 12
        a, b = rng.normal(size=(m + 3, m)), rng.normal(size=m + 3)
        multipliers = np.empty(m)
        nonnegative_minimum(a.T @ a, a.T @ b, multipliers)
        assert np.allclose(multipliers, nnls(a, b)[0], atol=1e-7)


def test_rows_nearly_alike_and_rows_twice_do_not_disturb():
    rng = np.random.default_rng(3)
    for _ in range(50):
        hessian, gradient, rows, right = random_program(rng, 7, 5)
        once, _ = solve(hessian, gradient, rows, right)
        close = rows + 1e-9 * rng.normal(size=rows.shape)
        twice, _ = solve(hessian, gradient, np.vstack([rows, rows, close]), np.tile(right, 3))
        assert np.allclose(once, twice, atol=1e-5)


def test_contradicting_rows_share_what_they_miss():
    rows, right = np.array([[1.0, 0.0], [-1.0, 0.0]]), np.array([1.0, 1.0])
    step, _ = solve(np.eye(2), np.array([0.0, -2.0]), rows, right)
    assert np.allclose(step, [0.0, 2.0], atol=1e-6)


def test_without_rows_it_is_newtons_step_and_a_hessian_that_is_not_positive_is_refused():
    step, _ = solve(np.diag([2.0, 4.0]), np.array([2.0, 2.0]), np.empty((0, 2)), np.empty(0))
    assert np.allclose(step, [-1.0, -0.5])
    assert not quadratic_step(
        np.diag([1.0, -1.0]), np.ones(2), np.empty((0, 2)), np.empty(0), np.empty(2), np.empty(0)
    )
