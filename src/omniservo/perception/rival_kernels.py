"""Nearest and second nearest descriptors; a second one counts only if it lies elsewhere in the image."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from omniservo.geometry.arrays import FloatArray, IntArray
from omniservo.geometry.kernel import kernel


@kernel
def best_and_rival(
    similarity: npt.NDArray[np.float32],
    pixels: FloatArray,
    reach: FloatArray,
    itself: bool,
    best: IntArray,
    rival: IntArray,
) -> None:
    """Write for each row the most similar column, and the most similar one away from that column's pixel.

    Args:
        similarity: (n, m).
        pixels: (m, 2) [px] where the columns' features are.
        reach: (m,) [px] a feature nearer than this to the best one is at its place.
        itself: row and column i are the same feature, and the best is not another.
        best: (n,) written.
        rival: (n,) written; -1 where no column is elsewhere.
    """
    n, m = similarity.shape
    for i in range(n):
        first = i
        if not itself:
            first = 0
            for j in range(1, m):
                if similarity[i, j] > similarity[i, first]:
                    first = j
        second, most = -1, np.float32(-2.0)
        u, v, r = pixels[first, 0], pixels[first, 1], reach[first]
        for j in range(m):
            if similarity[i, j] > most:
                du, dv = pixels[j, 0] - u, pixels[j, 1] - v
                if du * du + dv * dv > r * r:
                    second, most = j, similarity[i, j]
        best[i], rival[i] = first, second
