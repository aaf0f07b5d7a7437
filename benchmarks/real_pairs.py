"""Two-view motion on real photographs: from given matches and from our own, beside a board's pose.

Run: ``python -m benchmarks.real_pairs``. The set is read from ../shared/data and left out where absent.
The camera is calibrated here, from the board's corners; the matches (given with their wrong ones and without
flags, or found in the images) come from the background; the reference pose comes from the board alone, under
one of three camera models whose spread is its uncertainty.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from omniservo import UnifiedCamera, calibrate_camera, estimate_two_view
from omniservo.files.image_files import read_grey_image
from omniservo.perception import match_images

FOLDER = Path(__file__).resolve().parents[2] / "shared" / "data" / "vinsfusion_calib"
REFERENCE = "radtan"
"""the board's pose under the camera model with the least residual"""


def read_pairs() -> list[dict[str, Any]]:
    """Return the pairs of the set."""
    pairs: list[dict[str, Any]] = json.loads((FOLDER / "pairs.json").read_text())["pairs"]
    return pairs


def own_camera(step: int = 1) -> UnifiedCamera:
    """Calibrate the camera from the board's corners in every ``step``-th view."""
    fields = json.loads((FOLDER / "all85_corners.json").read_text())
    columns, rows = fields["board_inner_corners"]
    x, y = np.meshgrid(np.arange(columns), np.arange(rows))
    board = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3) * fields["square_mm"] / 1000.0
    corners = [np.array(c) for c in list(fields["images"].values())[::step]]
    found = calibrate_camera(corners, [board] * len(corners), tuple(fields["image_size"]))
    if found.camera is None:
        raise RuntimeError(found.message)
    return found.camera


def without_largest_angle(camera: UnifiedCamera) -> UnifiedCamera:
    """Return the camera as far as its formula goes: some matches given lie beyond the outermost corner."""
    return UnifiedCamera.from_dict({**camera.to_dict(), "max_angle": None})


def errors_deg(estimate: Any, pair: dict[str, Any]) -> tuple[float, float]:
    """Return the angles of rotation and of direction to the board's pose [deg]."""
    truth = pair["gt_models"][REFERENCE]
    rotation = Rotation.from_matrix(np.array(truth["R21"]).T)
    translation = -rotation.apply(truth["t21"])
    pose = estimate.initial_T_goal
    t = pose.translation
    swing = math.atan2(float(np.linalg.norm(np.cross(t, translation))), float(t @ translation))
    return math.degrees((pose.rotation.inv() * rotation).magnitude()), math.degrees(swing)


def matches(
    camera: UnifiedCamera, pair: dict[str, Any]
) -> Iterator[tuple[str, npt.ArrayLike, npt.ArrayLike, float]]:
    """Give (whose, initial pixels, goal pixels, seconds): the matches given, and our own."""
    yield "given, all", pair["u1"], pair["u2"], math.nan
    images = [read_grey_image(FOLDER / pair[name]) for name in ("image1", "image2")]
    began = time.perf_counter()
    found = match_images(camera, *images)
    yield "our own", found.initial.pixels, found.goal.pixels, time.perf_counter() - began


def rows(camera: UnifiedCamera) -> Iterator[str]:
    """Give the table, row by row."""
    yield "| pair | matches | n | inliers | rms [px] | rotation off [°] | direction off [°] | status | s |"
    yield "|---|---|---|---|---|---|---|---|---|"
    for pair in read_pairs():
        for whose, initial, goal, seconds in matches(camera, pair):
            given = whose.startswith("given")
            used = without_largest_angle(camera) if given else camera
            found = estimate_two_view(used, initial, goal)
            turn, swing = errors_deg(found, pair) if found.status == "ok" else (math.nan, math.nan)
            name = f"{pair['image1'][5:9]}–{pair['image2'][5:9]}"
            took = f"{seconds:.1f}" if math.isfinite(seconds) else "–"
            n, inliers = len(found.inliers), int(found.inliers.sum())
            yield (
                f"| {name} | {whose} | {n} | {inliers} | {found.rms_px:.3f} "
                f"| {turn:.3f} | {swing:.2f} | {found.status} | {took} |"
            )


def main() -> None:
    """Print the table as Markdown."""
    if not FOLDER.is_dir():
        print("real data not present: ../shared/data")
        return
    camera = own_camera()
    for row in rows(camera):
        print(row, flush=True)
    print("\nSpread of the board's own pose under three camera models:")
    for pair in read_pairs():
        spread = pair["gt_spread"]
        print(
            f"- {pair['image1'][5:9]}–{pair['image2'][5:9]}: rotation {spread['rot_deg']:.2f} deg, "
            f"direction {spread['tdir_deg']:.2f} deg"
        )


if __name__ == "__main__":
    main()
