"""Does a calibration's stated uncertainty cover what two calibrations of one lens differ by?

Run: ``python -m benchmarks.calibration_halves [draws]``. Real corners are those of
``benchmarks.calibration_accuracy``, left out where ../shared/data is absent. Of each set two parts without a
common view (half of the views, at most ten) are drawn; each makes a camera, and by how much both differ after
the best rotation, at 200 of the set's corners, is compared with what both state (`ray_deviation_turned_deg`):
root mean squares of a coordinate. Above 1 is overconfident. The first draw is every second view.

Drawn corners: eight views of the paper's fisheye, a smooth field between the camera that draws and the one
that is looked for; the truth stands in the other half's place.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator

import numpy as np
from benchmarks.calibration_accuracy import Corners, board_views, real_sets
from benchmarks.comparisons.mrcal.compare import PIXELS, Made, apart, by_us
from benchmarks.tables import print_table

from omniservo import preset
from omniservo.cameras import ModelError
from omniservo.geometry.arrays import FloatArray

DRAWS = 8
MOST_VIEWS = 10
LENS, VIEWS = preset("fe185"), 8
FIELDS = ((0.0, 0.1, 0.3), (0.3, 0.1, 0.05), (0.3, 0.2, 0.05), (0.3, 0.35, 0.05))
"""σ of the field [px], ℓ over the width, noise of corners [px]"""


def part(corners: Corners, views: list[int]) -> Corners:
    """Return some views."""
    return Corners(
        corners.name, [corners.pixels[i] for i in views], [corners.points[i] for i in views], corners.size
    )


def ratios(differ: float, made: tuple[Made, ...], use: FloatArray) -> tuple[float, float, float]:
    """Return what cameras differ by [px], what they state together, and the ratio."""
    stated = math.sqrt(sum(float(np.mean(half.stated[use] ** 2)) for half in made))
    return differ, stated, differ / stated


def row(name: str, found: list[tuple[float, float, float]], refused: int) -> str:
    """Return one row."""
    differ, stated, ratio = np.array(found).T
    numbers = np.median(differ), np.median(stated), ratio[0], math.sqrt((ratio**2).mean()), ratio.max()
    return " | ".join([name, str(len(found)), str(refused), *(f"{number:.2f}" for number in numbers)])


def real_rows(draws: int) -> Iterator[str]:
    """Yield a row for each real set."""
    for corners in real_sets():
        pixels, count = np.concatenate(corners.pixels), len(corners.pixels)
        at = pixels[np.random.default_rng(0).permutation(len(pixels))[:PIXELS]]
        most, found, refused = min(count // 2, MOST_VIEWS), [], 0
        for draw in range(draws):
            order = np.random.default_rng(draw).permutation(count) if draw else np.arange(count)
            views = (order[:most], order[most : 2 * most]) if draw else (order[::2], order[1::2])
            try:
                made = tuple(
                    by_us(part(corners, list(chosen[: 2 * MOST_VIEWS])), None, at)[0] for chosen in views
                )
            except RuntimeError:
                refused += 1
                continue
            found.append(ratios(*_apart(made[0], made[1].bearings[0], made)))
        yield row(corners.name, found, refused)


def _apart(
    one: Made, bearings: FloatArray, made: tuple[Made, ...]
) -> tuple[float, tuple[Made, ...], FloatArray]:
    differ, use = apart(one, bearings)
    return differ, made, use


def drawn_rows(draws: int) -> Iterator[str]:
    """Yield a row for each field."""
    u, v = np.meshgrid(np.linspace(60.0, 600.0, 14), np.linspace(30.0, 400.0, 10))
    at = np.stack([u.ravel(), v.ravel()], axis=1)
    truth, seen = LENS.unproject(at)
    truth = np.where(seen[:, None], truth, np.nan)
    for sigma, length, noise in FIELDS:
        found, refused = [], 0
        for seed in range(draws):
            rng = np.random.default_rng(seed)
            pixels, points = board_views.draw_views(LENS, rng, views=VIEWS, noise_px=noise)
            rows = ModelError(sigma, length * LENS.width).rows(np.concatenate(pixels))
            field = np.stack([rng.standard_normal(len(rows)) @ rows for _ in range(2)], axis=1)
            pixels = [p + e for p, e in zip(pixels, np.split(field, len(pixels)), strict=True)]
            try:
                made = by_us(Corners("drawn", pixels, points, (LENS.width, LENS.height)), None, at)[0]
            except RuntimeError:
                refused += 1
                continue
            found.append(ratios(*_apart(made, truth, (made,))))
        yield row(f"{sigma:g} px over {length:g}, {noise:g} px of noise", found, refused)


def main() -> None:
    """Print both tables."""
    draws = int(sys.argv[1]) if len(sys.argv) > 1 else DRAWS
    tail = "draws | no camera | differ, median [px] | stated, median [px] | first | rms of ratios | largest |"
    print_table(f"| corners | {tail}", real_rows(draws))
    print()
    print_table(f"| field | {tail}", drawn_rows(2 * draws))


if __name__ == "__main__":
    main()
