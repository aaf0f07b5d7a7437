"""Which dot of one image is which dot of another, without being given it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations
from typing import Literal

import numpy as np

from omniservo.cameras.models import CentralModel
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import BoolArray, FloatArray, IntArray, finite_array, finite_number
from omniservo.geometry.nearest_rotation import nearest_rotation
from omniservo.perception.dot_centres import circles, tangent_ellipses
from omniservo.perception.dots import FoundDots
from omniservo.perception.epipolar_kernels import score_hypotheses
from omniservo.perception.match_kernels import register_triples

LEAST_PAIRS = 8
"""with fewer, two views of points say too little about their motion"""
TRIPLES = 10
"""triples of the first view that are tried on all of the second"""
MOST_HYPOTHESES = 20_000
VERIFIED = 40
"""so many of the best hypotheses are verified"""
RIVALS = 4
"""so many of one dot's exchanges with the others are kept: any two of them contradict each other"""
UNMATCHED = 40.0
"""cost of a dot that could have had a partner"""
GOOD = 4.0
"""a match is accepted up to this rms deviation, in standard deviations"""
RATIO, GAP = 2.5, 25.0
"""every other match must cost at least RATIO times as much as the best, and GAP more"""


@with_field_docs
@dataclass(frozen=True)
class DotMatch:
    """What `match_dots` found; only ``status`` "ok" is a match."""

    pairs: IntArray
    """(k, 2) indices of the first and of the second image's dots, by the first; empty unless "ok" """
    status: Literal["ok", "ambiguous", "no_match", "too_few"]
    residual_px: float
    """rms distance from the epipolar constraint of the best hypothesis; infinite where there is none"""
    rival: float
    """cost of the best contradicting hypothesis over that of the best one; infinite where there is none"""
    reason: str
    """one sentence"""


@dataclass(frozen=True)
class _View:
    cloud: FloatArray
    """(n, 3) positions in radii of a dot"""
    deviation: FloatArray
    """(n,) relative standard deviation of the distances"""
    side: FloatArray
    """(n, 11), see score_hypotheses"""
    index: IntArray
    """(n,) number of the dot in its image"""


def match_dots(
    camera: CentralModel, dots_a: FoundDots, dots_b: FoundDots, *, noise_px: float = 0.03
) -> DotMatch:
    """Match the dots of two images of one rigid target; refuse where the answer is not clear.

    1. Hypothesise: the size and shape of a dot's image give its distance in radii (`circles`), hence a
       rough cloud of points in each view. Triples of one cloud are laid on all triples of the other that
       have about their sides; mutually nearest dots pair up.
    2. Verify: for the best hypotheses the motion that fits the epipolar constraint best is computed; cost
       are the squared constraint (4 degrees of freedom for 9 dots) and the squared deviation of the ratios
       of distances from those of the sizes, in variances.
    3. Decide: the best hypothesis must fit within the noise, and every one that contradicts it, exchanges
       of any two dots included, must be clearly worse.

    The target may have any shape; its dots have one radius. FoundDots seen in only one of the images stay
    unmatched.

    Args:
        camera: the camera that took both images.
        dots_a: dots of the first image.
        dots_b: dots of the second image.
        noise_px: standard deviation of a dot's centre [px].

    Raises:
        InputError: the dots are not finite or of the wrong shape, or the noise is not in 0.001…5 px.
    """
    noise = finite_number("noise_px", noise_px, minimum=1e-3, maximum=5)
    view_a, view_b = _view("dots_a", camera, dots_a, noise), _view("dots_b", camera, dots_b, noise)
    n, m = len(view_a.index), len(view_b.index)
    if min(n, m) < LEAST_PAIRS:
        return _refused("too_few", f"{n} and {m} dots; at least {LEAST_PAIRS} are needed in both pictures")
    partners, motions = _hypotheses(view_a, view_b)
    if not len(partners):
        return _refused("no_match", "no rigid motion brings eight dots of the pictures together")
    scored = _scored(view_a, view_b, partners, motions)
    for exchanged in _exchanges(scored.partners[0], scored.motions[0]):
        scored = scored.joined(_scored(view_a, view_b, *exchanged).first(RIVALS))
    if not scored.fits()[0]:
        smaller = _without_one(scored.partners[:5], scored.motions[:5])
        if len(smaller[0]):
            scored = scored.joined(_scored(view_a, view_b, *smaller))
    return _decide(view_a, view_b, scored, noise)


