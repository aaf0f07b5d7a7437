"""Pictures and matches that hold no motion, or not the one they seem to: is any wrong pose called "ok"?

Run: ``python -m benchmarks.hostile_pictures [--count 3000] [--first SEED] [--jobs 2]``. Kinds: identical
pictures, no overlap, motion blur, a repeated pattern, pictures of another camera (natural features, found and
matched in rendered pictures); one wrong tag number (tag corners with 0.1 px of noise, target unknown and
known); points behind a camera (pixels). An answer is *confident and wrong* where its status is "ok" and its
rotation or direction is off by more than `FAR` and lies outside its own 99.99% ellipsoid, unless it lies in
the 99.99% region of the likelihood that the estimate's samples are drawn from: few points leave curved
valleys that no ellipsoid follows. Those are counted, and so are right answers, where there can be any. One
right answer in a thousand lies outside its 99.9% region, so of three thousand cases some do: they are
counted apart.
"""

from __future__ import annotations

import argparse
import math
from collections import Counter
from collections.abc import Callable
from multiprocessing import Pool

import numpy as np
from benchmarks.pictured_scenes import (
    LENS,
    OTHER_LENS,
    WIDE,
    crate,
    motion,
    picture_of,
    smeared,
    stripes,
)
from scipy.spatial.transform import RigidTransform
from scipy.special import chdtrc

from omniservo.cameras import UnifiedCamera
from omniservo.errors import InputError, NoSolutionError
from omniservo.estimation import TwoViewEstimate, estimate_known_target, estimate_two_view
from omniservo.estimation.matches import Matches
from omniservo.estimation.refinement.epipolar_refinement import essential_matrix, sampson_cost
from omniservo.estimation.robust.members import MOTION_PARAMETERS
from omniservo.geometry.arrays import ByteArray, FloatArray, IntArray
from omniservo.perception import NaturalKind

FAR = (math.radians(1.0), math.radians(5.0))
"""of rotation and direction"""

CONFIDENCE = 0.9999
USUAL = 0.999
"""Beyond this an answer is counted apart: it is one that chance explains, but not often."""

FIRST = 1000
"""The first seed: the cases before it were looked at while the estimation was written."""

Answer = tuple[str, bool]
"""what was said, and whether it was confident and wrong"""


def judged(estimate: TwoViewEstimate, truth: RigidTransform | None, matches: Matches | None = None) -> Answer:
    """Return the status and whether it is confident and wrong.

    ``truth`` None: there is no motion; ``matches``: those that two views were estimated from.
    """
    pose = estimate.initial_T_goal
    if pose is None:
        return estimate.status, False
    if truth is None:
        return "ok", True
    turn = (truth.rotation.inv() * pose.rotation).as_rotvec()
    length = np.linalg.norm(pose.translation) / np.linalg.norm(truth.translation)
    if estimate.is_metric:  # else the covariance knows nothing along the translation
        length = 1.0
    shift = pose.translation - length * truth.translation
    cosine = pose.translation @ truth.translation
    swing = math.atan2(float(np.linalg.norm(np.cross(pose.translation, truth.translation))), float(cosine))
    far = float(np.linalg.norm(turn)) > FAR[0] or swing > FAR[1]
    gap = np.concatenate((shift, turn))
    values, vectors = np.linalg.eigh(estimate.covariance)
    along = vectors.T @ gap
    known = values > 1e-9 * values.max()
    square, freedom = float(np.sum(along[known] ** 2 / values[known])), int(known.sum())
    if not far:
        return "ok, right", False
    chance = float(chdtrc(freedom, square))
    if chance >= 1.0 - USUAL:
        return "ok, far within its ellipsoid", False
    if matches is not None:
        chance = max(chance, likelihood_of(estimate, matches, truth))
    if chance >= 1.0 - USUAL:
        return "ok, far within its curved valley", False
    if chance >= 1.0 - CONFIDENCE:
        return "ok, beyond 99.9%", False
    return "ok, wrong", True


