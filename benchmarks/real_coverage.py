"""Is the stated covariance of two-view motion worth something on real photographs?

Run: ``python -m benchmarks.real_coverage``. The sets are read from ../shared/data and left out where absent.
Every two images of a set are a pair. Matches are natural ones that are found here, with those on the person
who took the images and without ("still": what is seen in every image must stand still), or those that the set
gives (wrong ones included, no flags used); the board and what is beside it are left out of both, so that the
pose from the board alone is independent of them. The camera is calibrated here, from the corners of all views
of the set.

The truth is the board's pose under the set's camera model of least residual. Its own covariance is that of
independent noise of the corners, of the size that the residuals show, and the outer product of what the
pose differs by under the set's other model.

A pair counts as held where the square of (direction, rotation)'s error in the sum of both covariances, 5
numbers, is within the quantile of χ²₅. "In σ" is the root of the median of that square over the law's.
"""

from __future__ import annotations

import itertools
import json
import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from benchmarks.calibration_accuracy import Corners, real_sets
from scipy.spatial.transform import RigidTransform
from scipy.stats import chi2

from omniservo import UnifiedCamera, calibrate_camera, estimate_pose, estimate_two_view
from omniservo.calibration import Calibration
from omniservo.camera_files.usual_error import usual_error
from omniservo.errors import NoSolutionError
from omniservo.estimation import TwoViewEstimate
from omniservo.files.image_files import read_grey_image
from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.perception.feature_kind import MatchedPoints
from omniservo.perception.natural_kind import NaturalKind

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
SETS = ("vinsfusion_calib", "fisheye2")
MODELS = ("ba_radtan", "ba_pure")
"""of the set: that of least residual, and the other one"""

TURNED = {"fisheye2": ("Fisheye2_13.jpg", "Fisheye2_15.jpg"), "vinsfusion_calib": ("left-0000.png",)}
"""Views whose corners begin at the opposite one: the board of an even number both ways does not tell."""

SAME = {"fisheye2": ("Fisheye2_16.jpg",)}
"""images that are another's copy"""

PERSON = {
    "Fisheye2_1.jpg": (330, 480, 345, 360, 370, 335, 560, 300, 650, 100, 700, 260, 640, 330, 590, 480),
    "Fisheye2_2.jpg": (470, 480, 480, 400, 620, 350, 640, 400, 560, 480),
    "Fisheye2_4.jpg": (130, 360, 200, 360, 200, 480, 130, 480),
    "Fisheye2_5.jpg": (455, 480, 500, 400, 515, 330, 600, 270, 690, 250, 680, 400, 560, 480),
    "Fisheye2_6.jpg": (330, 480, 340, 440, 440, 435, 560, 385, 640, 410, 560, 480),
    "Fisheye2_7.jpg": (320, 480, 320, 340, 430, 370, 520, 310, 680, 310, 620, 480),
    "Fisheye2_8.jpg": (100, 300, 150, 300, 170, 400, 110, 400),
    "Fisheye2_9.jpg": (105, 280, 170, 280, 170, 395, 105, 395),
    "Fisheye2_10.jpg": (290, 480, 300, 360, 345, 350, 420, 345, 580, 365, 650, 430, 600, 480),
    "Fisheye2_11.jpg": (90, 130, 170, 130, 165, 250, 245, 400, 255, 480, 150, 480, 90, 300),
    "Fisheye2_12.jpg": (140, 250, 195, 250, 210, 310, 305, 400, 305, 480, 200, 480, 140, 350),
    "Fisheye2_13.jpg": (190, 480, 190, 360, 300, 380, 380, 440, 480, 415, 560, 435, 580, 480),
    "Fisheye2_14.jpg": (160, 480, 160, 355, 220, 355, 300, 380, 400, 440, 420, 480),
    "Fisheye2_15.jpg": (370, 480, 470, 440, 490, 390, 540, 320, 640, 300, 690, 340, 640, 430, 560, 480),
}
"""Outlines [px] by image, u, v, u, v …, drawn by hand, of the person who took the images."""

BESIDE_PX = 15.0
"""Matches so near to the board's outline are left out."""

LEAST_MATCHES = 12
"""Pairs with fewer natural matches show no common scene; they are told, not scored."""


