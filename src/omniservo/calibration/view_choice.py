"""Which images of a board are worth keeping for a calibration, and which are still missing."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from omniservo.calibration.boards import BoardView
from omniservo.calibration.outlines import inside_outlines, raster_size
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import BoolArray, ByteArray, FloatArray

FEWEST = 3
"""views, without which there is no calibration"""

ENOUGH = 10
"""views that are required"""

MOST_KEPT = 200
"""views that are kept"""

TILT = math.radians(30.0)
"""of the board that is required, about either axis of the image [rad]"""

SIZES = 1.5
"""that is required: the largest board in the image by the smallest"""

CELL_COVERED = 0.25
"""A third by a third of the image is covered if so much of it is inside boards' outlines."""

THIRDS = (
    ("upper left corner", "middle of the upper edge", "upper right corner"),
    ("middle of the left edge", "middle", "middle of the right edge"),
    ("lower left corner", "middle of the lower edge", "lower right corner"),
)
"""what the image's nine parts are called"""

_TILT_REACHED = 0.8 * TILT
_ANOTHER_PLACE = 0.1
_ANOTHER_SIZE = 1.25
_ANOTHER_TILT = math.radians(15.0)
_FEWEST_POINTS = 6
_STILL = 1e-3
_LIT = 24
"""grey value that a pixel inside the lens's image circle reaches sooner or later"""


@dataclass(frozen=True)
class Appearance:
    """How a board looks in an image, of a camera that is not known yet."""

    place: FloatArray
    """(2,) middle of its points, by the image's longer side"""
    size: float
    """√area of its outline, by the image's longer side"""
    tilt: float
    """arccos of its foreshortening [rad]: the board's tilt, as far as the lens itself shortens nothing"""
    across: float
    """angle of the direction in which it is shortened, from the image's x [rad]"""

    @classmethod
    def of(cls, view: BoardView, size: tuple[int, int]) -> Appearance | None:
        """Return how a view looks in an image of ``size`` [px]; None: too few points to tell."""
        if len(view) < _FEWEST_POINTS:
            return None
        pixels, points = np.asarray(view.pixels), np.asarray(view.object_points)[:, :2]
        affine, _, rank, _ = np.linalg.lstsq(points - points.mean(0), pixels - pixels.mean(0))
        axes, (large, small), _ = np.linalg.svd(affine.T)
        area = float(cv2.contourArea(cv2.convexHull(pixels.astype(np.float32))))
        if rank < 2 or area <= 0.0:
            return None
        shortened = axes[:, 1]
        return cls(
            pixels.mean(0) / max(size),
            math.sqrt(area) / max(size),
            math.acos(min(1.0, small / large)),
            math.atan2(shortened[1], shortened[0]),
        )

    @property
    def about_vertical(self) -> bool:
        """Whether the board is turned rather about the image's vertical than about its horizontal."""
        return abs(math.cos(self.across)) >= math.cos(math.pi / 4.0)

    def is_like(self, other: Appearance) -> bool:
        """Whether place, size and tilt are about the same."""
        larger = max(self.size, other.size) / min(self.size, other.size)
        turned = np.linalg.norm(self._leaning() - other._leaning())
        moved = np.linalg.norm(self.place - other.place)
        return bool(moved < _ANOTHER_PLACE and larger < _ANOTHER_SIZE and turned < _ANOTHER_TILT)

    def _leaning(self) -> FloatArray:
        """Return the tilt with its direction (2,) [rad]; a direction and its opposite are one."""
        return self.tilt * np.array([math.cos(2.0 * self.across), math.sin(2.0 * self.across)])


@with_field_docs
@dataclass(frozen=True)
class Judgement:
    """What became of one image."""

    kept: bool
    words: str
    """kept or not, and why"""


