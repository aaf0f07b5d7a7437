"""Calibrate a camera from images of a checkerboard.

Eight pictures of a printed board are rendered through a known lens; the calibration sees the files alone.
Prints parameters and standard deviations beside the true values, and how far true pixels may lie from the
camera's. Every command takes the file out/camera.yaml, and so does `omniservo.load_camera`.
"""

from pathlib import Path

import numpy as np
from PIL import Image
from scipy.spatial.transform import RigidTransform, Rotation

import omniservo
from omniservo.calibration import board_from_text, calibrate_images
from omniservo.robots import load_arm
from omniservo.scenes import Panel, Scene
from omniservo.simulation import UnifiedRenderer, World

TRUTH = omniservo.UnifiedCamera(260.0, 260.0, 161.0, 118.0, 0.9, 320, 240)
BOARD = board_from_text("checkerboard:9x6:0.03")  # 9 × 6 inner corners, squares of 30 mm


def take_images(files: list[Path]) -> None:
    arm, start = load_arm("rx60"), np.radians([0.0, 20.0, 110.0, 0.0, 50.0, 0.0])
    dark = np.add.outer(np.arange(7), np.arange(10)) % 2 == 0
    paper = np.full((16, 22), 0.85)  # half squares, with one of white around
    paper[1:-1, 1:-1][np.kron(dark, np.ones((2, 2), dtype=bool))] = 0.05
    hangs = RigidTransform.from_components([0.0, 0.0, 0.25], Rotation.from_rotvec([0.0, 0.2, 0.5]))
    mount, rng = RigidTransform.from_translation([0.0, 0.0, 0.09]), np.random.default_rng(1)
    board = Panel("board", arm.base_T_flange(start) * mount * hangs, [0.33, 0.24], paper)
    scene = Scene(arm, RigidTransform.identity(), mount, TRUTH, start, panels=(board,))
    renderer = UnifiedRenderer(World(scene))
    for file in files:
        joints = start + rng.uniform(-1.0, 1.0, 6) * [0.1, 0.1, 0.1, 0.4, 0.4, 1.0]
        Image.fromarray(renderer.photograph(joints, rng)).save(file)


def main() -> None:
    Path("out").mkdir(exist_ok=True)
    files = [Path(f"out/board-{number}.png") for number in range(8)]
    take_images(files)

    found = calibrate_images(files, BOARD)
    calibration = found.calibration
    print(f"{calibration.status}: {len(calibration.views_used)} of {len(files)} images,", end=" ")
    print(f"{calibration.rms_px:.3f} px rms; not used: {found.not_used() or 'none'}")
    sigma = np.sqrt(np.diag(calibration.covariance))
    for name, deviation in zip(calibration.parameter_names[:5], sigma[:5], strict=True):
        value, true = getattr(found.camera, name), getattr(TRUTH, name)
        print(f"{name}: {value:.3f} ± {deviation:.3f}, true {true:g}")
    print(f"pixels are right to {calibration.deviation_px:.2f} px, with 95% confidence")
    omniservo.save_camera(found.camera, "out/camera.yaml", force=True)


if __name__ == "__main__":
    main()
