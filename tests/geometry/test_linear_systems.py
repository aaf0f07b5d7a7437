"""Small symmetric systems against LAPACK."""

import numpy as np
import pytest

from omniservo.geometry.linear_systems import symmetric_eigen

SPECTRA = {
    "apart": [1.0, -3.0, 0.2, 8.0, 5.0, -0.7],
    "all alike": [2.0] * 5,
    "nearly alike": [1.0, 1.0 + 1e-9, 1.0 + 3e-9, 1.0 - 1e-12, 2.0, 2.0 + 1e-9],
    "small beside large": [1e-14, 3e-9, 1e-6, 1.0, 1e3, 1e3 + 1e-6],
    "singular": [0.0, 0.0, 1.0, 4.0],
    "one": [-7.0],
}


@pytest.mark.parametrize("size", [1e-12, 1.0, 1e12])
@pytest.mark.parametrize("name", SPECTRA)
def test_eigenvalues_and_vectors_are_right_to_a_rounding_of_the_norm(name, size):
    rng = np.random.default_rng(4)
    for _ in range(20):
        spectrum = size * np.sort(SPECTRA[name])
        turn = np.linalg.qr(rng.normal(size=(len(spectrum), len(spectrum))))[0]
        matrix = turn * spectrum @ turn.T
        matrix = 0.5 * (matrix + matrix.T)
        values, vectors = symmetric_eigen(matrix)
        near = 2e-14 * np.abs(spectrum).max()
        np.testing.assert_allclose(values, spectrum, rtol=0.0, atol=near)
        np.testing.assert_allclose(vectors.T @ vectors, np.eye(len(spectrum)), rtol=0.0, atol=1e-13)
        np.testing.assert_allclose(matrix @ vectors, vectors * values, rtol=0.0, atol=near)
