"""What drives turn joints by, compiled: a moving robot is compared with it 200 times a second."""

import numpy as np

from omniservo.geometry.arrays import FloatArray, IntArray
from omniservo.geometry.kernel import kernel


@kernel
def explained(
    fast: FloatArray, slow: FloatArray, corners: IntArray, least: FloatArray, most: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the least and the most that drives turn joints by, (windows, gains, cells, n) [rad].

    Args:
        fast: (windows, drives, n) what joints were sent to turn by over a window, by S [rad].
        slow: by D, likewise.
        corners: (4, cells) the drives that bound each cell of the grid.
        least: (gains,) the least gain of each range.
        most: (gains,) the most.
    """
    windows, joints = fast.shape[0], fast.shape[2]
    lowest = np.empty((windows, len(most), corners.shape[1], joints))
    highest = np.empty_like(lowest)
    apart = np.zeros((corners.shape[1], joints))  # of parts of a window, too
    for k in range(windows):
        for cell in range(corners.shape[1]):
            for j in range(joints):
                low, high = np.inf, -np.inf
                for corner in range(corners.shape[0]):
                    a, b = fast[k, corners[corner, cell], j], slow[k, corners[corner, cell], j]
                    low, high = min(low, a, b), max(high, a, b)
                    apart[cell, j] = max(apart[cell, j], abs(a - b))
                for g in range(len(most)):
                    wide = most[g] * apart[cell, j]
                    lowest[k, g, cell, j] = min(least[g] * low, most[g] * low) - wide
                    highest[k, g, cell, j] = max(least[g] * high, most[g] * high) + wide
    return lowest, highest
