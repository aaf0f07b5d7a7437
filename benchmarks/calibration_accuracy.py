"""Calibration from corners: ours beside cv2.omnidir.calibrate, on real sets and on drawn views.

Run: ``python -m benchmarks.calibration_accuracy``. Real sets are read from ../shared/data and left out where
it is absent. Every draw is seeded and counted. The measures are the same for both: all corners of all views
given, under the camera that came out, with each view's pose adjusted to it.
"""

from __future__ import annotations

import contextlib
import json
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from omniservo import UnifiedCamera, calibrate_camera, preset
from omniservo.calibration.adjustment.calibrate_camera import Distortion
from omniservo.calibration.adjustment.lens import from_physical, ray_errors
from omniservo.calibration.adjustment.poses import poses_from_corners
from omniservo.calibration.adjustment.refine import refine_poses, residuals
from omniservo.calibration.adjustment.views import read_views

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "calibration"))

import board_views

Array = npt.NDArray[np.float64]
DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
SETS = {
    "mei (mirror)": "mei_paracatadioptric/mei.json",
    "fisheye1": "fisheye1/fisheye1.json",
    "camodocal, 62 views": "camodocal_fisheye/camodocal.json",
    "vinsfusion, 85 views": "vinsfusion_calib/all85_corners.json",
}
SEEDS = 10
COUNT = 20


@dataclass(frozen=True)
class Corners:
    """What both calibrations are given."""

    name: str
    pixels: list[Array]
    points: list[Array]
    size: tuple[int, int]


@dataclass(frozen=True)
class Made:
    """What came out."""

    camera: UnifiedCamera | None
    rms: float
    views: int
    seconds: float
    words: str


def real_sets() -> Iterator[Corners]:
    """Read the sets that are there."""
    for name, path in SETS.items():
        if (DATA / path).exists():
            fields = json.loads((DATA / path).read_text())
            corners = (
                [v["corners"] for v in fields["views"]] if "views" in fields else fields["images"].values()
            )
            target = board_views.board(*fields["board_inner_corners"], fields["square_mm"] / 1000.0)
            pixels = [np.array(c, dtype=np.float64) for c in corners]
            yield Corners(name, pixels, [target] * len(pixels), tuple(fields["image_size"]))
    path = DATA / "opencv_omnidir" / "omni_calib_data.xml"
    if path.exists():
        storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
        lists = [
            [node.at(i).mat().reshape(-1, width).astype(np.float64) for i in range(node.size())]
            for node, width in ((storage.getNode("imagePoints"), 2), (storage.getNode("objectPoints"), 3))
        ]
        yield Corners("OpenCV's own", *lists, (1280, 960))  # the file does not say its image's size


def drawn(seed: int, *, views: int = COUNT) -> Corners:
    """Draw views of the paper's fisheye: 9 × 6 corners, 50 mm, 0.12 to 0.3 m off, 0.3 px of noise."""
    seen = board_views.draw_views(
        preset("fe185"), np.random.default_rng(seed), views=views,
        target=board_views.board(9, 6, 0.05), distances=(0.12, 0.3),
    )  # fmt: skip
    return Corners("drawn", *seen, (659, 432))


def ours(corners: Corners, model: Distortion) -> Made:
    """Calibrate with omniservo."""
    found = calibrate_camera(corners.pixels, corners.points, corners.size, distortion=model)
    left = sum(len(rows) for rows in found.corners_dropped.values())
    words = [f"takes {found.distortion}"] if model == "auto" else []
    words += [f"{left} corners dropped"] if left else []
    words += ["ξ not identifiable"] if not found.identifiable.get("xi", False) else []
    words = words if found.camera is not None else [found.message]
    return Made(found.camera, found.rms_px, len(found.views_used), found.seconds, "; ".join(words))


def opencv(corners: Corners, model: Distortion) -> Made:
    """Calibrate with cv2.omnidir."""
    flags = cv2.omnidir.CALIB_FIX_SKEW
    if model == "none":
        flags |= cv2.omnidir.CALIB_FIX_K1 | cv2.omnidir.CALIB_FIX_K2
        flags |= cv2.omnidir.CALIB_FIX_P1 | cv2.omnidir.CALIB_FIX_P2
    stop = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 300, 1e-9)
    began = time.perf_counter()
    try:
        rms, K, xi, D, _, _, used = cv2.omnidir.calibrate(
            [p[None] for p in corners.points], [p[None] for p in corners.pixels], corners.size,
            None, None, None, flags, stop,
        )  # fmt: skip
    except cv2.error as error:
        return Made(None, np.nan, 0, time.perf_counter() - began, str(error).split("error:")[-1][:60])
    seconds = time.perf_counter() - began
    camera = None
    with contextlib.suppress(ValueError):
        x = float(np.ravel(xi)[0])
        camera = UnifiedCamera(K[0, 0], K[1, 1], K[0, 2], K[1, 2], x, *corners.size, distortion=np.ravel(D))
    return Made(camera, float(rms), int(np.size(used)), seconds, "" if camera else "no legal camera")


