"""Projection, calibration and stated uncertainty: ours beside mrcal on the same points and corners.

Run: ``python -m benchmarks.comparisons.mrcal.compare``; it needs Debian's python3-mrcal and mrcal. Real
corners are those of ``benchmarks.calibration_accuracy``, left out where ../shared/data is absent.

Projection: pixels all over the image, unprojected by ours, projected by both, and unprojected again, for
every lens that both have.

Calibration: each set's views are halved, every second one. Each half makes a camera, by `calibrate_camera`
as it is and by ``mrcal-calibrate-cameras`` as it is (it estimates the board's warp as well), which is given
our focal length to start from. mrcal has no unified model: it gets OPENCV8, and the splined stereographic
model of order 3 with 16 × 11 knots over our field. Held out: the other half's corners, all of them, each
view's pose adjusted. Both say how uncertain a pixel's place is: mrcal at infinity, ours after the best
rotation of the camera's frame. By how much the two halves' cameras differ after the best rotation, at 200
of the corners, is what that should have predicted (root mean squares of a coordinate): a ratio above 1 is
overconfident. On drawn corners the truth stands in the other half's place: 20 views of a distorted
perspective camera, 0.3 px of noise, which both models hold exactly; median of the seeds.
"""

from __future__ import annotations

import json
import math
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from benchmarks.calibration_accuracy import Corners, board_views, on_all, real_sets
from benchmarks.comparisons.libraries import plane_focal
from scipy.spatial.transform import Rotation

from omniservo import UnifiedCamera, calibrate_camera
from omniservo.cameras.models.central_model import CentralModel
from omniservo.cameras.models.equirectangular import Equirectangular
from omniservo.cameras.models.pinhole import Pinhole
from omniservo.geometry.arrays import FloatArray

PYTHON = "/usr/bin/python3"
PROGRAM = Path(__file__).with_name("answers.py")
PACKAGE, COMMAND = "python3-mrcal", "mrcal-calibrate-cameras"
PIXELS = 200
SEEDS = 6
TRUTH = UnifiedCamera(420.0, 425.0, 322.0, 238.0, 0.0, 640, 480, distortion=(-0.25, 0.08, 0.001, -0.002))
DISTORTION = (-0.25, 0.12, 0.001, -0.002, -0.02, 0.05, 0.03, -0.01, 0.002, -0.001, 0.001, 0.0005)
CORE = (420.0, 425.0, 322.0, 238.0)
LENSES: dict[str, tuple[CentralModel, tuple[float, ...]]] = {
    "PINHOLE": (UnifiedCamera(*CORE, 0.0, 640, 480), CORE),
    "OPENCV4": (TRUTH, (*CORE, *TRUTH.distortion)),
    "OPENCV5": (Pinhole(*CORE, 640, 480, distortion=DISTORTION[:5]), (*CORE, *DISTORTION[:5])),
    "OPENCV8": (Pinhole(*CORE, 640, 480, distortion=DISTORTION[:8]), (*CORE, *DISTORTION[:8])),
    "OPENCV12": (Pinhole(*CORE, 640, 480, distortion=DISTORTION), (*CORE, *DISTORTION)),
    "STEREOGRAPHIC": (UnifiedCamera(300.0, 305.0, 322.0, 238.0, 1.0, 640, 480), (150.0, 152.5, 322.0, 238.0)),
    "LONLAT": (Equirectangular(640, 320), (320.0 / math.pi, 320.0 / math.pi, 319.5, 159.5)),
}
"""mrcal's name without LENSMODEL_ → (ours, mrcal's numbers); the stereographic projection is ξ = 1"""


@dataclass(frozen=True)
class Made:
    """What a calibration of one half says."""

    rms: float
    held_out: float
    outliers: int
    bearings: FloatArray
    """(3, m, 3) of the pixels asked for, and of those 1 px farther in u and in v; NaN: none"""
    stated: FloatArray
    """(m,) standard deviation of a coordinate [px]"""
    seconds: float
    words: str

    @property
    def per_px(self) -> FloatArray:
        """(m,) angle of a pixel [rad], root mean square of both directions."""
        steps = np.linalg.norm(self.bearings[1:] - self.bearings[0], axis=2)
        return np.asarray(np.sqrt((steps**2).mean(axis=0)))


