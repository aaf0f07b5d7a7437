"""Boards seen twice: a flat target must never be answered as a scene that is sure and wrong.

Run: ``python -m benchmarks.flat_pairs [--rendered N]``. Pairs of views of the sets in ../shared/data whose
camera moves before a flat board of known corners (left out where absent). The camera is the set's own
calibration. Each pair is answered as a scene of any shape (method "pixel") and as a plane ("homography"), the
noise of the corners stated as 0.1, 0.03 and 0.003 px, or not at all. Wrong is an answer beyond 5 σ of what is
stated (5 numbers) whose rotation or direction is off by more than 3°.

``--rendered N``: N rendered pairs of images of one textured plane instead, with the natural features matched
in them, through three lenses in turn; their noise as the features state it, a tenth or a hundredth of that,
or not at all.
"""

from __future__ import annotations

import argparse
import itertools
from collections import Counter
from collections.abc import Iterator
from typing import Literal

import numpy as np
from benchmarks.pictured_scenes import LENS, OTHER_LENS, WIDE, Face, motion, picture_of
from benchmarks.real_coverage import DATA, SETS, RealSet, score
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo import estimate_two_view
from omniservo.cameras import UnifiedCamera
from omniservo.errors import NoSolutionError
from omniservo.estimation import TwoViewEstimate
from omniservo.geometry.arrays import FloatArray
from omniservo.perception import NaturalKind
from omniservo.scenes.textures import texture, texture_kinds

VIEWS = 9
"""of a set, evenly taken: 36 pairs"""

NOISES = (None, 0.1, 0.03, 0.003)
SURE = 5.0
"""[σ]"""
WRONG_DEG = 3.0

METHODS: tuple[Literal["pixel", "homography"], ...] = ("pixel", "homography")

LENSES = {"fisheye 190°": LENS, "fisheye 280°": WIDE, "perspective": OTHER_LENS}
SHARES = (None, 1.0, 0.1, 0.01)
"""of the noise that the features state; None: nothing is stated"""


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
            answers: list[tuple[str, bool]] = []
            for one, other in itertools.combinations(chosen, 2):
                estimate = estimate_two_view(
                    found.camera, data.corners[one], data.corners[other], method=method, noise=noise,
                    calibration_covariance=found.covariance,
                )  # fmt: skip
                answers.append(judged(estimate, data.truth(one, other)))
            yield f"| {name} | {method} | {noise or 'not'} | {counted(answers)} |"


def judged(estimate: TwoViewEstimate, truth: tuple[RigidTransform, FloatArray]) -> tuple[str, bool]:
    """Return the status, and whether the answer is sure and wrong."""
    if estimate.status != "ok":
        return estimate.status, False
    s = score(estimate, truth)
    return "ok", max(s.rotation_deg, s.direction_deg) > WRONG_DEG and s.square > SURE**2


def counted(answers: list[tuple[str, bool]]) -> str:
    """Return the cells of a row: pairs, statuses, sure and wrong."""
    statuses = Counter(status for status, _ in answers)
    own = [statuses[status] for status in ("ok", "ambiguous", "planar_points")]
    return " | ".join(
        str(x) for x in (len(answers), *own, len(answers) - sum(own), sum(w for _, w in answers))
    )


def rendered_pair(seed: int, camera: UnifiedCamera) -> list[tuple[str, bool]]:
    """Return the answers to one rendered pair, by method and share of the noise.

    None of them where too few features match.
    """
    rng = np.random.default_rng([20261125, seed])
    kind = texture_kinds()[int(rng.integers(len(texture_kinds())))]
    tilt = Rotation.from_rotvec([*rng.uniform(-0.7, 0.7, 2), rng.uniform(-np.pi, np.pi)])
    place = RigidTransform.from_components([*rng.uniform(-0.1, 0.1, 2), rng.uniform(0.4, 0.8)], tilt)
    half = rng.uniform(0.2, 0.6, 2)
    picture = texture(kind, int(rng.integers(10**6)), 512, 512)
    board = Face(place, half, picture)
    goal = motion(rng, length=rng.uniform(0.05, 0.3), turn=rng.uniform(0.1, 0.6))
    one, other = (picture_of([board], camera, pose, rng) for pose in (RigidTransform.identity(), goal))
    try:
        seen = NaturalKind().match(camera, one, other)
    except NoSolutionError:
        return []
    known = goal, np.zeros((6, 6))
    return [
        judged(
            estimate_two_view(
                camera, seen.initial, seen.goal, method=method, windows=seen.window,
                noise=None if share is None else share * seen.noise,
            ),
            known,
        )
        for method, share in itertools.product(METHODS, SHARES)
    ]  # fmt: skip


def rendered_rows(count: int) -> Iterator[str]:
    """Give the table of rendered pairs, row by row."""
    yield "| lens | method | noise stated | pairs | ok | ambiguous | planar | other | sure and wrong |"
    yield "|" + "---|" * 9
    found: dict[str, list[list[tuple[str, bool]]]] = {name: [] for name in LENSES}
    for seed in range(count):
        name = list(LENSES)[seed % len(LENSES)]
        answers = rendered_pair(seed, LENSES[name])
        if answers:
            found[name].append(answers)
        for (method, share), (status, wrong) in zip(
            itertools.product(METHODS, SHARES), answers, strict=False
        ):
            if wrong:
                yield f"seed {seed}, {name}, {method}, {share}: {status}, sure and wrong"
    for name, pairs in found.items():
        for k, (method, share) in enumerate(itertools.product(METHODS, SHARES)):
            yield f"| {name} | {method} | {share or 'not'} | {counted([each[k] for each in pairs])} |"


def main() -> None:
    """Print the table as Markdown."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--rendered", type=int, default=0)
    if (count := parser.parse_args().rendered) > 0:
        for row in rendered_rows(count):
            print(row, flush=True)
        return
    if not all((DATA / name).is_dir() for name in SETS):
        print("real data not present: ../shared/data")
        return
    for row in rows():
        print(row, flush=True)


if __name__ == "__main__":
    main()
