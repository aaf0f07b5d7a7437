"""Which natural feature of one image is which of another, or why that cannot be determined."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import BoolArray, FloatArray, IntArray
from omniservo.perception.features import Features
from omniservo.perception.rival_kernels import best_and_rival

LEAST_PAIRS = 8
"""with fewer, two views of points say too little about their motion"""
RATIO = 0.8
"""a partner is nearer than this part of the distance to the most similar feature elsewhere (Lowe)"""
TWINS = 0.25
"""descriptor distance, of at most √2, below which two places look the same; the most similar one elsewhere
is at about 0.45 on rough surfaces, at 0.1 on a pattern that repeats"""
LARGEST_GAP = 0.7
"""descriptor distance, of at most √2, beyond which two places do not look the same"""
ELSEWHERE = 3.0
"""[scales] nearer to a feature is the same place, seen at another scale or orientation"""
LEAST_SHARE = 0.5
"""of clear pairs to repeated ones: on a pattern that repeats, every tenth wrong pair looks clear"""

Status = Literal["ok", "ambiguous", "too_few", "blurred"]


@with_field_docs
@dataclass(frozen=True, eq=False)
class FeatureMatch:
    """What `match_features` found; only ``status`` "ok" is a match."""

    pairs: IntArray
    """(m, 2) indices of initial and goal features, most similar first; empty unless "ok" """
    status: Status
    """"ambiguous": a pattern repeats, and what does not is too little; "too_few": fewer than eight pairs"""
    reason: str
    """one sentence"""

    def __post_init__(self) -> None:
        pairs = np.array(self.pairs)
        pairs.setflags(write=False)
        object.__setattr__(self, "pairs", pairs)


def match_features(initial: Features, goal: Features) -> FeatureMatch:
    """Pair features that are each other's most similar one, where nothing elsewhere looks like them.

    The most similar feature elsewhere is looked for in both images, and for both members of the pair: in
    its own image, too, it must not have a twin. A pair with a twin is a repeated one. A pattern that
    repeats and is seen one period on looks more like itself than like the right place, since near and far,
    straight and slanted, change the look: pairs are then many, alike, and wrong together. Where repeated
    pairs outnumber the clear ones by two to one, the answer is therefore "ambiguous".

    Single pairs may still be wrong; see `refine_matches`.
    """
    if min(len(initial), len(goal)) < LEAST_PAIRS:
        return _refused(
            "too_few", f"{len(initial)} and {len(goal)} features; {LEAST_PAIRS} are needed in both"
        )
    across = initial.descriptors @ goal.descriptors.T
    best, gap, rival = _nearest(across, goal, itself=False)
    back, _, rival_back = _nearest(np.ascontiguousarray(across.T), initial, itself=False)
    twin, twin_goal = (_nearest(f.descriptors @ f.descriptors.T, f, itself=True)[2] for f in (initial, goal))
    i = np.flatnonzero(back[best] == np.arange(len(best)))
    j = best[i]
    elsewhere = np.minimum.reduce([rival[i], rival_back[j], twin[i], twin_goal[j]])
    repeated = elsewhere < TWINS
    clear = ~repeated & (gap[i] < RATIO * elsewhere)
    count, many = int(clear.sum()), int(repeated.sum())
    if many >= LEAST_PAIRS and count < LEAST_SHARE * many:
        words = f"{many} pairs look like other places of the pictures, {count} do not: a pattern repeats"
        return _refused("ambiguous", words)
    if count < LEAST_PAIRS:
        return _refused("too_few", f"{count} features are found again; {LEAST_PAIRS} are needed")
    order = np.argsort(gap[i][clear], kind="stable")
    return FeatureMatch(np.stack([i[clear], j[clear]], axis=1)[order], "ok", f"{count} pairs")


def match_near(initial: Features, goal: Features, near: BoolArray) -> IntArray:
    """Pair (m, 2) features that are each other's most similar one of those ``near`` (n, n') each other.

    Nothing near looks like them, and they look alike: `LARGEST_GAP`. What looks like them elsewhere does not
    count.
    """
    across = np.where(near, initial.descriptors @ goal.descriptors.T, np.float32(-1.0))
    best, gap, rival = _nearest(across, goal, itself=False)
    back, _, rival_back = _nearest(np.ascontiguousarray(across.T), initial, itself=False)
    i = np.flatnonzero((back[best] == np.arange(len(best))) & (gap < LARGEST_GAP))
    clear = gap[i] < RATIO * np.minimum(rival[i], rival_back[best[i]])
    return np.stack([i[clear], best[i][clear]], axis=1)


def _refused(status: Status, reason: str) -> FeatureMatch:
    return FeatureMatch(np.zeros((0, 2), dtype=np.int64), status, reason)


def _nearest(
    similarity: npt.NDArray[np.float32], columns: Features, *, itself: bool
) -> tuple[IntArray, FloatArray, FloatArray]:
    """For each row the most similar column, its distance, and that of the best one elsewhere, (n,) each."""
    n = len(similarity)
    best, rival = np.empty(n, dtype=np.int64), np.empty(n, dtype=np.int64)
    reach = np.maximum(ELSEWHERE * columns.scale, ELSEWHERE)
    best_and_rival(similarity, columns.points.pixels, reach, itself, best, rival)
    rows = np.arange(n)
    gap, other = (np.sqrt(np.maximum(2.0 - 2.0 * similarity[rows, k], 0.0)) for k in (best, rival))
    return best, gap, np.where(rival < 0, np.sqrt(2.0), other)
