"""The arc tangent without branches, against NumPy's and mpmath's."""

import math

import mpmath
import numpy as np
import pytest

from omniservo.cameras.models.arc_tangent import arc_tangent
from omniservo.geometry.kernel import kernel


@kernel
def _arc_tangents(y, x, angles):
    for i in range(len(angles)):
        angles[i] = arc_tangent(y[i], x[i])


def arc_tangents(y, x):
    angles = np.empty(len(y))
    _arc_tangents(np.asarray(y, dtype=float), np.asarray(x, dtype=float), angles)
    return angles


def test_it_is_atan2_to_1e_15_in_every_direction_and_at_every_length():
    rng = np.random.default_rng(0)
    angle, length = rng.uniform(-np.pi, np.pi, 200_000), 10.0 ** rng.uniform(-100, 100, 200_000)
    y, x = length * np.sin(angle), length * np.cos(angle)
    assert np.abs(arc_tangents(y, x) - np.arctan2(y, x)).max() < 1e-15


def test_small_angles_keep_all_their_digits():
    y = np.logspace(-300, -0.4, 3000)
    assert np.abs(arc_tangents(y, np.ones(3000)) / np.arctan(y) - 1.0).max() < 1e-15


def test_it_is_the_true_angle_where_its_pieces_meet():
    turn = np.tan(np.arange(1, 8) * np.pi / 16)
    y = np.concatenate([turn * (1 + k * 2.3e-16) for k in range(-3, 4)])
    true = np.array([float(mpmath.atan(mpmath.mpf(t))) for t in y])
    for sign in (1.0, -1.0):
        assert np.abs(arc_tangents(sign * y, np.ones(len(y))) - sign * true).max() < 1e-15


def test_axes_and_what_is_no_number():
    y, x = [0.0, 0.0, 1.0, -1.0, 0.0, 1e-160], [0.0, -1.0, 0.0, 0.0, 1.0, -1.0]
    assert arc_tangents(y, x) == pytest.approx(
        [0.0, math.pi, math.pi / 2, -math.pi / 2, 0.0, math.pi], abs=1e-15
    )
    assert np.isnan(arc_tangents([math.nan, 1.0, 0.0, math.nan], [1.0, math.nan, math.nan, 0.0])).all()
