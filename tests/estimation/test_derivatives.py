"""Every analytic derivative of the two-view refinement against finite differences, and the small solvers."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from omniservo.estimation.matches import Matches
from omniservo.estimation.refinement import epipolar_refinement, joint_refinement, normal_blocks
from omniservo.estimation.refinement.epipolar_refinement import essential_matrix, sampson_cost
from omniservo.geometry.linear_systems import factor_cholesky, solve_factored, symmetric_eigen


@pytest.fixture
def view(camera, make_scene):
    rng = np.random.default_rng(11)
    scene = make_scene(rng, camera=camera, turn=0.2)
    initial, goal = scene.noisy(rng, 2.0)
    return scene, Matches.of_pixels(camera, np.hstack([initial, goal]))


def test_bearings_and_their_derivatives_are_those_of_the_camera(view):
    scene, matches = view
    bearings, jacobians, valid = scene.camera.unproject_jacobian(matches.pixels.reshape(-1, 2))
    assert valid.all()
    np.testing.assert_allclose(matches.bearings.reshape(-1, 3), bearings, atol=1e-12)
    np.testing.assert_allclose(matches.jacobians.reshape(-1, 3, 2), jacobians, atol=1e-9)


def test_sampson_distance_is_the_form_over_the_length_of_its_gradient(view):
    scene, matches = view
    e = np.empty((3, 3))
    t = scene.translation / np.linalg.norm(scene.translation)
    essential_matrix(scene.rotation.as_matrix(), t, e)

    def form(pixels):
        b, _ = scene.camera.unproject(pixels.reshape(-1, 2))
        return np.einsum("ni,ij,nj->n", b[::2], e, b[1::2])

    steps = [np.eye(4)[i] * 1e-4 for i in range(4)]
    gradient = np.array([(form(matches.pixels + s) - form(matches.pixels - s)) / 2e-4 for s in steps])
    expected = form(matches.pixels) ** 2 / (gradient**2).sum(axis=0)
    assert sampson_cost(matches.bearings, matches.jacobians, math.inf, e) == pytest.approx(
        expected.sum(), rel=1e-5
    )


def test_sampson_gradient_agrees_with_finite_differences(view):
    scene, matches = view
    r, t = scene.rotation.as_matrix(), scene.translation / np.linalg.norm(scene.translation)
    tangents, e = np.empty((2, 3)), np.empty((3, 3))
    epipolar_refinement.tangent_plane(t, tangents)
    essential_matrix(r, t, e)
    for loss_scale in (math.inf, 1.5):
        normal, gradient = np.empty((5, 5)), np.empty(5)
        epipolar_refinement.accumulate_distances(
            matches.bearings, matches.jacobians, loss_scale, r, e, tangents, normal, gradient
        )

        def cost(step, loss_scale=loss_scale):
            trial_r, trial_t, trial_e = np.empty((3, 3)), np.empty(3), np.empty((3, 3))
            epipolar_refinement.move_motion(r, t, tangents, step, trial_r, trial_t)
            essential_matrix(trial_r, trial_t, trial_e)
            return sampson_cost(matches.bearings, matches.jacobians, loss_scale, trial_e)

        difference = [(cost(s) - cost(-s)) / 2e-6 for s in 1e-6 * np.eye(5)]
        np.testing.assert_allclose(2 * gradient, difference, rtol=1e-5, atol=1e-4)


def test_joint_derivatives_agree_with_finite_differences(view):
    scene, matches = view
    r, t, points = scene.rotation.as_matrix(), np.array(scene.translation), scene.points

    def residual(j, dt, delta, dh):
        turned = (scene.rotation * Rotation.from_rotvec(delta)).as_matrix()
        moved = points.copy()
        moved[j] += dh
        out = np.empty_like(matches.pixels)
        joint_refinement.write_residuals(matches.parameters, matches.pixels, turned, t + dt, moved, out)
        return out[j]

    rows = normal_blocks.empty_rows()
    e, to_point, to_motion = rows
    zero, h = np.zeros(3), 1e-6
    for j in range(len(points)):
        assert normal_blocks.linearise_point(
            matches.parameters, matches.pixels, matches.weights, j, r, t, points, rows
        )
        np.testing.assert_allclose(e, residual(j, zero, zero, zero), atol=1e-9)
        for i, s in enumerate(h * np.eye(3)):
            point = (residual(j, zero, zero, s) - residual(j, zero, zero, -s)) / (2 * h)
            shift = (residual(j, s, zero, zero) - residual(j, -s, zero, zero)) / (2 * h)
            turn = (residual(j, zero, s, zero) - residual(j, zero, -s, zero)) / (2 * h)
            np.testing.assert_allclose(to_point[:, i], point, rtol=1e-5, atol=1e-3)
            np.testing.assert_allclose(to_motion[:, i], shift[2:], rtol=1e-5, atol=1e-3)
            np.testing.assert_allclose(to_motion[:, 3 + i], turn[2:], rtol=1e-5, atol=1e-3)
            assert np.abs(shift[:2]).max() == 0.0


def test_blocks_are_those_of_the_dense_normal_equations(view):
    scene, matches = view
    r, t, points = scene.rotation.as_matrix(), np.array(scene.translation), scene.points
    n = len(points)
    dense, residuals = np.zeros((4 * n, 6 + 3 * n)), np.zeros(4 * n)
    rows = normal_blocks.empty_rows()
    for j in range(n):
        normal_blocks.linearise_point(
            matches.parameters, matches.pixels, matches.weights, j, r, t, points, rows
        )
        dense[4 * j + 2 : 4 * j + 4, :6] = rows.to_motion
        dense[4 * j : 4 * j + 4, 6 + 3 * j : 9 + 3 * j] = rows.to_point
        residuals[4 * j : 4 * j + 4] = rows.residual
    blocks = normal_blocks.empty_blocks(n)
    cost = normal_blocks.linearise(matches.parameters, matches.pixels, matches.weights, r, t, points, blocks)
    normal, gradient = dense.T @ dense, dense.T @ residuals
    assert cost == pytest.approx(residuals @ residuals)
    np.testing.assert_allclose(np.tril(blocks.motion), np.tril(normal[:6, :6]), rtol=1e-12, atol=1e-6)
    np.testing.assert_allclose(blocks.motion_gradient, gradient[:6], rtol=1e-10, atol=1e-6)
    np.testing.assert_allclose(blocks.point_gradients.ravel(), gradient[6:], rtol=1e-10, atol=1e-6)
    np.testing.assert_allclose(blocks.mixed[3].reshape(6, 3), normal[:6, 15:18], rtol=1e-12, atol=1e-6)
    np.testing.assert_allclose(blocks.points[3], normal[15:18, 15:18][np.tril_indices(3)], rtol=1e-12)


def test_cholesky_solves_and_refuses_what_is_not_positive_definite():
    rng = np.random.default_rng(0)
    a = rng.normal(size=(9, 6))
    matrix, right = a.T @ a, rng.normal(size=6)
    factor, x = matrix.copy(), right.copy()
    assert factor_cholesky(factor, 6, 1e-12)
    solve_factored(factor, 6, x)
    np.testing.assert_allclose(x, np.linalg.solve(matrix, right), rtol=1e-9)
    assert not factor_cholesky(a[:5].T @ a[:5], 6, 1e-12)
    assert not factor_cholesky(-np.eye(6), 6, 1e-12)
    assert not factor_cholesky(np.full((6, 6), np.nan), 6, 1e-12)


@pytest.mark.parametrize("size", [3, 9])
def test_eigenvectors_agree_with_lapack_for_repeated_values_too(size):
    rng = np.random.default_rng(size)
    basis, _ = np.linalg.qr(rng.normal(size=(size, size)))
    for values in (np.arange(size) - 1.0, np.r_[np.zeros(size - 1), 5.0], np.zeros(size)):
        matrix = basis @ np.diag(values) @ basis.T
        matrix = 0.5 * (matrix + matrix.T)
        found, vectors = symmetric_eigen(matrix)
        np.testing.assert_allclose(found, np.sort(values), atol=1e-13)
        np.testing.assert_allclose(vectors.T @ vectors, np.eye(size), atol=1e-13)
        np.testing.assert_allclose(vectors @ np.diag(found) @ vectors.T, matrix, atol=1e-13)
