"""Boards' points: against corners stated with real images, and against the truth of rendered ones.

Run: ``python -m benchmarks.board_corners``. The real images are read from ``../shared/data`` beside the
project; where they are absent the table says so. Stated corners are another measurement, not the truth: the
table gives distances; ``python -m benchmarks.corner_agreement`` asks how small they could be. ``--crops
FOLDER`` saves the largest ones as pictures, ours green, the stated one red.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from benchmarks.tables import print_table
from tests.calibration import rendered_boards

from omniservo import calibrate_camera
from omniservo.calibration.boards import (
    AprilGrid,
    Board,
    CharucoBoard,
    Checkerboard,
    CircleGrid,
    find_board,
    read_grey_image,
)
from omniservo.cameras import UnifiedCamera, preset
from omniservo.cameras.models import KannalaBrandt

ROOT = Path(__file__).resolve().parents[1]
Array = npt.NDArray[np.float64]
DATA = ROOT.parent / "shared" / "data"
SETS = {
    "mei_paracatadioptric": "mei.json",
    "fisheye1": "fisheye1.json",
    "camodocal_fisheye": "all63_corners.json",
    "vinsfusion_calib": "all85_corners.json",
}
FITS = {
    "mei_paracatadioptric": "mei.json",
    "fisheye1": "fisheye1.json",
    "camodocal_fisheye": "camodocal.json",
}
"""the files that state a camera and poses too"""
BOARDS: dict[str, Board] = {
    "checkerboard": Checkerboard(8, 5, 0.03),
    "ChArUco": CharucoBoard(8, 6, 0.03, 0.022, "DICT_4X4_50"),
    "AprilGrid": AprilGrid(4, 3, 0.04, 0.3),
    "circles": CircleGrid(8, 5, 0.03, 0.018),
    "asymmetric circles": CircleGrid(4, 9, 0.018, 0.014, "asymmetric"),
}
CAMERAS = ("fe185", "para-catadioptric", "hyper-catadioptric", "perspective")
POSES = 10
_WORST = 16
NEAR = 0.3
"""[px] that is asked for"""


def stated_views(folder: str) -> Iterator[tuple[Path, Board, Array]]:
    """Give each image of a set that exists, its board, and the corners that are stated for it."""
    fields = json.loads((DATA / folder / SETS[folder]).read_text())
    board = Checkerboard(*fields["board_inner_corners"], fields["square_mm"] / 1000)
    views: Any = fields.get("views") or [{"image": k, **_corners(v)} for k, v in fields["images"].items()]
    for view in views:
        path = DATA / folder / view["image"]
        path = path if path.exists() else path.with_suffix(".jpg")
        if path.exists():
            yield path, board, np.array(view["corners"], dtype=np.float64).reshape(-1, 2)


def _corners(value: Any) -> dict[str, Any]:
    return value if isinstance(value, dict) else {"corners": value}


def real_rows(crops: Path | None) -> Iterator[str]:
    """Measure the real sets, one row each."""
    differences: list[tuple[float, Path, Array, Array]] = []
    for folder in SETS:
        distances, found, total, seconds = [], 0, 0, []
        for path, board, stated in stated_views(folder):
            image = read_grey_image(path)
            started = time.perf_counter()
            view = find_board(image, board)
            seconds.append(time.perf_counter() - started)
            total += len(stated)
            found += len(view)
            for corner in stated:
                away = np.linalg.norm(view.pixels - corner, axis=1)
                distances.append(float(away.min(initial=np.inf)))
                if len(away):
                    differences.append((distances[-1], path, view.pixels[away.argmin()], corner))
        d = np.array(distances)
        yield (
            f"{folder} | {len(seconds)} | {found}/{total} | {np.median(d):.3f} | "
            f"{np.percentile(d, 95):.3f} | {d.max():.2f} | {100 * (d <= 0.3).mean():.1f}% | "
            f"{np.median(seconds):.2f}"
        )
    if crops is not None:
        _save_crops(crops, sorted(differences, key=lambda row: -row[0])[:_WORST])


def _save_crops(folder: Path, rows: list[tuple[float, Path, Array, Array]]) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for k, (_, path, ours, stated) in enumerate(rows):
        low = np.maximum(np.rint(ours).astype(int) - 12, 0)
        part = read_grey_image(path)[low[1] : low[1] + 25, low[0] : low[0] + 25]
        large = cv2.resize(part, None, fx=16, fy=16, interpolation=cv2.INTER_NEAREST)
        picture = cv2.cvtColor(large, cv2.COLOR_GRAY2BGR)
        for pixel, colour in ((ours, (0, 255, 0)), (stated, (0, 0, 255))):
            at = tuple(int(x) for x in 16 * (pixel - low + 0.5))
            cv2.drawMarker(picture, at, colour, cv2.MARKER_CROSS, 14, 2)
        cv2.imwrite(str(folder / f"{k:02d}_{path.stem}.png"), picture)


def calibrated_rows() -> Iterator[str]:
    """Calibrate the plain model from our corners and from the stated ones: which fit a camera better."""
    for folder in SETS:
        ours: list[Array] = []
        stated: list[Array] = []
        targets: list[Array] = []
        size = (0, 0)
        for path, board, corners in stated_views(folder):
            image = read_grey_image(path)
            view = find_board(image, board)
            ways = (corners[view.ids], corners[::-1][view.ids])  # either may be counted from the other end
            stated.append(min(ways, key=lambda way: float(np.abs(way - view.pixels).max())))
            ours.append(np.asarray(view.pixels))
            targets.append(np.asarray(view.object_points))
            size = (image.shape[1], image.shape[0])
        fits = [calibrate_camera(c, targets, size, distortion="none") for c in (ours, stated)]
        near = [share_near(np.concatenate(list(fit.residuals.values()))) for fit in fits]
        yield f"{folder} | {fits[0].rms_px:.3f} | {near[0]} | {fits[1].rms_px:.3f} | {near[1]}"


def stated_fit_rows() -> Iterator[str]:
    """Compare both kinds of corners with the best camera and poses that the JSON files state."""
    for folder, name in FITS.items():
        fields = json.loads((DATA / folder / name).read_text())
        kind = min(("radtan", "kb4"), key=lambda kind: float(fields[f"ba_{kind}"]["rms_px"]))
        camera = _stated_camera(fields[f"ba_{kind}"], fields["image_size"])
        views = {Path(view["image"]).stem: view for view in fields["views"]}
        stated_errors, errors, apart = [], [], []
        for path, board, stated in stated_views(folder):
            view = views[path.stem]
            R, t = np.reshape(view[f"R_cam_board_{kind}"], (3, 3)), np.ravel(view[f"t_cam_board_{kind}"])
            fitted, _ = camera.project(board.points @ R.T + t / 1000)
            found = find_board(read_grey_image(path), board).pixels
            ours = found[np.linalg.norm(found[None] - stated[:, None], axis=2).argmin(axis=1)]
            stated_errors.append(stated - fitted)
            errors.append(ours - fitted)
            apart.append(np.linalg.norm(ours - stated, axis=1) > NEAR)
        theirs, mine, far = np.concatenate(stated_errors), np.concatenate(errors), np.concatenate(apart)
        nearer = np.linalg.norm(mine, axis=1)[far] < np.linalg.norm(theirs, axis=1)[far]
        yield (
            f"{folder} | {kind} | {share_near(theirs)} | {share_near(mine)} | {far.sum()} | {nearer.sum()}"
        )


def _stated_camera(fit: Any, size: list[int]) -> UnifiedCamera | KannalaBrandt:
    intrinsics = [fit[name] for name in ("fx", "fy", "cx", "cy")]
    if "k" in fit:
        return KannalaBrandt(*intrinsics, *size, k=tuple(fit["k"]))
    return UnifiedCamera(*intrinsics, fit["xi"], *size, distortion=tuple(fit["D"]))


def share_near(errors: Array) -> str:
    """Give the share of (n, 2) differences of at most 0.3 px."""
    return f"{100 * (np.linalg.norm(errors, axis=1) <= NEAR).mean():.1f}%"


def rendered_rows(seed: int = 1) -> Iterator[str]:
    """Measure rendered boards at drawn poses, one row for each board and camera."""
    for title, board in BOARDS.items():
        for name in CAMERAS:
            rng = np.random.default_rng(seed)
            errors, biased, found, seen = [], [], 0, 0
            for k in range(POSES):
                camera = preset(name)
                pose = draw_pose(camera, board, rng)
                camera = rendered_boards.around(camera, board, pose)
                blur, noise = rng.uniform(0.5, 1.2), rng.uniform(1.0, 5.0)
                image = rendered_boards.render(camera, board, pose, blur=blur, noise=noise, seed=k)
                pixels, visible = rendered_boards.true_pixels(camera, board, pose)
                view = find_board(image, board, camera)
                seen += int(visible.sum())
                found += len(view)
                errors += _errors(view, pixels)
                biased += _to_nearest(find_board(image, board), pixels)
            e, b = np.array(errors), np.array(biased)
            yield (
                f"{title} | {name} | {found}/{seen} | {np.median(e):.3f} | {np.percentile(e, 95):.3f} | "
                f"{e.max():.2f} | {np.median(b):.3f}"
            )


def draw_pose(camera: UnifiedCamera, board: Board, rng: np.random.Generator) -> Any:
    """Draw poses until the whole board is in the image; boards with markers: 80% of it."""
    size = float(np.ptp(board.points, axis=0).max())
    reach = min(camera.usable_angle, camera.max_angle or 0.6)
    while True:
        angle, turn = rng.uniform(0.0, reach), rng.uniform(-np.pi, np.pi)
        direction = (np.sin(angle) * np.cos(turn), np.sin(angle) * np.sin(turn), np.cos(angle))
        lean = rng.uniform(-0.6, 0.6, 2)
        distance = size * rng.uniform(0.7, 1.4)
        pose = rendered_boards.facing(board, direction, distance, tuple(lean), rng.uniform(-np.pi, np.pi))
        _, visible = rendered_boards.true_pixels(camera, board, pose)
        if visible.mean() >= (0.8 if isinstance(board, CharucoBoard | AprilGrid) else 1.0):
            return pose


def _errors(view: Any, pixels: Array) -> list[float]:
    """Distances from the truth; a board that looks the same turned may be counted from either end."""
    ways = (pixels, pixels[::-1]) if view.turnable else (pixels,)
    errors = [np.linalg.norm(view.pixels - way[view.ids], axis=1) for way in ways if len(view)]
    best = min(errors, key=lambda e: float(np.nanmedian(e)), default=np.zeros(0))
    return [float(e) for e in best]


def _to_nearest(view: Any, pixels: Array) -> list[float]:
    """Distances to the nearest true point: without a camera nobody knows that the image is mirrored."""
    seen = pixels[np.isfinite(pixels[:, 0])]
    return [float(np.linalg.norm(seen - pixel, axis=1).min()) for pixel in view.pixels]


def main() -> None:
    """Print the tables as Markdown."""
    crops = Path(sys.argv[2]) if sys.argv[1:2] == ["--crops"] and len(sys.argv) > 2 else None
    if DATA.exists():
        head = "| images | views | corners found | median [px] | p95 | max | ≤ 0.3 px | s/image |"
        print_table(head, real_rows(crops))
        print()
        plain = "rms of a plain calibration from these corners [px]"
        print_table(f"| images | {plain} | ≤ 0.3 px | from the stated ones | ≤ 0.3 px |", calibrated_rows())
        print()
        far = "more than 0.3 px apart | of these, ours nearer the fit"
        print_table(f"| images | stated fit | stated ≤ 0.3 px of it | ours | {far} |", stated_fit_rows())
    else:
        print(f"real images: {DATA} is absent")
    print()
    head = "| board | camera | points found | median [px] | p95 | max | median without the camera |"
    print_table(head, rendered_rows())


if __name__ == "__main__":
    main()