def likelihood_of(estimate: TwoViewEstimate, matches: Matches, truth: RigidTransform) -> float:
    """Return by what chance the truth lies so far out in the likelihood: S − S₀ against σ² χ²₅."""
    members, costs, essential = matches.where(estimate.inliers), [], np.empty((3, 3))
    for pose in (truth, estimate.initial_T_goal):
        assert pose is not None
        direction = pose.translation / np.linalg.norm(pose.translation)
        essential_matrix(pose.rotation.as_matrix(), direction, essential)
        costs.append(sampson_cost(members.bearings, members.jacobians, math.inf, essential))
    variance = max(estimate.noise_px, matches.noise_px) ** 2
    return float(chdtrc(MOTION_PARAMETERS, max(costs[0] - costs[1], 0.0) / variance))


def estimated(
    camera: UnifiedCamera,
    initial: FloatArray,
    goal: FloatArray,
    noise: FloatArray | float,
    squares: IntArray | None = None,
    windows: FloatArray | None = None,
) -> tuple[TwoViewEstimate, Matches]:
    """Return the estimate of two views, and the matches as it saw them."""
    pixels, sigmas = np.concatenate((initial, goal), axis=1), np.broadcast_to(noise, (len(goal), 2))
    found = estimate_two_view(camera, initial, goal, noise=noise, squares=squares, windows=windows)
    return found, Matches.of_pixels(camera, pixels, np.array(sigmas))


def from_pictures(
    camera: UnifiedCamera, initial: ByteArray, goal: ByteArray, truth: RigidTransform | None
) -> Answer:
    """Return what natural features of two pictures say."""
    try:
        matched = NaturalKind().match(camera, initial, goal)
        pixels = matched.initial, matched.goal
        found, matches = estimated(camera, *pixels, matched.noise, windows=matched.window)
    except (NoSolutionError, InputError) as error:
        return str(error).split(":")[1 if isinstance(error, NoSolutionError) else 0].strip()[:40], False
    return judged(found, truth, matches)


def identical(rng: np.random.Generator) -> Answer:
    """The same picture twice, or two of one view with noise of their own."""
    faces = crate(rng)
    first = picture_of(faces, LENS, RigidTransform.identity(), rng)
    second = first if rng.uniform() < 0.5 else picture_of(faces, LENS, RigidTransform.identity(), rng)
    return from_pictures(LENS, first, second, None)


def no_overlap(rng: np.random.Generator) -> Answer:
    """Two scenes that have nothing in common."""
    first = picture_of(crate(rng), LENS, RigidTransform.identity(), rng)
    second = picture_of(crate(rng), LENS, motion(rng), rng)
    return from_pictures(LENS, first, second, None)


def motion_blur(rng: np.random.Generator) -> Answer:
    """The goal picture, or both, smeared over 3 to 25 pixels."""
    faces, goal = crate(rng), motion(rng)
    pictures = [picture_of(faces, LENS, pose, rng) for pose in (RigidTransform.identity(), goal)]
    pictures[1] = smeared(pictures[1], 2 * int(rng.integers(1, 13)) + 1, rng)
    if rng.uniform() < 0.5:
        pictures[0] = smeared(pictures[0], 2 * int(rng.integers(1, 13)) + 1, rng)
    return from_pictures(LENS, *pictures, goal)


def repeated_pattern(rng: np.random.Generator) -> Answer:
    """Faces whose picture repeats: shifted by a tile it looks the same."""
    faces, goal = crate(rng, stripes(rng)), motion(rng)
    pictures = [picture_of(faces, LENS, pose, rng) for pose in (RigidTransform.identity(), goal)]
    return from_pictures(LENS, *pictures, goal)


def another_camera(rng: np.random.Generator) -> Answer:
    """Pictures of a perspective lens, or of a longer fisheye, read with this fisheye's calibration."""
    faces, goal = crate(rng), motion(rng)
    longer = rng.uniform(1.15, 1.6)
    fisheye = UnifiedCamera(LENS.fx * longer, LENS.fy * longer, LENS.cx, LENS.cy, LENS.xi, 320, 240)
    taken = OTHER_LENS if rng.uniform() < 0.5 else fisheye
    pictures = [picture_of(faces, taken, pose, rng) for pose in (RigidTransform.identity(), goal)]
    return from_pictures(LENS, *pictures, goal)


