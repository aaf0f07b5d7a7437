"""What every kind of feature can do: be matched between two images, and be followed through the next ones.

A new kind of feature is one class that answers to `FeatureKind`; nothing else needs to know it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from omniservo.cameras.models import CentralModel
from omniservo.errors import InputError
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import BoolArray, ByteArray, FloatArray, IntArray

LEAST_FEATURES = 8
"""Motion and structure of an unknown target need eight points; every kind asks for them."""


@with_field_docs
@dataclass(frozen=True, eq=False)
class MatchedPoints:
    """The same points in two images."""

    initial: FloatArray
    """(n, 2) [px], in an order that the initial image fixes"""
    goal: FloatArray
    """(n, 2) [px], row j belongs to row j of ``initial``"""
    noise: FloatArray | None = None
    """(n, 2) σ of a coordinate in the initial and in the goal image [px]; None: not known beforehand"""
    ids: IntArray | None = None
    """(n,) which corners of which tags they are, 4·tag + corner as in `omniservo.targets`; None: no tags"""
    window: FloatArray | None = None
    """(n,) standard deviation [px] of the Gaussian window in the initial image that each was measured in:
    points whose windows overlap err alike; None: every point errs by itself"""

    def __len__(self) -> int:
        return len(self.initial)

    @property
    def squares(self) -> IntArray | None:
        """(m, 4) rows of the corners of each tag that is whole, in order round it; None: no tags."""
        if self.ids is None:
            return None
        order = np.argsort(self.ids)
        _, first, count = np.unique(self.ids[order] // 4, return_index=True, return_counts=True)
        return np.asarray(order[first[count == 4][:, None] + np.arange(4)])

    def where(self, rows: IntArray) -> MatchedPoints:
        """Return the chosen rows."""
        noise = None if self.noise is None else self.noise[rows]
        ids = None if self.ids is None else self.ids[rows]
        window = None if self.window is None else self.window[rows]
        return MatchedPoints(self.initial[rows], self.goal[rows], noise, ids, window)


class FeatureTracker(Protocol):
    """Finds the matched points again in every new image; it keeps nothing between images."""

    def update(self, image: ByteArray, predicted_pixels: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Return the points near their predictions: pixels (n, 2) [px], NaN where lost, and valid (n,).

        Args:
            image: (height, width) grey values.
            predicted_pixels: (n, 2) [px]; a row with NaN is a point without prediction and stays lost.
        """
        ...


class FeatureKind(Protocol):
    """One kind of feature: dots, tags, natural features."""

    @property
    def name(self) -> str:
        """In words, plural: "dots"."""
        ...

    @property
    def least(self) -> int:
        """How many features an image must show."""
        ...

    @property
    def most_blur(self) -> float:
        """How far a feature may move during an exposure and still be found [px]."""
        ...

    def find(self, camera: CentralModel, image: ByteArray) -> FloatArray:
        """Return the pixels (n, 2) [px] of every feature in an image."""
        ...

    def match(self, camera: CentralModel, initial: ByteArray, goal: ByteArray) -> MatchedPoints:
        """Return the points that both images show.

        Raises:
            InputError: an image with fewer than ``least``.
            NoSolutionError: they cannot be matched, or too few can.
        """
        ...

    def tracker(
        self, camera: CentralModel, initial: ByteArray, goal: ByteArray, matched: MatchedPoints
    ) -> FeatureTracker:
        """Return what follows the ``matched`` points, rows in their order."""
        ...


def require_features(count: int, name: str, where: str, least: int = LEAST_FEATURES, hint: str = "") -> None:
    """Refuse an image with too few features; ``hint``: what else may be looked for.

    Raises:
        InputError: fewer than ``least``.
    """
    if count < least:
        raise InputError(
            f"{where}: {count} {name} found; at least {least} {'is' if least == 1 else 'are'} needed{hint}"
        )
