"""Pixels that need no ray of their own."""

import numpy as np

from omniservo.simulation.pixel_edges import fill_between_alike


def test_pixels_between_four_like_nodes_are_filled_and_no_others():
    truth = np.add.outer(np.arange(9) > 4, 2 * (np.arange(12) > 6)).astype(float)  # four flat quarters
    image, other = np.full(truth.shape, np.nan), np.zeros(truth.shape, dtype=int)
    image[::2, ::2] = truth[::2, ::2]
    other[2, 2] = 7  # a node that differs in the second image alone
    legal = np.ones(truth.shape, dtype=bool)
    legal[8] = False
    filled = fill_between_alike([image, other], legal)
    np.testing.assert_array_equal(image[filled], truth[filled])
    expected = np.zeros_like(filled)
    expected[:8, :10] = True  # the last node is number 10; the last rows and columns have none beyond
    expected[4:6] = expected[:, 6:8] = False  # quarters meet here
    expected[:4, :4] = False  # round the node that differs
    np.testing.assert_array_equal(filled, expected)
    assert np.isnan(image[~filled][(np.add.outer(np.arange(9) % 2, np.arange(12) % 2) > 0)[~filled]]).all()
