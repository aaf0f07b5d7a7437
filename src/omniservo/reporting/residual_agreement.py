"""Whether residuals agree with those beside them, as a wrong calibration makes them and noise does not."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from scipy.spatial import cKDTree

from omniservo.geometry.arrays import FloatArray
from omniservo.reporting.spelling import significant

_NEIGHBOURS = 4
_LEAST_POINTS = 20
"""fewer say nothing"""
_AGREE = 0.3
_SURE = 4.0
"""standard deviations of chance"""


def residual_agreement(pixels: FloatArray, residuals: FloatArray) -> tuple[float, float]:
    """Return how far residuals (n, 2) agree with those of their four nearest pixels (n, 2), and chance's σ.

    The first is Moran's I, Σ eᵢ·mean(eⱼ)/Σ‖eᵢ‖²: 0 for independent residuals, 1 where neighbours are equal.
    The second is the most that its standard deviation over independent ones can be, √(2/(4n)): neighbours
    are mutual, and the residuals of two views lie along one direction each, that across the epipolar line.
    """
    nearest = np.asarray(cKDTree(pixels).query(pixels, _NEIGHBOURS + 1)[1])[:, 1:]
    power = float((residuals**2).sum())
    alike = float((residuals * residuals[nearest].mean(axis=1)).sum())
    return (alike / power if power > 0.0 else 0.0), (2.0 / (_NEIGHBOURS * len(pixels))) ** 0.5


def agreement_in_words(parts: Iterable[tuple[FloatArray, FloatArray]], cause: str) -> str:
    """Return one sentence: whether what is left is noise, or a pattern; empty where too few points tell.

    Args:
        parts: pixels and residuals (n, 2) of each image, or of all; the one that agrees most counts.
        cause: what a pattern may come from, as the end of the sentence.
    """
    known = [(pixels, left, np.isfinite(left).all(axis=1)) for pixels, left in parts]
    found = [residual_agreement(pixels[k], left[k]) for pixels, left, k in known if k.sum() >= _LEAST_POINTS]
    if not found:
        return ""
    most, chance = max(found)
    numbers = f"correlation {significant(most)}, of noise 0 ± {significant(chance)}"
    if most > _AGREE and most > _SURE * chance:
        return f"What is left agrees in neighbouring points ({numbers}): {cause}."
    return f"What is left looks like noise ({numbers} in neighbouring points)."
