"""Do the ellipsoids of motions from natural features cover what they say?

Run: ``python -m benchmarks.picture_coverage [PAIRS]``. Pairs of rendered pictures of three textured faces,
through a small fisheye, the same with three times the sensor noise, a perspective lens, and a larger
fisheye; natural features are found and matched in them as `omniservo estimate` does. Counted is how
often the truth lies in the 50% and the 95% ellipsoid of the motion (rotation and direction, 5 numbers): of
matches taken to err each by itself, and of such that share what their windows do.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator

import numpy as np
from benchmarks.coverage import covered, motion_law
from benchmarks.pictured_scenes import LENS, OTHER_LENS, crate, motion, picture_of
from scipy.spatial.transform import RigidTransform

from omniservo.cameras import UnifiedCamera
from omniservo.errors import NoSolutionError
from omniservo.estimation import TwoViewEstimate, estimate_two_view
from omniservo.geometry.arrays import FloatArray
from omniservo.perception import MatchedPoints, NaturalKind

LARGE_LENS = UnifiedCamera(300.0, 300.0, 319.5, 239.5, 1.0, 640, 480, max_angle=LENS.max_angle)

SETTINGS = {
    "fisheye, 320 × 240": (LENS, 2.0, 1.0),
    "the same, more noise": (LENS, 6.0, 1.0),
    "perspective, 320 × 240": (OTHER_LENS, 2.0, 1.0),
    "fisheye, 640 × 480": (LARGE_LENS, 2.0, 0.3),
}
"""camera, noise of the sensor [grey values], share of the pairs, since large pictures take long"""

FIRST = 1000
"""The first seed: the constant of `shared_errors` was fitted to pairs before it."""


def pair(camera: UnifiedCamera, grey_noise: float, seed: int) -> tuple[MatchedPoints, RigidTransform] | None:
    """Return what two pictures show both, and the motion between them; None where too few features match."""
    rng = np.random.default_rng([20261122, seed])
    faces, goal = crate(rng), motion(rng)
    first, second = (
        picture_of(faces, camera, pose, rng, noise=grey_noise) for pose in (RigidTransform.identity(), goal)
    )
    try:
        return NaturalKind().match(camera, first, second), goal
    except NoSolutionError:
        return None


def error_of(estimate: TwoViewEstimate, truth: RigidTransform) -> FloatArray:
    """Return (t, δ) of an estimate with ‖t‖ = 1 less the truth."""
    pose = estimate.initial_T_goal
    assert pose is not None
    shift = pose.translation - truth.translation / np.linalg.norm(truth.translation)
    return np.concatenate((shift, (truth.rotation.inv() * pose.rotation).as_rotvec()))


def row(name: str, pairs: int) -> str:
    """Return one setting's line of the table."""
    camera, grey_noise, share = SETTINGS[name]
    hits: dict[tuple[bool, float], list[bool]] = {(o, at): [] for o in (False, True) for at in (0.5, 0.95)}
    matches = []
    for seed in range(FIRST, FIRST + round(share * pairs)):
        if (seen := pair(camera, grey_noise, seed)) is None:
            continue
        matched, truth = seen
        for overlap in (False, True):
            windows = matched.window if overlap else None
            found = estimate_two_view(
                camera, matched.initial, matched.goal, noise=matched.noise, windows=windows
            )
            if found.initial_T_goal is None:
                break
            for at in (0.5, 0.95):
                hits[overlap, at].append(covered(error_of(found, truth), motion_law(found), at))
        else:
            matches.append(len(matched))
    shares = " | ".join(f"{100.0 * np.mean(each):.0f}" for each in hits.values())
    return f"| {name} | {round(share * pairs)} | {len(matches)} | {np.median(matches):.0f} | {shares} |"


def lines(pairs: int = 200) -> Iterator[str]:
    """Measure and give a Markdown table, row by row."""
    yield "| pictures | pairs | ok | matches | alone, 50% | alone, 95% | shared, 50% | shared, 95% |"
    yield "|" + "---|" * 8
    for name in SETTINGS:
        yield row(name, pairs)


def main() -> None:
    """Print the table."""
    for line in lines(*(int(a) for a in sys.argv[1:2])):
        print(line, flush=True)


if __name__ == "__main__":
    main()
