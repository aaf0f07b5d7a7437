"""Do the ellipsoids cover what they say?

Run: ``python -m benchmarks.coverage [SCENES]``, or with ``--camera-error``: then the true camera of each
scene differs from the stated one by a smooth random field over the image (`ModelError`), which is stated or
not; what counts is rotation and direction in the whole stated covariance.

Random scenes (those of `benchmarks.estimation_speed`) of each of three cameras; a scene counts where the
status is "ok". Counted is how often the truth lies in the 95% ellipsoid of the motion (rotation and
direction, 5 numbers; with a known length between two points also ‖t‖, 6), of the whole structure (3n numbers
at once) and of its points one by one, and in the 95% interval of the scale. Ellipsoids are those of
`TwoViewEstimate.uncertainty`: F where σ comes from the residuals, χ² where it was given; of the whole
structure F with its `structure_freedom`.
"""

from __future__ import annotations

import math
import sys
from collections import Counter
from collections.abc import Iterator

import numpy as np
from benchmarks.estimation_speed import Scene, random_scene
from scipy.special import chdtri, fdtri

from omniservo.cameras import ModelError, UnifiedCamera, preset
from omniservo.estimation import TwoViewEstimate, estimate_two_view
from omniservo.estimation.estimate_two_view import Scale
from omniservo.geometry.arrays import FloatArray

CAMERAS = ("fe185", "perspective", "para-catadioptric")
LEVEL = 0.95
SCALE_SIGMA = 0.03

SETTINGS = (
    (20, 0.1, False),
    (20, 0.1, True),
    (50, 0.1, False),
    (9, 0.5, False),
    (9, 0.5, True),
    (9, 0.1, False),
)
"""points, noise [px], whether the noise is given"""


def coverage(name: str, n: int, noise: float, given: bool, scenes: int) -> dict[str, float]:
    """Return the share of scenes that each 95% region covers, and the share with status "ok"."""
    camera, rng = preset(name), np.random.default_rng([20120601, n])
    hits: Counter[str] = Counter()
    for _ in range(scenes):
        scene = random_scene(rng, camera, n, noise)
        known = (0, 1), float(np.linalg.norm(scene.points[0] - scene.points[1]))
        factor = 1.0 + SCALE_SIGMA * rng.standard_normal()
        stated = float(np.linalg.norm(scene.initial_T_goal.translation)) / factor
        hits["scenes"] += 1
        plain = _estimate(camera, scene, noise if given else None, stated, SCALE_SIGMA)
        if plain.initial_T_goal is None:
            continue
        hits["ok"] += 1
        hits["motion, 5"] += covered(_error(plain, scene, factor), motion_law(plain))
        error = (plain.points - scene.points / factor).ravel()
        law = plain.uncertainty
        assert law is not None
        hits["structure, 3n"] += _covered_structure(error, plain)
        hits["points"] += _points_covered(error, plain)
        hits["stated scale"] += abs(factor - 1.0) < 1.96 * plain.scale_sigma
        metric = _estimate(camera, scene, noise if given else None, known, 0.0)
        if metric.initial_T_goal is not None:
            hits["with length"] += 1
            hits["motion, 6"] += covered(_error(metric, scene, 1.0), motion_law(metric, 6))
            hits["length of t"] += _length_covered(metric, scene)
    return {
        k: v / (hits["with length"] if k in ("motion, 6", "length of t") else hits["ok"])
        for k, v in hits.items()
    }


def _estimate(
    camera: UnifiedCamera, scene: Scene, noise: float | None, scale: Scale | None, sigma: float
) -> TwoViewEstimate:
    return estimate_two_view(
        camera,
        scene.pixels_initial,
        scene.pixels_goal,
        scale=scale,
        scale_sigma=sigma,
        noise=noise,
        robust=False,
    )


def _error(estimate: TwoViewEstimate, scene: Scene, factor: float) -> FloatArray:
    """Return (t, δ) of the estimate less the truth, in the estimate's scale."""
    pose, truth = estimate.initial_T_goal, scene.initial_T_goal
    assert pose is not None
    turn = (truth.rotation.inv() * pose.rotation).as_rotvec()
    return np.concatenate((pose.translation - truth.translation / factor, turn))


def motion_law(estimate: TwoViewEstimate, size: int = 5) -> tuple[FloatArray, FloatArray, float]:
    """Return a basis of what is free, the noise's scale matrix in it, and its degrees of freedom."""
    law, pose = estimate.uncertainty, estimate.initial_T_goal
    assert law is not None
    assert pose is not None
    basis = np.eye(6)
    if size == 5:
        across = np.linalg.svd(pose.translation[None])[2][1:].T
        basis = np.zeros((6, 5))
        basis[:3, :2], basis[3:, 2:] = across, np.eye(3)
    rows = law.noise[:, :6] @ basis
    return basis, rows.T @ rows, law.freedom


def covered(error: FloatArray, law: tuple[FloatArray, FloatArray, float], level: float = LEVEL) -> bool:
    """Tell whether an error lies in the ellipsoid of a law of `motion_law`."""
    basis, matrix, freedom = law
    inner = basis.T @ error
    return _square(inner, matrix) < _quantile(len(inner), freedom, level)


def _square(error: FloatArray, matrix: FloatArray) -> float:
    """Return eᵀM⁻¹e; a point nearly at infinity has variances of another order than all others."""
    unit = 1.0 / np.sqrt(np.diag(matrix))
    scaled = unit * error
    values, vectors = np.linalg.eigh(unit[:, None] * matrix * unit)
    return float(np.sum(np.square(scaled @ vectors) / np.maximum(values, np.finfo(float).eps)))