def wrong_tag(rng: np.random.Generator, tags_are_square: bool = True) -> Answer:
    """Five tags, one of which is taken for another that lies elsewhere."""
    corners = 0.5 * np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])
    while True:
        places = [RigidTransform.from_components([*rng.uniform(-0.25, 0.25, 2), rng.uniform(0.4, 0.6)],
                                                 motion(rng).rotation) for _ in range(6)]  # fmt: skip
        goal = motion(rng)
        tags = np.concatenate([place.apply(0.06 * corners) for place in places])
        images = [LENS.project(pose.inv().apply(tags)) for pose in (RigidTransform.identity(), goal)]
        if all(valid.all() and LENS.in_image(pixels).all() for pixels, valid in images):
            break
    initial, seen = (pixels + 0.1 * rng.standard_normal(pixels.shape) for pixels, _ in images)
    mistaken = rng.integers(2)  # in the goal picture only, or in both
    seen[16:20] = seen[20:24]
    if mistaken:
        initial[16:20] = initial[20:24]
    squares = np.arange(20).reshape(5, 4) if tags_are_square else None
    if rng.uniform() < 0.5:
        pixels = initial[:20], seen[:20]
        return judged(estimate_known_target(LENS, tags[:20], *pixels, noise=0.1, squares=squares), goal)
    found, matches = estimated(LENS, initial[:20], seen[:20], 0.1, squares)
    return judged(found, goal, matches)


def points_behind(rng: np.random.Generator) -> Answer:
    """Up to 45% of the goal's rays turned round: the epipolar constraint holds, the rays meet behind."""
    n = int(rng.integers(12, 40))
    while True:
        angle, around = rng.uniform(0.9, 2.2, n), rng.uniform(-np.pi, np.pi, n)
        across = np.column_stack((np.cos(around), np.sin(around)))
        rays = np.column_stack((np.sin(angle)[:, None] * across, np.cos(angle)))
        points = rng.uniform(0.4, 0.7, (n, 1)) * rays
        goal = motion(rng)
        seen = goal.inv().apply(points)
        seen[: int(rng.uniform(0.1, 0.45) * n)] *= -1.0
        images = [WIDE.project(points), WIDE.project(seen)]
        if not all(valid.all() and WIDE.in_image(pixels).all() for pixels, valid in images):
            continue
        noisy = [pixels + 0.2 * rng.standard_normal(pixels.shape) for pixels, _ in images]
        if all(WIDE.unproject(pixels)[1].all() for pixels in noisy):
            break
    found, matches = estimated(WIDE, *noisy, 0.2)
    return judged(found, goal, matches)


KINDS: dict[str, Callable[[np.random.Generator], Answer]] = {
    "identical pictures": identical,
    "no overlap": no_overlap,
    "motion blur": motion_blur,
    "repeated pattern": repeated_pattern,
    "another camera": another_camera,
    "one wrong tag number": wrong_tag,
    "points behind": points_behind,
}


def one_case(case: tuple[str, int]) -> tuple[str, int, Answer]:
    """Return a case with its answer; the seed decides everything."""
    kind, seed = case
    return kind, seed, KINDS[kind](np.random.default_rng([sorted(KINDS).index(kind), seed]))


def main() -> None:
    """Print a table of answers by kind."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--count", type=int, default=3000)
    parser.add_argument("--first", type=int, default=FIRST)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--kinds", nargs="*", default=list(KINDS))
    arguments = parser.parse_args()
    each = math.ceil(arguments.count / len(arguments.kinds))
    cases = [
        (kind, seed) for seed in range(arguments.first, arguments.first + each) for kind in arguments.kinds
    ]
    said: dict[str, Counter[str]] = {kind: Counter() for kind in arguments.kinds}
    wrong = 0
    with Pool(arguments.jobs) as pool:
        for kind, seed, (words, bad) in pool.imap_unordered(one_case, cases, chunksize=7):
            said[kind][words] += 1
            wrong += bad
            if bad:
                print(f"confident and wrong: {kind}, seed {seed}", flush=True)
    for kind, counts in said.items():
        print(f"{kind}: " + ", ".join(f"{words} {n}" for words, n in counts.most_common()))
    print(f"{len(cases)} cases, {wrong} confident wrong poses")


if __name__ == "__main__":
    main()
