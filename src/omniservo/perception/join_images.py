"""Several images of one scene: which of their pixels show the same points."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from omniservo.cameras.models import CentralModel
from omniservo.errors import InputError, NoSolutionError
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import BoolArray, ByteArray, FloatArray, IntArray
from omniservo.perception.feature_kind import FeatureKind, MatchedPoints
from omniservo.perception.features import Features
from omniservo.perception.find_dots import check_image
from omniservo.perception.find_features import find_features
from omniservo.perception.find_tags import find_tags
from omniservo.perception.match_features import FeatureMatch, match_features
from omniservo.perception.natural_kind import NaturalKind, matched_points
from omniservo.perception.refine_matches import refine_matches
from omniservo.perception.smear_length import smear_length
from omniservo.perception.tag_kind import TagKind, corner_sigmas

ALL_PAIRS = 8
"""Of so many images every pair is matched; of more, each image with those `MOST_PARTNERS` most like it."""

MOST_PARTNERS = 7
GLANCE = 600
"""strongest features by which the likeness of two images is judged"""

SAME_PX = 2.0
"""Matches that begin and end so near to a point that is already known show that point again."""

EXACT_PX = 1e-6
"""Features that stand at the same place in every match, as dots do, can be chained."""

Progress = Callable[[str, float], object]
"""Called with what is being done, and about what share of an estimate from these images is behind."""

_FOUND, _MATCHED = 0.4, 0.9
"""such shares, when natural features are found in every image, and when all pairs are matched"""


@with_field_docs
@dataclass(frozen=True, eq=False)
class JoinedPoints:
    """n points in v images."""

    pixels: FloatArray
    """(v, n, 2) [px], NaN where not seen"""
    visible: BoolArray
    """(v, n)"""
    noise: FloatArray | None
    """(v, n) σ of a coordinate [px]; None: not known beforehand"""
    window: FloatArray | None
    """(v, n) standard deviation [px] of the window that each was measured in, as its root image shows it,
    however much larger or smaller another one does; None: each errs by itself"""
    ids: IntArray | None
    """(n,) which corners of which tags they are, 4·tag + corner; None: no tags"""
    reasons: tuple[str, ...]
    """(v,) why an image shares no point with any other; empty where it does"""

    def __len__(self) -> int:
        return len(self.visible.T)


class _Pair(NamedTuple):
    """Matches of two images, the root first."""

    root: int
    other: int
    matched: MatchedPoints


def join_images(
    camera: CentralModel,
    images: Sequence[ByteArray],
    kind: FeatureKind,
    progress: Progress = lambda stage, done: None,
) -> JoinedPoints:
    """Match the images in pairs, and join the matches over all of them.

    A natural feature is where it was found in one image, its root, and where its patch lies in the others:
    a point keeps one root, since patches of two roots are not laid on exactly the same place. Roots are taken
    by the number of their matches; what one of them shows already, another does not add. Tags are joined by
    their numbers, dots by their places. Single matches may be wrong: `estimate_views` finds them.

    Args:
        camera: took all images.
        images: (v,) of (height, width) grey values.
        kind: what is looked for.
        progress: called with what is being done, and about what share of an estimate is behind.

    Raises:
        InputError: fewer than two images, or one of another size.
    """
    if len(images) < 2:
        raise InputError(f"images: {len(images)} given; at least 2 are needed")
    for image in images:
        check_image(image, camera)
    if isinstance(kind, TagKind):
        return _of_tags(camera, images, kind)
    if isinstance(kind, NaturalKind):
        pairs, reasons = _natural_pairs(camera, images, progress)
    else:
        pairs, reasons = _pairs_of(camera, images, kind, progress)
    return _joined(len(images), pairs, reasons)


def _of_tags(camera: CentralModel, images: Sequence[ByteArray], kind: TagKind) -> JoinedPoints:
    found = [find_tags(image, camera, kind.dictionary).points for image in images]
    known = [np.empty(0, dtype=np.int64) if points.ids is None else points.ids for points in found]
    values, times = np.unique(np.concatenate(known), return_counts=True)
    ids = values[times > 1]
    pixels, noise = np.full((len(images), len(ids), 2), np.nan), np.ones((len(images), len(ids)))
    for view, (points, numbers) in enumerate(zip(found, known, strict=True)):
        _, rows, columns = np.intersect1d(numbers, ids, return_indices=True)
        pixels[view, columns], noise[view, columns] = points.pixels[rows], corner_sigmas(points)[rows]
    visible = ~np.isnan(pixels[:, :, 0])
    reasons = [
        "" if visible[view].any() else f"{len(numbers) // 4} tags found, none of them in another image"
        for view, numbers in enumerate(known)
    ]
    return JoinedPoints(pixels, visible, noise, None, ids, tuple(reasons))


def _natural_pairs(
    camera: CentralModel, images: Sequence[ByteArray], progress: Progress
) -> tuple[list[_Pair], list[str]]:
    reasons, features = [""] * len(images), []
    for view, image in enumerate(images):
        progress(f"finding features in image {view + 1} of {len(images)}", _FOUND * view / len(images))
        features.append(find_features(image, camera))
        if length := smear_length(image):
            reasons[view] = f"blurred: smeared by motion over {length} px"
    sharp = [view for view in range(len(images)) if not reasons[view]]
    found: dict[tuple[int, int], FeatureMatch] = {}
    chosen = _promising(features, sharp)
    for rank, (a, b) in enumerate(chosen):
        behind = _FOUND + (_MATCHED - _FOUND) * rank / len(chosen)
        progress(f"matching pair {rank + 1} of {len(chosen)}", behind)
        found[a, b] = match_features(features[a], features[b])
        if found[a, b].status != "ok":
            for view in (a, b):
                reasons[view] = reasons[view] or f"{found[a, b].status}: {found[a, b].reason}"
    counts = np.zeros(len(images), dtype=np.int64)
    for (a, b), match in found.items():
        counts[[a, b]] += len(match.pairs)
    pairs = []
    for (a, b), match in found.items():
        if match.status != "ok":
            continue
        swapped = counts[b] > counts[a]
        root, other = (b, a) if swapped else (a, b)
        turned = FeatureMatch(match.pairs[:, ::-1], match.status, match.reason) if swapped else match
        refined = refine_matches(camera, images[root], images[other], features[root], features[other], turned)
        if refined.status == "ok":
            pairs.append(_Pair(root, other, matched_points(refined)))
        else:
            for view in (a, b):
                reasons[view] = reasons[view] or f"{refined.status}: {refined.reason}"
    return pairs, reasons


def _promising(features: Sequence[Features], views: Sequence[int]) -> list[tuple[int, int]]:
    """Return the pairs of views that are matched."""
    pairs = list(combinations(views, 2))
    if len(views) <= ALL_PAIRS:
        return pairs
    alike = np.zeros((len(features), len(features)), dtype=np.int64)
    for a, b in pairs:
        likeness = features[a].descriptors[:GLANCE] @ features[b].descriptors[:GLANCE].T
        if likeness.size:
            forth, back = likeness.argmax(axis=1), likeness.argmax(axis=0)
            alike[a, b] = alike[b, a] = int((back[forth] == np.arange(len(forth))).sum())
    kept = {
        (min(a, int(b)), max(a, int(b)))
        for a in views
        for b in np.argsort(-alike[a], kind="stable")[:MOST_PARTNERS]
        if alike[a, b]
    }
    return sorted(kept)


def _pairs_of(
    camera: CentralModel, images: Sequence[ByteArray], kind: FeatureKind, progress: Progress
) -> tuple[list[_Pair], list[str]]:
    reasons, pairs = [""] * len(images), []
    chosen = list(combinations(range(len(images)), 2))
    for rank, (a, b) in enumerate(chosen):
        progress(f"matching pair {rank + 1} of {len(chosen)}", _MATCHED * rank / len(chosen))
        try:
            pairs.append(_Pair(a, b, kind.match(camera, images[a], images[b])))
        except (InputError, NoSolutionError) as error:
            for view in (a, b):
                reasons[view] = reasons[view] or str(error)
    return pairs, reasons


class _Point:
    """One point: where and how well it is seen, by view."""

    def __init__(self) -> None:
        self.seen: dict[int, tuple[FloatArray, float, float]] = {}

    def add(self, view: int, pixel: FloatArray, noise: float, window: float) -> None:
        """Add an image; of one that is known, the larger noise stays."""
        known = self.seen.get(view)
        self.seen[view] = (
            (pixel, noise, window) if known is None else (known[0], max(noise, known[1]), known[2])
        )


def _joined(views: int, pairs: Sequence[_Pair], reasons: Sequence[str]) -> JoinedPoints:
    """Join matches over the views, roots with most matches first."""
    counts = np.zeros(views)
    for pair in pairs:
        counts[pair.root] += len(pair.matched)
    points: list[_Point] = []
    for root in np.argsort(-counts, kind="stable"):
        begun: dict[tuple[float, float], _Point] = {}
        for pair in (pair for pair in pairs if pair.root == root):
            _add(pair, points, begun)
        points += begun.values()
    shape = views, len(points)
    pixels, noise, window = np.full((*shape, 2), np.nan), np.ones(shape), np.ones(shape)
    for j, point in enumerate(points):
        for view, (pixel, sigma, width) in point.seen.items():
            pixels[view, j], noise[view, j], window[view, j] = pixel, sigma, width
    visible = ~np.isnan(pixels[:, :, 0])
    some = pairs[0].matched if pairs else None
    return JoinedPoints(
        pixels,
        visible,
        noise if some is not None and some.noise is not None else None,
        window if some is not None and some.window is not None else None,
        None,
        tuple("" if visible[view].any() else reasons[view] for view in range(views)),
    )


def _add(pair: _Pair, points: Sequence[_Point], begun: dict[tuple[float, float], _Point]) -> None:
    """Add a pair's matches to the points that begin at its root, or to those that stand at the same place."""
    matched = pair.matched
    noise = np.ones((len(matched), 2)) if matched.noise is None else matched.noise
    window = np.ones(len(matched)) if matched.window is None else matched.window
    there = [point for point in points if pair.root in point.seen]
    near: Any = [[] for _ in range(len(matched))]
    if there:
        tree = cKDTree(np.array([point.seen[pair.root][0] for point in there]))
        near = tree.query_ball_point(matched.initial, SAME_PX)
    for row in range(len(matched)):
        start, end = matched.initial[row], matched.goal[row]
        known = [there[k] for k in near[row]]
        if any(pair.other in p.seen and _apart(p.seen[pair.other][0], end) <= SAME_PX for p in known):
            continue
        same = [p for p in known if _apart(p.seen[pair.root][0], start) <= EXACT_PX]
        if same and pair.other not in same[0].seen:
            same[0].add(pair.other, end, noise[row, 1], window[row])
            continue
        point = begun.setdefault((float(start[0]), float(start[1])), _Point())
        point.add(pair.root, start, noise[row, 0], window[row])
        point.add(pair.other, end, noise[row, 1], window[row])


def _apart(one: FloatArray, other: FloatArray) -> float:
    return float(np.linalg.norm(one - other))
