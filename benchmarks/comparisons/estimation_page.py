"""Writes docs/benchmark-estimation.md: motion from two images and pose from known points, beside others.

Run: ``make bench-estimation``, which installs the others, or
``python -m benchmarks.comparisons.estimation_page [--scenes N] [--out FILE]``.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from benchmarks.comparisons import motion, pose
from benchmarks.comparisons.motion import OURS, OURS_OK, Score
from benchmarks.comparisons.planning.report import where
from benchmarks.estimation_speed import estimation_microseconds

from omniservo.cameras import preset
from omniservo.files import write_whole

LIBRARIES = ("numpy", "scipy", "numba", "opencv-contrib-python-headless", "pycolmap", "poselib")
PEERS = ("pycolmap", "PoseLib")
RESAMPLINGS = 1000
SURE = 0.995
"""A quantile of ours is worse than a peer's where it is larger in so many of the resamplings of the scenes:
all methods saw the same ones, and hundreds of scenes leave quantiles uncertain by several percent."""

BOUND = 1.15
LEAST_SUCCESS = 99.0

Scores = dict[tuple[str, int, float], dict[str, Score]]


def page(scenes: int) -> str:
    """Measure everything and return the page."""
    found: Scores = {
        (name, n, wrong): motion.compare(preset(name), n, wrong, scenes)
        for name in motion.CAMERAS
        for n, wrong in motion.CASES
    }
    parts = [
        "# Motion and pose beside others\n",
        where("python -m benchmarks.comparisons.estimation_page", LIBRARIES),
        "## Targets\n",
        *target_lines(found),
        "\n## Motion from two images\n",
        explained(motion.__doc__),
        *(motion.table(*case, scores, scenes) for case, scores in found.items()),
        "\n## The camera's pose from known points\n",
        explained(pose.__doc__),
        *(pose.table(name, *case, scenes) for name in pose.CAMERAS for case in pose.CASES),
    ]
    return "\n".join(parts) + "\n"


def explained(words: str | None) -> str:
    """Return a module's docstring but for its title."""
    return "" if words is None else words.split("\n\n", 1)[1].strip().replace("``", "`")


def target_lines(found: Scores) -> Iterator[str]:
    """Yield what was asked and what came out."""
    yield "| figure | target | here | |"
    yield "|---|---|---|---|"
    for (name, n, wrong), scores in found.items():
        ours, case = scores[OURS], f"{name}, {n} matches{', 30% wrong' if wrong else ''}"
        if wrong:
            success = 100.0 * float(np.mean(np.array(ours.rotation) < motion.GROSS_DEGREES))
            yield _line(f"{case}: rotation within 10°", "≥ 99%", f"{success:.1f}%", success >= LEAST_SUCCESS)
            continue
        yield _no_worse(case, scores)
        ratio = float(np.median(ours.rotation) / np.median(scores["bound"].rotation))
        yield _line(f"{case}: median over the bound's", "≤ 1.15", f"{ratio:.2f}", ratio <= BOUND)
    for n in (9, 100):
        search, public = estimation_microseconds(n)
        here = f"{search:.0f} µs without, {public:.0f} µs with statuses and checks, called from Python"
        yield _line(f"{n} matches, all right: time", "≤ 300 µs", here, public <= 300.0)
    spoilt = [s[OURS_OK].microseconds for (_, _, wrong), s in found.items() if wrong]
    slowest = max(float(np.median(times)) for times in spoilt)
    yield _line("100 matches, 30% wrong: time", "≤ 2 000 µs", f"{slowest:.0f} µs", slowest <= 2000.0)


def _no_worse(case: str, scores: dict[str, Score]) -> str:
    """Return the line that compares ours with every peer."""
    peers = [score for name, score in scores.items() if name.startswith(PEERS)]
    mine, theirs, worse = [], [], 0
    for what in ("rotation", "direction"):
        for quantile in (50, 90):
            mine.append(f"{_quantile(scores[OURS], what, quantile):.2f}")
            best = min((_quantile(peer, what, quantile) for peer in peers), default=np.inf)
            theirs.append(f"{best:.2f}")
            worse += any(_is_worse(scores[OURS], peer, what, quantile) for peer in peers)
    here = f"{' / '.join(mine)}; the best of theirs: {' / '.join(theirs)}; {worse} surely worse"
    figure = f"{case}: rotation, median / p90, direction, median / p90 [deg]"
    return _line(figure, "no worse than pycolmap and PoseLib", here, worse == 0)


def _quantile(score: Score, what: str, percent: int) -> float:
    return float(np.percentile(getattr(score, what), percent))


def _is_worse(ours: Score, peer: Score, what: str, percent: int) -> bool:
    """Tell whether our quantile is larger than the peer's, and not by chance: a paired bootstrap."""
    one, other = (np.array(getattr(score, what)) for score in (ours, peer))
    drawn = np.random.default_rng(0).integers(0, len(one), (RESAMPLINGS, len(one)))
    larger = np.percentile(one[drawn], percent, axis=1) > np.percentile(other[drawn], percent, axis=1)
    return bool(larger.mean() >= SURE)


def _line(figure: str, asked: str, here: str, met: bool) -> str:
    return f"| {figure} | {asked} | {here} | {'met' if met else 'missed'} |"


def main() -> None:
    """Write the page and print it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=300)
    parser.add_argument("--out", type=Path, default=Path("docs/benchmark-estimation.md"))
    given = parser.parse_args()
    written = page(given.scenes)
    write_whole(given.out, written, force=True)
    print(written)


if __name__ == "__main__":
    main()
