"""What makes a matrix a covariance, whatever the units of its rows."""

import numpy as np
import pytest

from omniservo.geometry.covariances import is_covariance

UNIT = np.diag([1e-4] * 3 + [1e-1] * 3)
"""of rows: tenths of millimetres, tens of milliradians"""


@pytest.mark.parametrize("unit", [np.eye(6), 1e-6 * np.eye(6), UNIT], ids=["1", "1e-6", "of two kinds"])
def test_a_covariance_is_symmetric_and_has_no_negative_eigenvalue_in_any_unit(unit):
    root = np.random.default_rng(0).standard_normal((6, 4))  # of rank 4
    matrix = unit @ root @ root.T @ unit
    assert is_covariance(matrix)
    assert is_covariance(np.zeros((6, 6)))
    assert is_covariance(np.array([[float(f"{x:.6g}") for x in row] for row in matrix]))
    assert not is_covariance(np.triu(matrix))
    assert not is_covariance(-matrix)
    assert not is_covariance(unit @ np.diag([1.0, 1, 1, 1, 1, -1e-12]) @ unit)
    assert not is_covariance(unit @ (np.eye(6) + 1.1 * (np.eye(6, k=1) + np.eye(6, k=-1))) @ unit)