@dataclass(frozen=True, eq=False)
class RealSet:
    """The corners and images of one camera."""

    name: str
    size: tuple[int, int]
    board: FloatArray
    """(k, 3) [m]"""
    corners: dict[str, FloatArray]
    """by image; more than there are image files"""
    models: tuple[UnifiedCamera, ...]
    given: dict[tuple[str, str], tuple[FloatArray, FloatArray]]
    """by pair: matches (n, 2) [px] in either image"""

    @classmethod
    def read(cls, name: str) -> RealSet:
        """Return the set of this name."""
        folder = DATA / name
        pairs = json.loads((folder / "pairs.json").read_text())
        corners = folder / "all85_corners.json"
        fields = json.loads((corners if corners.exists() else folder / f"{name}.json").read_text())
        seen = fields.get("images") or {v["image"]: v["corners"] for v in fields["views"]}
        columns, rows = fields["board_inner_corners"]
        x, y = np.meshgrid(np.arange(columns), np.arange(rows))
        board = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3) * fields["square_mm"] / 1000.0
        ordered = {
            k: np.array(v)[::-1] if k in TURNED.get(name, ()) else np.array(v)
            for k, v in seen.items()
            if k not in SAME.get(name, ())
        }
        size = tuple(pairs["image_size"])
        models = tuple(_model(pairs["models"][m], size) for m in MODELS)
        given = {(p["image1"], p["image2"]): (np.array(p["u1"]), np.array(p["u2"])) for p in pairs["pairs"]}
        return cls(name, size, board, ordered, models, given)

    @cached_property
    def images(self) -> dict[str, Any]:
        """Grey values by name, of those images that there are."""
        files = {k: DATA / self.name / k for k in self.corners}
        return {k: read_grey_image(path) for k, path in files.items() if path.exists()}

    def calibrated(self) -> Calibration:
        """Return the set's own calibration."""
        found = calibrate_camera(list(self.corners.values()), [self.board] * len(self.corners), self.size)
        if found.camera is None:
            raise RuntimeError(found.message)
        return found

    def poses(self, image: str) -> list[tuple[RigidTransform, FloatArray]]:
        """Return board_T_camera and its covariance, of each model."""
        found = [estimate_pose(m, self.board, self.corners[image], robust=False) for m in self.models]
        return [(f.reference_T_camera, f.covariance) for f in found if f.reference_T_camera is not None]

    def truth(self, one: str, other: str) -> tuple[RigidTransform, FloatArray]:
        """Return initial_T_goal and its covariance (6, 6) [m], [rad]."""
        first, second = self.poses(one), self.poses(other)
        moves = [a.inv() * b for (a, _), (b, _) in zip(first, second, strict=True)]
        return moves[0], motion_covariance(first[0], second[0]) + sum(
            np.outer(d, d) for d in (difference(moves[0], m) for m in moves[1:])
        )

    def beside_board(self, image: str, pixels: FloatArray) -> BoolArray:
        """Tell which pixels (n, 2) lie on the board or beside it."""
        hull = cv2.convexHull(self.corners[image].astype(np.float32))
        far = np.array([cv2.pointPolygonTest(hull, (float(u), float(v)), True) for u, v in pixels])
        square = float(np.linalg.norm(np.diff(self.corners[image][:2], axis=0)))
        return np.asarray(far > -(BESIDE_PX + 1.5 * square))

    def on_person(self, image: str, pixels: FloatArray) -> BoolArray:
        """Tell which pixels (n, 2) lie on the person who took the images."""
        outline = np.array(PERSON.get(image, ()), dtype=np.float32).reshape(-1, 2)
        if not len(outline):
            return np.zeros(len(pixels), dtype=np.bool_)
        inside = [cv2.pointPolygonTest(outline, (float(u), float(v)), False) for u, v in pixels]
        return np.asarray(np.array(inside) >= 0)


def _model(fields: dict[str, Any], size: tuple[int, ...]) -> UnifiedCamera:
    names = ("fx", "fy", "cx", "cy", "xi")
    return UnifiedCamera(*(fields[n] for n in names), *size, distortion=fields["D"] or (0.0,) * 4)


def difference(one: RigidTransform, other: RigidTransform) -> FloatArray:
    """Return (t, δ) from one pose to the other, δ on the right."""
    turn = (one.rotation.inv() * other.rotation).as_rotvec()
    return np.concatenate((other.translation - one.translation, turn))