class ViewChoice:
    """Keeps the views of a board that show something new, and says what is missing.

    A view is kept where the board stands still, and lies in another place, has another size or another tilt
    than in every view kept, or covers what was missing.

    Args:
        size: (width, height) of the images [px].
    """

    def __init__(self, size: tuple[int, int]) -> None:
        self.size = size
        """(width, height) of the images [px]"""
        self.kept: list[BoardView] = []
        """the views that are kept"""
        self._looks: list[Appearance] = []
        self._before: BoardView | None = None
        width, height = raster_size(size)
        self._lit = np.zeros((height, width), dtype=np.bool_)
        self._covered = np.zeros((height, width), dtype=np.bool_)

    def light(self, image: ByteArray) -> None:
        """Note which parts of an image (height, width) are light: no board is required in what never is."""
        width, height = raster_size(self.size)
        self._lit |= cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA) >= _LIT

    def judge(self, view: BoardView) -> Judgement:
        """Keep a view, or not; views come in the order of their images."""
        before, self._before = self._before, view if view.found else None
        if not view.found:
            return Judgement(False, f"no board: {view.reason}")
        look = Appearance.of(view, self.size)
        if look is None:
            return Judgement(False, f"board: only {len(view)} points are seen, or all on a line")
        covered = self._covered | inside_outlines([view.pixels], self.size)
        news = self._news(look, covered)
        if not news:
            return Judgement(False, "board: like a view that is kept; move, tilt, or bring it nearer")
        motion = math.inf if before is None else moved(before, view)
        if motion > still_px(self.size):
            by = "" if math.isinf(motion) else f" (it moves by {motion:.1f} px between images)"
            return Judgement(False, f"board: {news}; hold it still{by}")
        self.kept.append(view)
        self._looks.append(look)
        self._covered = covered
        return Judgement(True, f"kept: {news}")

    def _news(self, look: Appearance, covered: BoolArray) -> str:
        """Say what is new about a view; nothing: empty."""
        alike = [k for k in self._looks if look.is_like(k)]
        if not alike:
            return "another place, size or tilt" if self._looks else "the first view"
        if len(missing_thirds(self._parts(covered))) < len(missing_thirds(self.covered_thirds)):
            return "another part of the image"
        return ""

    @property
    def covered_thirds(self) -> FloatArray:
        """(3, 3) how much of each part of the image is inside boards' outlines; NaN: it stays dark."""
        return self._parts(self._covered)

    def _parts(self, covered: BoolArray) -> FloatArray:
        shares = np.full((3, 3), np.nan)
        anywhere = self._lit if self._lit.any() else ~self._lit  # nothing is known of the lens yet
        rows, columns = (np.array_split(np.arange(n), 3) for n in covered.shape)
        for i, row in enumerate(rows):
            for j, column in enumerate(columns):
                lit, inside = anywhere[np.ix_(row, column)], covered[np.ix_(row, column)]
                if (lit | inside).mean() >= CELL_COVERED:
                    shares[i, j] = inside.sum() / (lit | inside).sum()
        return shares

    @property
    def sizes(self) -> tuple[float, float]:
        """The smallest and largest board so far, √area by the image's longer side; zeros: none."""
        sizes = [look.size for look in self._looks] or [0.0]
        return min(sizes), max(sizes)

    @property
    def tilts(self) -> tuple[float, float]:
        """The largest tilts so far, about the image's vertical and its horizontal [rad]."""
        about = [[0.0], [0.0]]
        for look in self._looks:
            about[0 if look.about_vertical else 1].append(look.tilt)
        return max(about[0]), max(about[1])

    def missing(self) -> tuple[str, ...]:
        """Say what is still missing, each in words; nothing: empty."""
        words = [f"the board in the {name}" for name in missing_thirds(self.covered_thirds)]
        vertical, horizontal = self.tilts
        tilted = f"the board tilted by {math.degrees(TILT):.0f}° about the"
        if vertical < _TILT_REACHED:
            words.append(f"{tilted} vertical (left or right side away)")
        if horizontal < _TILT_REACHED:
            words.append(f"{tilted} horizontal (upper or lower side away)")
        least, most = self.sizes
        if most < SIZES * least or not self.kept:
            words.append(f"the board nearer or farther ({SIZES:g} times as large or as small)")
        if (more := ENOUGH - len(self.kept)) > 0:
            words.append(f"{more} more view{'s' * (more > 1)}")
        return tuple(words)

    def summary(self) -> tuple[str, ...]:
        """Say what is kept and covered, a line each."""
        least, most = (f"{100 * size:.0f}%" for size in self.sizes)
        vertical, horizontal = (f"{math.degrees(tilt):.0f}°" for tilt in self.tilts)
        rows = [" ".join(_spelled_share(share) for share in row) for row in self.covered_thirds]
        return (
            f"{len(self.kept)} kept; the board {least} to {most} of the image's longer side, tilted by up to"
            f" {vertical} about the vertical and {horizontal} about the horizontal",
            *(f"{name:<14}{row}" for name, row in zip(("covered", "by thirds", ""), rows, strict=True)),
        )


def _spelled_share(share: float) -> str:
    return "dark" if math.isnan(share) else f"{100 * share:3.0f}%"


def still_px(size: tuple[int, int]) -> float:
    """Return how far points of what stands still may move between images of ``size`` [px]."""
    return max(1.0, _STILL * max(size))


def missing_thirds(covered: FloatArray) -> list[str]:
    """Return the names of the image's parts that are covered too little.

    Args:
        covered: (3, 3) shares; NaN: a part that no board can be in.
    """
    return [THIRDS[i][j] for i, j in np.argwhere(covered < CELL_COVERED)]


def moved(before: BoardView, view: BoardView) -> float:
    """Return how far the board's points moved between two images, the median [px]; no common point: inf.

    A board that looks the same turned may be counted from its other end: that is no motion.
    """
    _, one, other = np.intersect1d(before.ids, view.ids, assume_unique=True, return_indices=True)
    if not len(one):
        return math.inf
    steps = [before.pixels[one] - view.pixels[other]]
    if view.turnable and len(view) == len(before) == len(one):
        steps.append(before.pixels[::-1] - view.pixels)
    return min(float(np.median(np.linalg.norm(step, axis=1))) for step in steps)
