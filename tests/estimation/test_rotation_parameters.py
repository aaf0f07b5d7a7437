import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from omniservo.geometry.quaternions import (
    CAYLEY,
    QUATERNION,
    parameters_from_rotation,
    rotation_differential,
    rotation_from_parameters,
    turn_quaternion,
)

ANGLES = (0.0, 1e-9, 1e-3, 1.0, 3.0, math.pi - 1e-6)


def rotations():
    rng = np.random.default_rng(0)
    for angle in ANGLES:
        for axis in (*np.eye(3), *rng.normal(size=(5, 3))):
            yield Rotation.from_rotvec(angle * axis / np.linalg.norm(axis))


def matrix_of(kind, s):
    matrix = np.empty((3, 3))
    rotation_from_parameters(kind, s, matrix)
    return matrix


@pytest.mark.parametrize("kind", [QUATERNION, CAYLEY])
def test_parameters_and_rotation_are_inverse_to_each_other(kind):
    for r in rotations():
        s = parameters_from_rotation(kind, r.as_matrix())
        np.testing.assert_allclose(matrix_of(kind, s), r.as_matrix(), atol=2e-9 if kind == CAYLEY else 1e-14)


def test_a_half_turn_has_a_quaternion():
    for axis in np.eye(3):
        r = Rotation.from_rotvec(math.pi * axis).as_matrix()
        np.testing.assert_allclose(
            matrix_of(QUATERNION, parameters_from_rotation(QUATERNION, r)), r, atol=1e-15
        )


def test_quaternion_is_scipys_with_the_scalar_last_and_not_negative():
    for r in rotations():
        q = parameters_from_rotation(QUATERNION, r.as_matrix())
        assert q[3] >= 0
        np.testing.assert_allclose(q, r.as_quat(canonical=True), atol=1e-9)


def test_cayley_vector_is_that_of_the_paper_18_and_21():
    r = Rotation.from_rotvec([0.4, -0.9, 0.3]).as_matrix()
    skew = (r - np.eye(3)) @ np.linalg.inv(r + np.eye(3))
    a = parameters_from_rotation(CAYLEY, r)
    np.testing.assert_allclose(a, [skew[2, 1], skew[0, 2], skew[1, 0]], atol=1e-15)
    cross = np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])
    np.testing.assert_allclose(np.linalg.inv(np.eye(3) - cross) @ (np.eye(3) + cross), r, atol=1e-15)


@pytest.mark.parametrize("kind", [QUATERNION, CAYLEY])
def test_differential_agrees_with_finite_differences_also_off_the_unit_sphere(kind):
    for r in rotations():
        if kind == CAYLEY and r.magnitude() > 3.1:
            continue
        s = parameters_from_rotation(kind, r.as_matrix())
        s = 1.7 * s if kind == QUATERNION else s
        differential = np.zeros((3, 4))
        rotation_differential(kind, s, differential)
        start = Rotation.from_matrix(matrix_of(kind, s))
        step = 1e-6 * max(1.0, float(np.abs(s).max()))
        for i in range(len(s)):
            forth, back = s.copy(), s.copy()
            forth[i] += step
            back[i] -= step
            difference = (
                (start.inv() * Rotation.from_matrix(matrix_of(kind, forth))).as_rotvec()
                - (start.inv() * Rotation.from_matrix(matrix_of(kind, back))).as_rotvec()
            ) / (2 * step)
            np.testing.assert_allclose(differential[:, i], difference, atol=1e-7)


def test_turning_a_quaternion_is_multiplication_on_the_right():
    for r in rotations():
        for vector in ([0.0, 0.0, 0.0], [1e-8, 0.0, 0.0], [0.3, -2.0, 0.5]):
            turned = turn_quaternion(r.as_quat(), *vector)
            np.testing.assert_allclose(
                Rotation.from_quat(turned).as_matrix(),
                (r * Rotation.from_rotvec(vector)).as_matrix(),
                atol=1e-14,
            )