@dataclass(frozen=True)
class _Scored:
    """Verified hypotheses, best first."""

    partners: IntArray
    """(h, n) partner of each dot of the first view, -1 for none"""
    motions: FloatArray
    """(h, 12) R by rows, then t"""
    costs: FloatArray
    """(h, 2) epipolar and size part"""
    total: FloatArray
    """(h,) cost with what unmatched dots cost"""

    def first(self, count: int) -> _Scored:
        """So many of the best."""
        return _Scored(self.partners[:count], self.motions[:count], self.costs[:count], self.total[:count])

    def joined(self, other: _Scored) -> _Scored:
        """Both, best first."""
        total = np.concatenate([self.total, other.total])
        order = np.argsort(total, kind="stable")
        stacked = [
            np.concatenate([getattr(self, name), getattr(other, name)])[order]
            for name in ("partners", "motions", "costs")
        ]
        return _Scored(stacked[0], stacked[1], stacked[2], total[order])

    def fits(self) -> BoolArray:
        """Whether each hypothesis agrees with both constraints within the noise."""
        count = (self.partners >= 0).sum(1)
        epipolar = self.costs[:, 0] <= GOOD**2 * np.maximum(count - 5, 1)
        return np.asarray(epipolar & (self.costs[:, 1] <= 18.0 * count))


def _hypotheses(view_a: _View, view_b: _View) -> tuple[IntArray, FloatArray]:
    """Distinct pairings with at least LEAST_PAIRS pairs, the likeliest first, and their rough motions."""
    n = len(view_a.index)
    distance = np.linalg.norm(view_b.cloud, axis=1)
    variance = 2.0 * (view_b.deviation * distance) ** 2 + 0.1
    partners = np.empty((MOST_HYPOTHESES, n), dtype=np.int64)
    scores, motions = np.empty(MOST_HYPOTHESES), np.empty((MOST_HYPOTHESES, 12))
    triples = _spread_triples(view_a.cloud)
    count = register_triples(view_a.cloud, view_b.cloud, variance, triples, partners, scores, motions)
    order = np.argsort(scores[:count], kind="stable")
    order = order[(partners[order] >= 0).sum(1) >= LEAST_PAIRS]
    _, first = np.unique(partners[order], axis=0, return_index=True)
    best = _completed(partners[order[np.sort(first)[:VERIFIED]]], len(view_b.index))
    return best, _rigid_motions(view_a, view_b, best)


def _completed(partners: IntArray, m: int) -> IntArray:
    """The pairings, and after them those that leave one dot on each side, with these two paired."""
    rows = [partners]
    for row in partners[(partners < 0).sum(1) == 1]:
        left = np.setdiff1d(np.arange(m), row)
        if len(left) == 1:
            rows.append(np.where(row < 0, left[0], row)[None])
    return np.unique(np.concatenate(rows), axis=0)


def _rigid_motions(view_a: _View, view_b: _View, partners: IntArray) -> FloatArray:
    """Least-squares motion (h, 12) between paired dots of the two clouds (Kabsch); near dots weigh more."""
    paired = partners >= 0
    distance = np.linalg.norm(view_a.cloud, axis=1)
    weight = paired / (view_a.deviation * distance + 0.2) ** 2
    weight = weight / weight.sum(1, keepdims=True)
    targets = view_b.cloud[np.maximum(partners, 0)]
    mean_a, mean_b = weight @ view_a.cloud, (weight[..., None] * targets).sum(1)
    off_a, off_b = view_a.cloud - mean_a[:, None], targets - mean_b[:, None]
    rotation = nearest_rotation((weight[..., None] * off_b).swapaxes(1, 2) @ off_a)
    t = mean_b - (rotation @ mean_a[..., None])[..., 0]
    return np.concatenate([rotation.reshape(-1, 9), t], axis=1)


def _spread_triples(cloud: FloatArray) -> IntArray:
    """Triples of dots (k, 3) with the largest triangles, no dot in more than half of them."""
    some = np.linspace(0, len(cloud) - 1, min(len(cloud), 24)).astype(np.int64)
    triples = some[np.array(list(combinations(range(len(some)), 3)), dtype=np.int64)]
    p, q, r = (cloud[triples[:, k]] for k in range(3))
    order = np.argsort(-np.linalg.norm(np.cross(q - p, r - p), axis=1), kind="stable")
    uses = np.zeros(len(cloud), dtype=np.int64)
    chosen: list[IntArray] = []
    for triple in triples[order]:
        if len(chosen) < TRIPLES and uses[triple].max() < TRIPLES // 2:
            chosen.append(triple)
            uses[triple] += 1
    return np.array(chosen, dtype=np.int64)