def motion_covariance(
    first: tuple[RigidTransform, FloatArray], second: tuple[RigidTransform, FloatArray]
) -> FloatArray:
    """Return the covariance (6, 6) of first⁻¹ second, both poses being independent."""
    (a, spread_a), (b, spread_b) = first, second
    total, base = np.zeros((6, 6)), a.inv() * b
    for pose, spread, is_first in ((a, spread_a, True), (b, spread_b, False)):
        values, vectors = np.linalg.eigh(spread)
        for row in (vectors * np.sqrt(np.maximum(values, 0.0))).T:
            moved = RigidTransform.from_components(
                pose.translation + row[:3], pose.rotation * type(pose.rotation).from_rotvec(row[3:])
            )
            step = difference(base, moved.inv() * b if is_first else a.inv() * moved)
            total += np.outer(step, step)
    return total


@dataclass(frozen=True)
class Score:
    """One estimate beside the truth."""

    rotation_deg: float
    direction_deg: float
    square: float
    """of the error in both covariances, 5 numbers"""
    stated_deg: tuple[float, float]
    """root mean square σ of rotation and direction over their axes [deg]"""


def score(estimate: TwoViewEstimate, truth: tuple[RigidTransform, FloatArray]) -> Score:
    """Return how far an estimate is from the truth, ‖t‖ aside."""
    assert estimate.initial_T_goal is not None
    return score_of(estimate.initial_T_goal, estimate.covariance, truth)


def score_of(pose: RigidTransform, covariance: FloatArray, truth: tuple[RigidTransform, FloatArray]) -> Score:
    """Return how far a motion with its covariance is from the truth, ‖t‖ aside."""
    true, spread = truth
    length, true_length = np.linalg.norm(pose.translation), np.linalg.norm(true.translation)
    direction, true_direction = pose.translation / length, true.translation / true_length
    across = np.linalg.svd(true_direction[None])[2][1:]
    turn = (true.rotation.inv() * pose.rotation).as_rotvec()
    error = np.concatenate((across @ direction, turn))
    basis = np.zeros((5, 6))
    basis[:2, :3], basis[2:, 3:] = across, np.eye(3)
    stated = basis @ (covariance / np.outer(unit := _unit(length), unit)) @ basis.T
    known = basis @ (spread / np.outer(unit := _unit(true_length), unit)) @ basis.T
    swing = math.atan2(float(np.linalg.norm(across @ direction)), float(direction @ true_direction))
    return Score(
        math.degrees(float(np.linalg.norm(turn))),
        math.degrees(swing),
        float(error @ np.linalg.solve(stated + known, error)),
        (
            math.degrees(math.sqrt(np.trace(stated[2:, 2:]) / 3.0)),
            math.degrees(math.sqrt(np.trace(stated[:2, :2]) / 2.0)),
        ),
    )


def _unit(length: float) -> FloatArray:
    return np.array([length] * 3 + [1.0] * 3)


def natural(camera: UnifiedCamera, data: RealSet, one: str, other: str) -> MatchedPoints | None:
    """Return the natural matches of two images off the board; None where they cannot be matched."""
    try:
        found = NaturalKind().match(camera, data.images[one], data.images[other])
    except NoSolutionError:
        return None
    off = ~(data.beside_board(one, found.initial) | data.beside_board(other, found.goal))
    return found.where(np.flatnonzero(off))


def calibrated_camera(found: Calibration, source: str) -> UnifiedCamera:
    """Return the set's camera.

    ``source`` "calibration": as `calibrate_camera` gives it, with its covariance. "file": the same numbers as
    another program would have left them in a file, with the usual model error and no covariance.
    """
    camera = found.camera
    assert camera is not None
    if source == "calibration":
        return camera
    fields = {**camera.to_dict(), "model_error": None, "calibration_covariance": None}
    error = usual_error(UnifiedCamera.from_dict(fields), {})
    return UnifiedCamera.from_dict({**fields, "model_error": error.to_dict()})


def estimates(
    data: RealSet, found: Calibration, whose: str, source: str
) -> Iterator[tuple[str, int, TwoViewEstimate, tuple[RigidTransform, FloatArray]]]:
    """Give (pair, matches, estimate, truth) of all pairs of a set with its own calibration."""
    camera = calibrated_camera(found, source)
    if whose == "given":
        camera = UnifiedCamera.from_dict({**camera.to_dict(), "max_angle": None})
    for one, other in itertools.combinations(data.images, 2):
        name = f"{one.split('.')[0]}–{other.split('.')[0]}"
        if whose == "given":
            if (one, other) not in data.given:
                continue
            initial, goal = data.given[one, other]
            off = ~(data.beside_board(one, initial) | data.beside_board(other, goal))
            off &= camera.unproject(initial)[1] & camera.unproject(goal)[1]
            options: dict[str, Any] = {}
            initial, goal = initial[off], goal[off]
        else:
            matched = natural(camera, data, one, other)
            if matched is not None and whose == "still":
                moves = data.on_person(one, matched.initial) | data.on_person(other, matched.goal)
                matched = matched.where(np.flatnonzero(~moves))
            if matched is None or len(matched) < LEAST_MATCHES:
                continue
            initial, goal = matched.initial, matched.goal
            options = {"noise": matched.noise, "windows": matched.window}
        estimate = estimate_two_view(camera, initial, goal, **options)
        yield name, len(initial), estimate, data.truth(one, other)


