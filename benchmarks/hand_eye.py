"""Hand-eye calibration: a real arm's views, rendered fisheye pictures, drawn corners of a robot that errs.

Run: ``python -m benchmarks.hand_eye [runs]``. The real views are read from ``../shared/data`` beside the
project; where they are absent the table says so. "Closed form" of the real views is OpenCV's (4; 5 has it
not), else ours, which is Park & Martin's; "pixels alone" is least squares of the corners' reprojection
errors, the robot's poses taken as exact. Scatter: how far the boards of single views are from their mean,
position and rotation.
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
from scipy.spatial.transform import RigidTransform, Rotation
from scipy.stats import chi2
from tests.calibration.hand_eye_scenes import (
    BOARD,
    FISHEYE,
    FLANGE_T_CAMERA,
    PINHOLE,
    draw_views,
    error_of,
    render_views,
)

from omniservo import UnifiedCamera, calibrate_hand_eye, estimate_pose, load_camera, load_robot_poses
from omniservo.calibration.boards import Checkerboard, find_board, read_grey_image
from omniservo.calibration.hand_eye import HandEye
from omniservo.calibration.hand_eye.loop import LoopState, SeenViews, linearise
from omniservo.calibration.hand_eye.start import closed_form

Array = npt.NDArray[np.float64]
DATA = Path(__file__).resolve().parents[2] / "shared" / "data" / "visp_franka_eye_in_hand"
METHODS = {
    "Tsai & Lenz": cv2.CALIB_HAND_EYE_TSAI,
    "Park & Martin": cv2.CALIB_HAND_EYE_PARK,
    "Daniilidis": cv2.CALIB_HAND_EYE_DANIILIDIS,
}
RUNS = 30
NOISES = ((0.0, 0.0), (3e-4, 0.03), (1e-3, 0.2))
"""of the robot: [m], [deg]"""
SCENES = (("pinhole", PINHOLE, 8), ("fisheye", FISHEYE, 6), ("fisheye", FISHEYE, 15))
"""camera and number of views"""

SENSOR_NOISES = (2.0, 34.0)
"""grey levels of 255; the second puts corners off by 0.1 px"""
INSIDE = chi2.ppf(0.95, 6)


def board_poses(camera: UnifiedCamera, pixels: list[Array], points: list[Array]) -> list[RigidTransform]:
    """Return camera_T_board of each view by itself."""
    poses = [estimate_pose(camera, x, p).poses[0] for p, x in zip(pixels, points, strict=True)]
    return [pose.inv() for pose in poses]


def by_opencv(
    base_T_flange: list[RigidTransform], camera_T_board: list[RigidTransform], method: int
) -> RigidTransform:
    """Return flange_T_camera of a closed form of OpenCV's."""
    robot, seen = (
        ([pose.rotation.as_matrix() for pose in poses], [pose.translation for pose in poses])
        for poses in (base_T_flange, camera_T_board)
    )
    R, t = cv2.calibrateHandEye(*robot, *seen, method=method)
    return RigidTransform.from_components(t.ravel(), Rotation.from_matrix(R))


def by_closed_form(
    base_T_flange: list[RigidTransform], camera_T_board: list[RigidTransform]
) -> RigidTransform:
    """Return flange_T_camera of our closed form."""
    A, B = (np.stack([pose.as_matrix() for pose in poses]) for poses in (base_T_flange, camera_T_board))
    return RigidTransform.from_matrix(closed_form(A, B))


def by_pixels_alone(
    camera: UnifiedCamera,
    base_T_flange: list[RigidTransform],
    pixels: list[Array],
    points: list[Array],
    first: RigidTransform,
) -> RigidTransform:
    """Return flange_T_camera of the least squared reprojection errors, the robot's poses being exact."""
    ends = np.cumsum([0, *map(len, pixels)])
    views = SeenViews(
        RigidTransform.concatenate(base_T_flange), np.concatenate(pixels), np.concatenate(points), ends
    )
    board = base_T_flange[0] * first * board_poses(camera, pixels[:1], points[:1])[0]
    state = LoopState(first, board, np.zeros((len(pixels), 6)))
    for _ in range(15):
        linear = linearise(camera, views, state, 1e3)  # so large that Cauchy's loss is least squares
        if linear is None:
            raise ArithmeticError("a board leaves the field")
        W = np.linalg.inv(linear.C)
        normal = np.einsum("nji,njk,nkl->il", linear.M, W, linear.M)
        step = np.linalg.solve(normal, np.einsum("nji,njk,nk->i", linear.M, W, linear.q))
        state = state.stepped(step, state.offsets)
    return state.flange_T_camera