def _covered_structure(error: FloatArray, estimate: TwoViewEstimate) -> bool:
    law = estimate.uncertainty
    assert law is not None
    rows, n = law.noise[:, 6:], len(law.own)
    matrix = rows.T @ rows
    for j in range(n):
        matrix[3 * j : 3 * j + 3, 3 * j : 3 * j + 3] += law.own[j]
    return _square(error, matrix) < _quantile(3 * n, law.structure_freedom)


def _points_covered(error: FloatArray, estimate: TwoViewEstimate) -> float:
    """Return the share of points whose own 95% ellipsoid covers them."""
    law = estimate.uncertainty
    assert law is not None
    rows = law.noise[:, 6:].reshape(len(law.noise), -1, 3)
    matrices = law.own + np.einsum("kmi,kmj->mij", rows, rows)
    gaps = error.reshape(-1, 3)
    squares = [_square(gap, matrix) for gap, matrix in zip(gaps, matrices, strict=True)]
    return float(np.mean(np.array(squares) < _quantile(3, law.freedom)))


def _length_covered(estimate: TwoViewEstimate, scene: Scene) -> bool:
    pose, law = estimate.initial_T_goal, estimate.uncertainty
    assert pose is not None
    assert law is not None
    length = float(np.linalg.norm(pose.translation))
    along = law.noise[:, :3] @ pose.translation / length
    gap = length - float(np.linalg.norm(scene.initial_T_goal.translation))
    return gap * gap < _quantile(1, law.freedom) * float(along @ along)


def _quantile(size: int, freedom: float, level: float = LEVEL) -> float:
    if math.isinf(freedom):
        return float(chdtri(size, 1.0 - level))
    return float(size * fdtri(size, freedom, level))


FIELD_LENGTH = 0.2
"""of the image's width"""

FIELD_SIGMAS = (0.1, 0.3, 0.5)
"""[px]"""

FIELD_SETTINGS = ((20, 0.5), (20, 0.1), (60, 0.2), (200, 0.5), (200, 0.1))
"""points, noise [px]"""


def field_coverage(
    name: str, sigma: float, n: int, noise: float, scenes: int, *, given: bool = True
) -> dict[str, float]:
    """Return the share of answers that the 95% ellipsoid of motion covers, the field stated and not."""
    exact, rng = preset(name), np.random.default_rng([20261124, n])
    error = ModelError(sigma, FIELD_LENGTH * exact.width)
    stated = UnifiedCamera.from_dict({**exact.to_dict(), "model_error": error.to_dict()})
    hits: Counter[str] = Counter()
    for _ in range(scenes):
        scene = random_scene(rng, exact, n, noise)
        moves = error.moves(np.concatenate((scene.pixels_initial, scene.pixels_goal), axis=1))
        planted = np.einsum("k,knc->nc", rng.standard_normal(len(moves)), moves)
        seen = [scene.pixels_initial + planted[:, :2], scene.pixels_goal + planted[:, 2:]]
        if not all(exact.unproject(pixels)[1].all() for pixels in seen):
            continue
        hits["scenes"] += 1
        for what, camera in (("stated", stated), ("not stated", exact)):
            found = estimate_two_view(camera, *seen, noise=noise if given else None, robust=False)
            if found.initial_T_goal is None:
                continue
            hits[f"{what}, ok"] += 1
            basis = motion_law(found)[0]
            law = basis, basis.T @ found.covariance @ basis, math.inf
            length = float(np.linalg.norm(scene.initial_T_goal.translation))
            hits[what] += covered(_error(found, scene, length), law)
    answers = {k: hits[k] / max(hits[f"{k}, ok"], 1) for k in ("stated", "not stated")}
    return {"ok": hits["stated, ok"] / hits["scenes"], **answers}


def field_lines(scenes: int = 200) -> Iterator[str]:
    """Measure and give a Markdown table, row by row: shares covered, the field stated (and not stated)."""
    yield "| points | noise [px] | camera | " + " | ".join(f"field {x:g} px" for x in FIELD_SIGMAS) + " |"
    yield "|" + "---|" * (3 + len(FIELD_SIGMAS))
    for n, noise in FIELD_SETTINGS:
        for name in CAMERAS:
            found = [field_coverage(name, sigma, n, noise, scenes) for sigma in FIELD_SIGMAS]
            shares = [f"{100.0 * f['stated']:.0f} ({100.0 * f['not stated']:.0f})" for f in found]
            yield f"| {n} | {noise:g} | {name} | " + " | ".join(shares) + " |"


NAMES = ("motion, 5", "motion, 6", "length of t", "structure, 3n", "points", "stated scale")


def lines(scenes: int = 2000) -> Iterator[str]:
    """Measure and give a Markdown table, row by row."""
    yield "| points | noise [px] | camera | ok | " + " | ".join(NAMES) + " |"
    yield "|" + "---|" * (4 + len(NAMES))
    for n, noise, given in SETTINGS:
        for name in CAMERAS:
            found = coverage(name, n, noise, given, scenes)
            said = f"{noise:g}, {'given' if given else 'estimated'}"
            shares = " | ".join(f"{100 * found.get(k, math.nan):.1f}" for k in NAMES)
            yield f"| {n} | {said} | {name} | {100 / found['scenes']:.1f} | {shares} |"


def main() -> None:
    """Print the table."""
    options = [a for a in sys.argv[1:] if a != "--camera-error"]
    made = field_lines if len(options) < len(sys.argv) - 1 else lines
    for line in made(*(int(a) for a in options[:1])):
        print(line, flush=True)


if __name__ == "__main__":
    main()