def on_all(camera: UnifiedCamera, corners: Corners) -> tuple[float, float]:
    """Return the rms of all corners [px] and of their rays [deg], each view's pose adjusted to the camera."""
    views, _ = read_views(corners.pixels, corners.points, corners.size)
    theta = theta_of(camera)
    state, _ = refine_poses(views, poses_from_corners(views, theta, 1.0), scale_px=None)
    errors = residuals(views, state)
    rays = ray_errors(theta, state.points(views), errors)
    return float(np.sqrt((errors**2).sum(1).mean())), float(np.degrees(np.sqrt((rays**2).mean())))


def theta_of(camera: UnifiedCamera) -> Array:
    """Return the adjustment's parameters of a camera."""
    return from_physical([camera.fx, camera.fy, camera.cx, camera.cy, camera.xi, *camera.distortion])


def ray_error(camera: UnifiedCamera, truth: UnifiedCamera) -> float:
    """Return the rms angle [deg] between two cameras' rays of a grid of pixels, after the best rotation."""
    u, v = np.meshgrid(np.arange(0.0, truth.width, 8.0), np.arange(0.0, truth.height, 8.0))
    pixels = np.stack([u.ravel(), v.ravel()], 1)
    (a, in_a), (b, in_b) = truth.unproject(pixels), camera.unproject(pixels)
    both = in_a & in_b & (a[:, 2] > np.cos(np.radians(90.0)))
    rotation, _ = Rotation.align_vectors(a[both], b[both])
    return float(np.degrees(np.sqrt(((a[both] - rotation.apply(b[both])) ** 2).sum(1).mean())))


RUNS: tuple[tuple[str, Callable[[Corners, Distortion], Made], Distortion], ...] = (
    ("ours", ours, "none"),
    ("OpenCV", opencv, "none"),
    ("ours", ours, "radtan"),
    ("OpenCV", opencv, "radtan"),
    ("ours", ours, "auto"),
)
"""By whom, how, and with which model: the rows of both tables."""


def real_rows() -> Iterator[str]:
    """Give the table of the real sets, row by row."""
    yield (
        "| set | model | by | rms of its views [px] | rms of all views [px] | rays of all [deg] "
        "| views | seconds | remarks |"
    )
    yield "|---|---|---|---|---|---|---|---|---|"
    for corners in real_sets():
        for by, calibrate, model in RUNS:
            made = calibrate(corners, model)
            px, deg = on_all(made.camera, corners) if made.camera is not None else (np.nan, np.nan)
            yield (
                f"| {corners.name} | {model} | {by} | {made.rms:.4f} | {px:.4f} | {deg:.4f} "
                f"| {made.views} of {len(corners.pixels)} | {made.seconds:.1f} | {made.words} |"
            )


def drawn_rows() -> Iterator[str]:
    """Give the table of the drawn views: medians over the seeds, and the worst."""
    truth = preset("fe185")
    yield (
        "| model | by | ξ off [%] median, worst | rays off [deg] median, worst | rays on new views [deg] "
        "| ξ called identifiable | seconds |"
    )
    yield "|---|---|---|---|---|---|---|"
    new = board_views.draw_views(truth, np.random.default_rng(999), noise_px=0.0, distances=(0.12, 0.3))
    for by, calibrate, model in RUNS:
        made = [calibrate(drawn(seed), model) for seed in range(SEEDS)]
        cameras = [m.camera for m in made if m.camera is not None]
        xi = [100.0 * abs(camera.xi / truth.xi - 1.0) for camera in cameras]
        rays = [ray_error(camera, truth) for camera in cameras]
        fresh = [on_all(camera, Corners("new", *new, (659, 432)))[1] for camera in cameras]
        said = sum("not identifiable" not in m.words for m in made) if by == "ours" else "–"
        yield (
            f"| {model} | {by} | {np.median(xi):.2f}, {max(xi):.2f} | {np.median(rays):.4f}, {max(rays):.4f} "
            f"| {np.median(fresh):.4f} | {said} of {SEEDS} | {np.median([m.seconds for m in made]):.1f} |"
        )


def main() -> None:
    """Print both tables and the time of 60 views as Markdown, row by row as they are measured."""
    calibrate_camera(*board_views.draw_views(preset("fe185"), np.random.default_rng(0), views=4), (659, 432))
    print("Real corners:\n", flush=True)
    for row in real_rows():
        print(row, flush=True)
    print(f"\n{COUNT} drawn views, {SEEDS} seeds:\n", flush=True)
    for row in drawn_rows():
        print(row, flush=True)
    many: Any = drawn(100, views=60)
    print(f"\n60 views of 54 corners: {ours(many, 'auto').seconds:.1f} s")


if __name__ == "__main__":
    main()
