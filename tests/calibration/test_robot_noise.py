"""The mixed linear model of hand-eye calibration against generalised least squares written out."""

import numpy as np

from omniservo.calibration.hand_eye.loop import BOARD_SIZE, LinearLoop
from omniservo.calibration.hand_eye.robot_noise import _given

VIEWS = 5


def some_loop(rng):
    """A loop of views with numbers at random, and how much they disagree by the camera's errors."""
    root = rng.standard_normal((VIEWS, 6, 6)) * np.repeat([1e-3, 3e-3], 3)[:, None]
    shared = rng.standard_normal((4, VIEWS, 6)) * 2e-3
    linear = LinearLoop(
        q=3e-3 * rng.standard_normal((VIEWS, 6)),
        M=rng.standard_normal((VIEWS, 6, BOARD_SIZE + 1)),
        C=root @ root.mT,
        by_scale=np.zeros(6),
        by_pixel=np.zeros(6),
        by_camera=shared,
    )
    return linear, np.einsum("fni,fnj->nij", shared, shared)


def test_each_node_of_a_row_is_generalised_least_squares_with_the_disagreement_in_the_weights_alone():
    linear, disagreement = some_loop(np.random.default_rng(2))
    prior = np.zeros((BOARD_SIZE + 1, BOARD_SIZE + 1))
    prior[BOARD_SIZE:, BOARD_SIZE:] = 1.0
    sigmas = np.column_stack((np.full(4, 2e-3), [1e-6, 1e-4, 1e-2, 0.3]))
    for beside in (np.zeros_like(disagreement), disagreement):
        for (sigma_t, sigma_r), step, covariance, likelihood in zip(
            sigmas, *_given(linear, beside, sigmas), strict=True
        ):
            errs = linear.C + np.diag(np.repeat([sigma_t, sigma_r], 3) ** 2)
            V = errs + beside
            weighted = np.linalg.solve(V, linear.M).mT
            normal = (weighted @ linear.M).sum(axis=0) + prior
            right = np.einsum("nmi,ni->m", weighted, linear.q)
            expected = np.linalg.solve(normal, right)
            np.testing.assert_allclose(step, expected, rtol=1e-7, atol=1e-10)
            inverse = np.linalg.inv(normal)
            spread = (weighted @ errs @ weighted.mT).sum(axis=0) + prior
            np.testing.assert_allclose(
                covariance, inverse @ spread @ inverse, rtol=1e-6, atol=1e-9 * np.abs(covariance).max()
            )
            squares = np.einsum("ni,ni->", linear.q, np.linalg.solve(V, linear.q[..., None])[..., 0])
            logdets = np.linalg.slogdet(V)[1].sum() + np.linalg.slogdet(normal)[1]
            np.testing.assert_allclose(likelihood, -0.5 * (logdets + squares - right @ expected), rtol=1e-9)