def scatter(
    base_T_flange: list[RigidTransform], X: RigidTransform, camera_T_board: list[RigidTransform]
) -> str:
    """Spell rms and worst distance of the views' boards from their mean: mm, degrees."""
    boards = RigidTransform.concatenate(
        [a * X * b for a, b in zip(base_T_flange, camera_T_board, strict=True)]
    )
    metres = np.linalg.norm(boards.translation - boards.translation.mean(axis=0), axis=1)
    degrees = np.degrees((boards.rotation.mean().inv() * boards.rotation).magnitude())
    rms = [float(np.sqrt((x**2).mean())) for x in (metres, degrees)]
    return f"{1e3 * rms[0]:.2f} | {rms[1]:.2f} | {1e3 * metres.max():.2f} | {degrees.max():.2f}"


def real_rows() -> Iterator[str]:
    """Calibrate the Franka's views in every way, with the board as stated and as large as the robot says."""
    camera = load_camera(DATA / "franka_camera.xml")
    fields = json.loads((DATA / "franka_eye_in_hand.json").read_text())
    images = sorted(DATA.glob("franka_image-*.png"))
    base_T_flange = list(load_robot_poses(DATA / "franka_eye_in_hand.json").of_images(images))
    square = float(fields["square_m"])
    for _ in range(2):
        board = Checkerboard(*fields["board"], square)
        views = [find_board(read_grey_image(path), board, camera) for path in images]
        pixels, points = [v.pixels for v in views], [v.object_points for v in views]
        poses = board_poses(camera, pixels, points)
        head = f"{1e3 * square:.2f} mm"
        for name, method in METHODS.items() if hasattr(cv2, "calibrateHandEye") else ():
            X = by_opencv(base_T_flange, poses, method)
            yield f"{head} | closed form, {name} | {_place(X)} | {scatter(base_T_flange, X, poses)} | – | –"
        X = by_closed_form(base_T_flange, poses)
        X = by_pixels_alone(camera, base_T_flange, pixels, points, X)
        yield f"{head} | pixels alone | {_place(X)} | {scatter(base_T_flange, X, poses)} | – | –"
        found = calibrate_hand_eye(camera, base_T_flange, pixels, points)
        if found.flange_T_camera is None:
            raise ArithmeticError(found.message)
        X = found.flange_T_camera
        sigma = np.sqrt(np.diag(found.covariance))
        place = f"{_place(X)} ± {', '.join(f'{1e3 * s:.1f}' for s in sigma[:3])}"
        robot = f"{1e3 * found.robot_position_m:.2f} mm, {np.degrees(found.robot_rotation_rad):.2f}°"
        size = f"{found.board_scale:.3f} ± {found.board_scale_sigma:.3f}"
        yield f"{head} | ours | {place} | {scatter(base_T_flange, X, poses)} | {robot} | {size}"
        square *= found.board_scale


def _place(X: RigidTransform) -> str:
    return ", ".join(f"{1e3 * x:.1f}" for x in X.translation)


