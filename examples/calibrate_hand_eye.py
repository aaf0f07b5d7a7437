"""Eye-in-hand calibration: where the camera sits on the flange, from images of a fixed board and robot poses.

The arm looks at a checkerboard from ten places, in rendered pictures; its poses are reported 0.2 mm off.
Prints flange_T_camera with its standard deviations, and how far off it is; a task takes out/hand-eye.json.
"""

from pathlib import Path

import numpy as np
from PIL import Image
from scipy.spatial.transform import RigidTransform, Rotation

import omniservo
from omniservo.calibration import board_from_text
from omniservo.robots import load_arm
from omniservo.scenes import Panel, Scene
from omniservo.simulation import UnifiedRenderer, World

CAMERA = omniservo.UnifiedCamera(260.0, 260.0, 161.0, 118.0, 0.9, 320, 240)
BOARD = board_from_text("checkerboard:9x6:0.03")
TRUTH = RigidTransform.from_components([0.05, -0.03, 0.09], Rotation.from_rotvec([0.02, -0.05, 1.5]))
BASE_T_BOARD = RigidTransform.from_components([0.28, 0.07, 0.0], Rotation.from_rotvec([np.pi, 0.0, 0.0]))


def scene() -> Scene:
    dark = np.add.outer(np.arange(7), np.arange(10)) % 2 == 0
    paper = np.full((16, 22), 0.85)  # half squares, with one of white around
    paper[1:-1, 1:-1][np.kron(dark, np.ones((2, 2), dtype=bool))] = 0.05
    middle = RigidTransform.from_translation(BOARD.points.mean(axis=0))
    board = Panel("board", BASE_T_BOARD * middle, [0.33, 0.24], paper)
    arm, near = load_arm("rx60"), np.radians([0.0, 45.0, 60.0, 0.0, 75.0, 0.0])
    return Scene(arm, RigidTransform.identity(), TRUTH, CAMERA, near, panels=(board,))


def main() -> None:
    folder, rng, world = Path("out"), np.random.default_rng(0), scene()
    folder.mkdir(exist_ok=True)
    renderer, files, base_T_flange = UnifiedRenderer(World(world)), [], []
    above = RigidTransform.from_translation([0.0, 0.0, 0.3] - BOARD.points.mean(axis=0))
    start = world.joints_for(BASE_T_BOARD * above.inv(), world.start_joints)
    for number in range(10):
        # The flange turns about more than one axis: with one alone the camera's place does not show.
        joints = start + rng.uniform(-1.0, 1.0, 6) * [0.1, 0.15, 0.15, 0.5, 0.4, 0.6]
        files.append(folder / f"view-{number}.png")
        Image.fromarray(renderer.photograph(joints, rng)).save(files[-1])
        error = RigidTransform.from_translation(2e-4 * rng.standard_normal(3))
        base_T_flange.append(error * world.arm.base_T_flange(joints))
    # From here on: the files, the poses that the robot reported, the camera and the board.
    found = omniservo.calibrate_hand_eye_images(CAMERA, base_T_flange, files, BOARD).result
    print(f"{found.status} {found.message}: {len(found.used)} of {len(files)} views used")
    for number in set(range(len(files))) - set(found.used):
        print(f"  not view {number}: {found.views[number].reason}")
    place, sigma = found.flange_T_camera.translation, np.sqrt(np.diag(found.covariance))
    print(f"camera at {1e3 * place.round(5)} ± {1e3 * sigma[:3].round(5)} mm on the flange")
    print(f"off by {1e3 * np.linalg.norm((found.flange_T_camera.inv() * TRUTH).translation):.2f} mm")
    found.save(folder / "hand-eye.json", force=True)


if __name__ == "__main__":
    main()