def _scored(view_a: _View, view_b: _View, partners: IntArray, motions: FloatArray) -> _Scored:
    counts = (partners >= 0).sum(1)
    most = min(len(view_a.index), len(view_b.index))
    pairs = np.zeros((len(partners), partners.shape[1], 2), dtype=np.int64)
    for h, row in enumerate(partners):
        known = np.flatnonzero(row >= 0)
        pairs[h, : counts[h]] = np.stack([known, row[known]], 1)
    motions, costs = np.array(motions), np.empty((len(partners), 2))
    score_hypotheses(view_a.side, view_b.side, pairs, counts, motions, costs)
    total = costs.sum(1) + UNMATCHED * (most - counts)
    order = np.argsort(total, kind="stable")
    return _Scored(partners[order], motions[order], costs[order], total[order])


def _exchanges(partner: IntArray, motion: FloatArray) -> Iterator[tuple[IntArray, FloatArray]]:
    """Yield every exchange of two partners of one hypothesis: what two dots close to each other invite.

    Of n dots there are n²/2, a row of n each: those of one dot at a time need little memory.
    """
    known = np.flatnonzero(partner >= 0)
    for first, i in enumerate(known[:-1], start=1):
        rows = np.tile(partner, (len(known) - first, 1))
        for row, k in zip(rows, known[first:], strict=True):
            row[[i, k]] = row[[k, i]]
        yield rows, np.tile(motion, (len(rows), 1))


def _without_one(partners: IntArray, motions: FloatArray) -> tuple[IntArray, FloatArray]:
    """Each hypothesis with each of its pairs left out, where LEAST_PAIRS remain."""
    rows, starts = [], []
    for partner, motion in zip(partners, motions, strict=True):
        known = np.flatnonzero(partner >= 0)
        if len(known) <= LEAST_PAIRS:
            continue
        for i in known:
            row = partner.copy()
            row[i] = -1
            rows.append(row)
            starts.append(motion)
    return np.array(rows, dtype=np.int64), np.array(starts)


def _decide(view_a: _View, view_b: _View, scored: _Scored, noise: float) -> DotMatch:
    best, cost = scored.partners[0], scored.total[0]
    both = (scored.partners >= 0) & (best >= 0)
    contradicts = (both & (scored.partners != best)).any(1)
    rival = float(scored.total[contradicts].min()) if contradicts.any() else np.inf
    known = np.flatnonzero(best >= 0)
    residual = noise * float(np.sqrt(scored.costs[0, 0] / max(len(known) - 5, 1)))
    ratio = rival / max(float(cost), 1e-9)
    if not scored.fits()[0]:
        reason = f"the best of the pairings leaves {residual:.2g} px from the epipolar constraint"
        return _refused("no_match", reason, residual, ratio)
    if rival < max(RATIO * cost, cost + GAP):
        reason = f"a contradicting pairing fits almost as well ({ratio:.1f} times the cost)"
        return _refused("ambiguous", reason, residual, ratio)
    pairs = np.stack([view_a.index[known], view_b.index[best[known]]], 1)
    return DotMatch(pairs, "ok", residual, ratio, f"{len(known)} dots paired")


def _refused(
    status: Literal["ambiguous", "no_match", "too_few"],
    reason: str,
    residual: float = np.inf,
    rival: float = np.inf,
) -> DotMatch:
    return DotMatch(np.zeros((0, 2), dtype=np.int64), status, residual, rival, reason)


def _view(name: str, camera: CentralModel, dots: FoundDots, noise: float) -> _View:
    """Bearings, clouds and their uncertainties of the dots whose outline the camera can unproject."""
    pixels = finite_array(f"{name}.pixels", dots.pixels, (None, 2))
    covariance = finite_array(f"{name}.covariance", dots.covariance, (len(pixels), 2, 2))
    bearings, jacobian, seen = camera.unproject_jacobian(pixels)
    frames, centre, spread, valid = tangent_ellipses(camera, pixels, covariance)
    _, _, distance = circles(frames, centre, spread)
    # the area of a dot of A px² is found to about 0.5 px² + 0.4%, and distance goes with its square root
    deviation = 0.002 + 0.25 / (4.0 * np.pi * np.sqrt(np.maximum(np.linalg.det(covariance), 1e-6)))
    index = np.flatnonzero(seen & valid)
    columns = [bearings, noise * jacobian.reshape(-1, 6), np.log(distance)[:, None], deviation[:, None]]
    side = np.ascontiguousarray(np.concatenate(columns, axis=1)[index])
    return _View(bearings[index] * distance[index, None], deviation[index], side, index)