def rendered_rows(runs: int) -> Iterator[str]:
    """Calibrate from the simulator's pictures of 15 views each, one row for each noise of the sensor."""
    for noise in SENSOR_NOISES:
        errors, corners, inside, seconds = [], [], 0, []
        for seed in range(runs):
            base_T_flange, pictures, true = render_views(1000 + seed, 15, noise=noise)
            views = [find_board(picture, BOARD, FISHEYE) for picture in pictures]
            corners += [v.pixels - t[v.ids] for v, t in zip(views, true, strict=True) if len(v)]
            started = time.perf_counter()
            found = calibrate_hand_eye(
                FISHEYE, base_T_flange, [v.pixels for v in views], [v.object_points for v in views]
            )
            seconds.append(time.perf_counter() - started)
            error, is_inside = judged(found)
            errors.append(error)
            inside += is_inside
        sizes = np.array(errors)
        off = float(np.concatenate(corners).std())
        yield (
            f"{noise:g} | {off:.3f} | {np.median(sizes[:, 0]):.3f} | {sizes[:, 0].max():.3f} | "
            f"{np.median(sizes[:, 1]):.4f} | {sizes[:, 1].max():.4f} | {inside} of {runs} | "
            f"{np.median(seconds):.2f}"
        )


def judged(found: HandEye) -> tuple[Array, bool]:
    """Return the error of flange_T_camera, [mm] and [deg], and whether the 95% ellipsoid holds the truth."""
    if found.flange_T_camera is None:
        return np.array([np.inf, np.inf]), False
    error = error_of(found.flange_T_camera, FLANGE_T_CAMERA)
    inside = bool(error @ np.linalg.solve(found.covariance, error) < INSIDE)
    return sizes_of(error), inside


def sizes_of(error: Array) -> Array:
    """Return the lengths of translation [mm] and rotation [deg]."""
    return np.array([1e3 * np.linalg.norm(error[:3]), np.degrees(np.linalg.norm(error[3:]))])


def drawn_rows(runs: int) -> Iterator[str]:
    """Calibrate from drawn corners (0.1 px) of robots that are off, beside what others do."""
    for name, camera, n in SCENES:
        for position, degrees in NOISES:
            rng = np.random.default_rng(1)
            sizes: dict[str, list[Array]] = {"closed": [], "pixels": [], "ours": []}
            inside, stated = 0, []
            for _ in range(runs):
                drawn = draw_views(rng, camera, n, position=position, rotation=np.radians(degrees))
                found, ways = _every_way(camera, drawn)
                for way, X in ways.items():
                    sizes[way].append(sizes_of(error_of(X, FLANGE_T_CAMERA)))
                error, is_inside = judged(found)
                sizes["ours"].append(error)
                inside += is_inside
                traces = [np.trace(found.covariance[k : k + 3, k : k + 3]) for k in (0, 3)]
                stated.append(sizes_of(np.sqrt([traces[0], 0, 0, traces[1], 0, 0])))
            spelled = [_rms(sizes[way]) for way in ("closed", "pixels", "ours")]
            yield (
                f"{name} | {n} | {1e3 * position:g} mm, {degrees:g}° | {' | '.join(spelled)} | "
                f"{_rms(stated)} | {inside} of {runs}"
            )


def _every_way(camera: UnifiedCamera, drawn: Any) -> tuple[HandEye, dict[str, RigidTransform]]:
    poses = board_poses(camera, drawn.pixels, drawn.points)
    closed = by_closed_form(drawn.base_T_flange, poses)
    alone = by_pixels_alone(camera, drawn.base_T_flange, drawn.pixels, drawn.points, closed)
    found = calibrate_hand_eye(camera, drawn.base_T_flange, drawn.pixels, drawn.points)
    return found, {"closed": closed, "pixels": alone}


def _rms(sizes: list[Array]) -> str:
    mm, degrees = np.sqrt((np.array(sizes) ** 2).mean(axis=0))
    return f"{mm:.2f} mm, {degrees:.3f}°"


def main() -> None:
    """Print the tables as Markdown."""
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else RUNS
    if DATA.exists():
        print_table(
            "| squares | by | camera in the flange's frame [mm] | scatter rms [mm] | [deg] | worst [mm] "
            "| [deg] | the robot is off by | board over stated |",
            real_rows(),
        )
    else:
        print(f"real views: {DATA} is absent")
    print()
    print_table(
        "| sensor noise | corners off by [px] | median [mm] | worst | median [deg] | worst | inside 95% "
        "| s |",
        rendered_rows(runs),
    )
    print()
    print_table(
        "| camera | views | robot off by | closed form | pixels alone | ours | ours states | inside 95% |",
        drawn_rows(runs),
    )


if __name__ == "__main__":
    main()
