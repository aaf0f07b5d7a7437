"""Boards seen twice: a flat target must never be answered as a scene that is sure and wrong.

Run: ``python -m benchmarks.flat_pairs``. Pairs of views of the sets in ../shared/data whose camera moves
before a flat board of known corners (left out where absent). The camera is the set's own calibration. Each
pair is answered as a scene of any shape (method "pixel") and as a plane ("homography"), the noise of the
corners stated as 0.1, 0.03 and 0.003 px, or not at all. Wrong is an answer beyond 5 σ of what is stated (5
numbers) whose rotation or direction is off by more than 3°.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import Literal

import numpy as np
from benchmarks.real_coverage import DATA, SETS, RealSet, score

from omniservo import estimate_two_view

VIEWS = 9
"""of a set, evenly taken: 36 pairs"""

NOISES = (None, 0.1, 0.03, 0.003)
SURE = 5.0
"""[σ]"""
WRONG_DEG = 3.0

METHODS: tuple[Literal["pixel", "homography"], ...] = ("pixel", "homography")


def rows() -> Iterator[str]:
    """Give the table, row by row."""
    yield "| set | method | noise stated [px] | pairs | ok | ambiguous | planar | other | sure and wrong |"
    yield "|" + "---|" * 9
    for name in SETS:
        data = RealSet.read(name)
        found = data.calibrated()
        assert found.camera is not None
        names = list(data.corners)
        chosen = [names[i] for i in np.linspace(0, len(names) - 1, VIEWS).astype(int)]
        for method, noise in itertools.product(METHODS, NOISES):
            counts = dict.fromkeys(("ok", "ambiguous", "planar_points", "other"), 0)
            wrong = pairs = 0
            for one, other in itertools.combinations(chosen, 2):
                pairs += 1
                estimate = estimate_two_view(
                    found.camera, data.corners[one], data.corners[other], method=method, noise=noise,
                    calibration_covariance=found.covariance,
                )  # fmt: skip
                counts[estimate.status if estimate.status in counts else "other"] += 1
                if estimate.status == "ok":
                    s = score(estimate, data.truth(one, other))
                    far = max(s.rotation_deg, s.direction_deg) > WRONG_DEG
                    wrong += far and s.square > SURE**2
            numbers = " | ".join(str(x) for x in (pairs, *counts.values(), wrong))
            yield f"| {name} | {method} | {noise or 'not'} | {numbers} |"


def main() -> None:
    """Print the table as Markdown."""
    if not all((DATA / name).is_dir() for name in SETS):
        print("real data not present: ../shared/data")
        return
    for row in rows():
        print(row, flush=True)


if __name__ == "__main__":
    main()