def answer(**given: Any) -> dict[str, Any]:
    """Return mrcal's answer (`answers`).

    Raises:
        RuntimeError: it has none; with its last words.
    """
    done = subprocess.run([PYTHON, str(PROGRAM)], input=json.dumps(given), capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError((done.stderr or "no words").strip().splitlines()[-1])
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def projection_rows() -> Iterator[str]:
    """Yield how far apart both project and unproject, lens by lens."""
    for name, (camera, intrinsics) in LENSES.items():
        u, v = np.meshgrid(
            np.linspace(1.0, camera.width - 2.0, 33), np.linspace(1.0, camera.height - 2.0, 25)
        )
        bearings, valid = camera.unproject(np.stack([u.ravel(), v.ravel()], axis=1))
        bearings = bearings[valid]
        found = answer(
            task="project", lensmodel=f"LENSMODEL_{name}", intrinsics=intrinsics, points=bearings.tolist()
        )
        apart = np.linalg.norm(camera.project(bearings)[0] - np.array(found["pixels"]), axis=1).max()
        turned = np.linalg.norm(bearings - np.array(found["back"]), axis=1).max()
        yield f"| {name} | {len(bearings)} | {apart:.1e} | {turned:.1e} |"


def by_us(corners: Corners, held_out: Corners | None, at: FloatArray) -> tuple[Made, UnifiedCamera]:
    """Return what ours says.

    Raises:
        RuntimeError: there is no camera.
    """
    found = calibrate_camera(corners.pixels, corners.points, corners.size)
    camera = found.camera
    if camera is None:
        raise RuntimeError(found.message)
    bearings = np.stack([_bearings(camera, at + step) for step in ([0.0, 0.0], [1.0, 0.0], [0.0, 1.0])])
    held = math.nan if held_out is None else on_all(camera, held_out)[0]
    dropped = sum(len(rows) for rows in found.corners_dropped.values())
    words = "unified, distorted" if found.distortion == "radtan" else "unified"
    angle = np.arccos(np.clip(bearings[0, :, 2], -1.0, 1.0))
    rays = np.radians(np.interp(angle, found.ray_angles, found.ray_deviation_turned_deg))
    made = Made(found.rms_px, held, dropped, bearings, rays, found.seconds, words)
    return replace(made, stated=rays / math.sqrt(2.0) / made.per_px), camera


def _bearings(camera: UnifiedCamera, pixels: FloatArray) -> FloatArray:
    bearings, valid = camera.unproject(pixels)
    return np.asarray(np.where(valid[:, None], bearings, np.nan))


def by_mrcal(
    corners: Corners, held_out: Corners | None, at: FloatArray, lensmodel: str, focal: float
) -> Made:
    """Return what mrcal says.

    Raises:
        RuntimeError: there is no camera.
    """
    board = corners.points[0]
    columns = int((board[:, 1] == board[0, 1]).sum())
    begin = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        found = answer(
            task="calibrate", lensmodel=lensmodel, focal=focal, size=corners.size,
            board=[columns, len(board) // columns], square=float(board[1, 0] - board[0, 0]),
            views=[view.tolist() for view in corners.pixels], at=at.tolist(), folder=folder,
            held_out=[] if held_out is None else [view.tolist() for view in held_out.pixels],
        )  # fmt: skip
    held = math.nan if found["held_out"] is None else found["held_out"]
    words = "splined" if "SPLINED" in lensmodel else lensmodel.removeprefix("LENSMODEL_")
    seconds = time.perf_counter() - begin
    numbers = np.array(found["bearings"]), np.array(found["stated"])
    return Made(found["rms"], held, found["outliers"], *numbers, seconds, words)


def apart(made: Made, bearings: FloatArray) -> tuple[float, FloatArray]:
    """Return by how much a coordinate differs from others' bearings after the best rotation, rms [px].

    And where that could be told, (m,).
    """
    use = np.isfinite(made.bearings).all(axis=(0, 2)) & np.isfinite(bearings).all(axis=1)
    if use.sum() < 3:
        return math.nan, use
    turn, _ = Rotation.align_vectors(made.bearings[0][use], bearings[use])
    off = np.linalg.norm(made.bearings[0][use] - turn.apply(bearings[use]), axis=1) / made.per_px[use]
    return float(np.sqrt((off**2).mean() / 2.0)), use


def halves_row(name: str, made: tuple[Made, Made]) -> str:
    """Return the row of one set and one calibrator."""
    differ, use = apart(made[0], made[1].bearings[0])
    stated = math.sqrt(sum(float(np.mean(half.stated[use] ** 2)) for half in made))

    def both(what: str) -> float:
        return math.sqrt(sum(getattr(half, what) ** 2 for half in made) / 2.0)

    cells = [name, made[0].words, f"{both('rms'):.3f}", f"{both('held_out'):.3f}",
             sum(half.outliers for half in made), f"{differ:.3f}", f"{stated:.3f}",
             f"{differ / stated:.2f}", f"{sum(half.seconds for half in made):.0f}"]  # fmt: skip
    return "| " + " | ".join(map(str, cells)).replace("nan", "–") + " |"


def real_rows() -> Iterator[str]:
    """Yield the rows of the real sets."""
    for corners in real_sets():
        if corners.name == "OpenCV's own":
            continue  # its target is no board of one size
        halves = [
            Corners(corners.name, corners.pixels[k::2], corners.points[k::2], corners.size) for k in (0, 1)
        ]
        pixels = np.concatenate(corners.pixels)
        at = pixels[np.random.default_rng(0).permutation(len(pixels))[:PIXELS]]
        ours = [by_us(halves[k], halves[1 - k], at) for k in (0, 1)]
        yield halves_row(f"{corners.name} | omniservo", (ours[0][0], ours[1][0]))
        camera = ours[0][1]
        field = min(2.0 * math.degrees(camera.max_angle or math.pi / 2.0) + 10.0, 220.0)
        splined = f"LENSMODEL_SPLINED_STEREOGRAPHIC_order=3_Nx=16_Ny=11_fov_x_deg={field:.0f}"
        for lensmodel in ("LENSMODEL_OPENCV8", splined):
            yield _mrcal_row(corners.name, halves, at, lensmodel, plane_focal(camera))


def _mrcal_row(name: str, halves: list[Corners], at: FloatArray, lensmodel: str, focal: float) -> str:
    try:
        made = [by_mrcal(halves[k], halves[1 - k], at, lensmodel, focal) for k in (0, 1)]
    except RuntimeError as error:
        return f"| {name} | mrcal | {lensmodel} | none: {str(error)[:80]} | | | | | | |"
    return halves_row(f"{name} | mrcal", (made[0], made[1]))


def drawn_rows() -> Iterator[str]:
    """Yield what both are off the truth on drawn corners, and what they state."""
    u, v = np.meshgrid(np.linspace(40.0, 600.0, 16), np.linspace(40.0, 440.0, 12))
    at = np.stack([u.ravel(), v.ravel()], axis=1)
    truth, _ = TRUTH.unproject(at)
    found: dict[str, list[tuple[float, float]]] = {}
    for seed in range(SEEDS):
        drawn = board_views.draw_views(
            TRUTH, np.random.default_rng(seed), views=20, target=board_views.board(9, 6, 0.03),
            largest_angle=math.radians(40.0), distances=(0.25, 0.6),
        )  # fmt: skip
        corners = Corners("drawn", *drawn, (640, 480))
        ours, camera = by_us(corners, None, at)
        theirs = by_mrcal(corners, None, at, "LENSMODEL_OPENCV4", plane_focal(camera))
        for by, made in (("omniservo", ours), ("mrcal", theirs)):
            off, use = apart(made, truth)
            found.setdefault(by, []).append((off, float(np.sqrt(np.mean(made.stated[use] ** 2)))))
    for by, pairs in found.items():
        off, stated = np.array(pairs).T
        ratios = off / stated
        yield f"| {by} | {np.median(off):.3f} / {off.max():.3f} | {np.median(stated):.3f} |" \
            f" {np.median(ratios):.2f} / {ratios.max():.2f} |"  # fmt: skip


def lines() -> Iterator[str]:
    """Yield the tables; or why there are none."""
    if shutil.which(COMMAND) is None:
        yield f"Not run: Debian's mrcal and {PACKAGE} are not installed (no {COMMAND} here)."
        return
    yield "| lens | points | pixels apart, most [px] | bearings apart, most |"
    yield "|---" * 4 + "|"
    yield from projection_rows()
    yield ""
    yield "| corners | by | model | rms [px] | held out [px] | corners dropped | halves differ [px] |" \
        " stated [px] | differ / stated | s |"  # fmt: skip
    yield "|---" * 10 + "|"
    yield from real_rows()
    yield ""
    yield f"| {SEEDS} × 20 drawn views | off the truth, median / worst [px] | stated [px] |" \
        " off / stated, median / worst |"  # fmt: skip
    yield "|---" * 4 + "|"
    yield from drawn_rows()


def main() -> None:
    """Print the tables."""
    for line in lines():
        print(line, flush=True)


if __name__ == "__main__":
    main()