def rows(verbose: bool = False) -> Iterator[str]:
    """Give the table, row by row."""
    yield (
        "| camera | set | matches | pairs | answered | refused as | rotation median / worst [°] "
        "| direction median / worst [°] | ≤ 1° and ≤ 3° | in σ | 50% holds | 95% holds |"
    )
    yield "|" + "---|" * 12
    sets = [(data, data.calibrated()) for data in map(RealSet.read, SETS)]
    for source in ("calibration", "file"):
        whole: list[Score] = []
        count = 0
        for (data, found), whose in itertools.product(sets, ("given", "natural", "still")):
            if whose == "still" and PERSON.keys().isdisjoint(data.images):
                continue
            scores, refused, pairs = [], Counter[str](), 0
            for pair, n, estimate, truth in estimates(data, found, whose, source):
                pairs += 1
                if estimate.status == "ok":
                    scores.append(score(estimate, truth))
                else:
                    refused[estimate.status] += 1
                if verbose:
                    said = scores[-1] if estimate.status == "ok" else estimate.status
                    print(f"  {pair} {n} matches: {said} {estimate.message}", flush=True)
            yield _row((source, data.name, whose), pairs, refused, scores)
            if whose != "still":
                whole, count = whole + scores, count + pairs
        yield _row((source, "all", ""), count, Counter(), whole)


def error_rows() -> Iterator[str]:
    """Give what calibrations find of their model error, set by set."""
    yield "| set | views | distortion | rms [px] | σ [px] | σ / side [10⁻⁴] | σ / rms | ℓ / side |"
    yield "|" + "---|" * 8
    for corners in (*real_sets(), _corners("fisheye2")):
        found = calibrate_camera(corners.pixels, corners.points, corners.size)
        if found.camera is None or found.camera.model_error is None:
            continue
        error, side = found.camera.model_error, max(corners.size)
        numbers = f"{1e4 * error.sigma_px / side:.1f} | {error.sigma_px / found.rms_px:.1f}"
        yield (
            f"| {corners.name} | {len(found.views_used)} | {found.distortion} | {found.rms_px:.3f} "
            f"| {error.sigma_px:.3f} | {numbers} | {error.length_px / side:.2f} |"
        )


def _corners(name: str) -> Corners:
    data = RealSet.read(name)
    return Corners(name, list(data.corners.values()), [data.board] * len(data.corners), data.size)


def _row(what: tuple[str, str, str], pairs: int, refused: Counter[str], scores: list[Score]) -> str:
    turns, swings = ([getattr(s, k) for s in scores] or [math.nan] for k in ("rotation_deg", "direction_deg"))
    squares = np.array([s.square for s in scores] or [math.nan])
    good = sum(s.rotation_deg <= 1.0 and s.direction_deg <= 3.0 for s in scores)
    why = ", ".join(f"{k} {v}" for k, v in refused.most_common()) or "–"
    held = [f"{100.0 * np.mean(squares <= chi2.ppf(level, 5)):.0f}%" for level in (0.5, 0.95)]
    sigmas = math.sqrt(float(np.median(squares)) / float(chi2.ppf(0.5, 5)))
    return (
        f"| {' | '.join(what)} | {pairs} | {len(scores)} | {why} | {np.median(turns):.2f} / {max(turns):.2f} "
        f"| {np.median(swings):.2f} / {max(swings):.2f} | {good} | {sigmas:.1f} | {held[0]} | {held[1]} |"
    )


def main() -> None:
    """Print the table as Markdown."""
    import sys

    if not all((DATA / name).is_dir() for name in SETS):
        print("real data not present: ../shared/data")
        return
    for table in (rows("--pairs" in sys.argv), error_rows()):
        for row in table:
            print(row, flush=True)
        print()


if __name__ == "__main__":
    main()
