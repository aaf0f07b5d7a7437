import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from omniservo.estimation.minimal_solvers.five_points import five_point_essentials
from omniservo.geometry.linear_systems import smallest_eigenvectors


def skew(t):
    return np.array([[0, -t[2], t[1]], [t[2], 0, -t[0]], [-t[1], t[0], 0]])


def sample(rng, around, n=5):
    """Bearings (n, 6) of random points, all around or ahead, and the essential matrix."""
    rotation = Rotation.random(rng=rng) if around else Rotation.from_rotvec(0.2 * rng.normal(size=3))
    t = rng.normal(size=3)
    t /= np.linalg.norm(t)
    points = 3.0 * rng.normal(size=(n, 3)) if around else rng.uniform([-2, -2, 3], [2, 2, 6], (n, 3))
    goal = rotation.inv().apply(points - t)
    unit = [p / np.linalg.norm(p, axis=1, keepdims=True) for p in (points, goal)]
    return np.hstack(unit), skew(t) @ rotation.as_matrix()


def solutions(bearings):
    room = np.empty((10, 3, 3))
    return room[: five_point_essentials(bearings, np.arange(5), room)]


def distance(one, other):
    return min(np.abs(one - other).max(), np.abs(one + other).max())


@pytest.mark.parametrize("around", [True, False])
def test_the_true_matrix_is_among_the_solutions_in_every_direction(around):
    rng = np.random.default_rng(81)
    errors = []
    for _ in range(300):
        bearings, essential = sample(rng, around)
        errors.append(min(distance(e, essential) for e in solutions(bearings)))
    assert np.median(errors) < 1e-12
    assert np.percentile(errors, 99) < 1e-5
    assert np.max(errors) < 1e-2  # near a double root


def test_every_solution_is_an_essential_matrix_of_all_five_matches():
    rng = np.random.default_rng(82)
    for _ in range(100):
        bearings, _ = sample(rng, True)
        for e in solutions(bearings):
            values = np.linalg.svd(e, compute_uv=False)
            np.testing.assert_allclose(values, [1.0, 1.0, 0.0], atol=1e-5)
            assert np.abs(np.einsum("ni,ij,nj->n", bearings[:, :3], e, bearings[:, 3:])).max() < 1e-12


def test_the_solutions_are_those_of_opencv():
    """OpenCV's five-point solver has the same polynomial system, eliminated in another order."""
    rng = np.random.default_rng(83)
    same = total = 0
    for _ in range(100):
        bearings, _ = sample(rng, False)
        ours = solutions(bearings)
        plane = [b[:, :2] / b[:, 2:] for b in (bearings[:, :3], bearings[:, 3:])]
        # OpenCV's order: second imageᵀ E first image
        theirs, _ = cv2.findEssentialMat(plane[1], plane[0], np.eye(3), cv2.RANSAC, 0.999, 1e-9)
        for e in np.reshape(theirs, (-1, 3, 3)):
            total += 1
            e = e * np.sqrt(2.0) / np.linalg.norm(e)
            same += min(distance(e, other) for other in ours) < 1e-5
    assert total > 90
    assert same >= 0.97 * total


def test_five_equal_matches_have_no_solution():
    bearings, _ = sample(np.random.default_rng(84), True)
    assert len(solutions(np.tile(bearings[:1], (5, 1)))) == 0


@pytest.mark.parametrize("rank", [5, 8, 9])
def test_the_smallest_eigenvectors_are_those_of_lapack(rank):
    rng = np.random.default_rng(rank)
    basis, _ = np.linalg.qr(rng.normal(size=(9, 9)))
    spectrum = np.r_[np.zeros(9 - rank), np.logspace(-4, 0, rank)]
    matrix = basis @ np.diag(spectrum) @ basis.T
    vectors, values = np.empty((9, 4)), np.empty(4)
    smallest_eigenvectors(matrix, vectors, values)
    np.testing.assert_allclose(values[:2], spectrum[:2], atol=1e-9)
    np.testing.assert_allclose(vectors.T @ vectors, np.eye(4), atol=1e-12)
    assert np.linalg.norm(matrix @ vectors[:, :2] - vectors[:, :2] * values[:2]) < 1e-8
