"""A board in front of an arm with a camera in its hand: drawn corners, rendered pictures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.calibration.boards import Checkerboard
from omniservo.cameras import UnifiedCamera, preset
from omniservo.errors import InputError
from omniservo.robots import Arm
from omniservo.scenes.scene import Panel, Scene, Sensor
from omniservo.simulation.unified_renderer import UnifiedRenderer
from omniservo.simulation.world import World

PINHOLE = UnifiedCamera(600.0, 600.0, 319.5, 239.5, 0.0, 640, 480)
FISHEYE = preset("fe185")
BOARD = Checkerboard(9, 6, 0.03)
FLANGE_T_CAMERA = RigidTransform.from_components(
    [0.05, -0.03, 0.09], Rotation.from_rotvec([0.02, -0.05, 1.5])
)
BASE_T_BOARD = RigidTransform.from_components(
    [0.50, -0.10, 0.0], Rotation.from_euler("xyz", [180.0, 0.0, 20.0], degrees=True)
)
_DARK, _BRIGHT = 0.05, 0.85


@dataclass(frozen=True, eq=False)
class DrawnViews:
    """What `calibrate_hand_eye` is given, and the truth."""

    base_T_flange: list[RigidTransform]
    pixels: list[np.ndarray]
    points: list[np.ndarray]
    flange_T_camera: RigidTransform = FLANGE_T_CAMERA
    base_T_board: RigidTransform = BASE_T_BOARD


def draw_camera(rng: np.random.Generator, *, cone: float, distance: tuple[float, float]) -> RigidTransform:
    """Return base_T_camera that looks at the board from within a cone [deg] about its normal."""
    tilt = Rotation.from_rotvec(np.radians(rng.uniform(-cone, cone, 3)) * [1.0, 1.0, 2.0])
    middle = BOARD.points.mean(axis=0)
    centre = np.array([*rng.uniform(-0.08, 0.08, 2), rng.uniform(*distance)])
    camera_T_board = RigidTransform.from_components(centre - tilt.apply(middle), tilt)
    return BASE_T_BOARD * camera_T_board.inv()


def draw_views(
    rng: np.random.Generator,
    camera: UnifiedCamera,
    n: int,
    *,
    px: float = 0.1,
    position: float = 0.0,
    rotation: float = 0.0,
    cone: float = 30.0,
) -> DrawnViews:
    """Return n views, corners off by ``px`` [px], reported poses by ``position`` [m], ``rotation`` [rad]."""
    drawn = DrawnViews([], [], [])
    while len(drawn.pixels) < n:
        base_T_camera = draw_camera(rng, cone=cone, distance=(0.3, 0.5))
        pixels, valid = camera.project((base_T_camera.inv() * BASE_T_BOARD).apply(BOARD.points))
        if not (valid.all() and camera.in_image(pixels).all()):
            continue
        true = base_T_camera * FLANGE_T_CAMERA.inv()
        turn = Rotation.from_rotvec(rotation * rng.standard_normal(3))
        drawn.base_T_flange.append(
            RigidTransform.from_components(
                true.translation + position * rng.standard_normal(3), true.rotation * turn
            )
        )
        drawn.pixels.append(pixels + px * rng.standard_normal(pixels.shape))
        drawn.points.append(np.array(BOARD.points))
    return drawn


def error_of(found: RigidTransform, true: RigidTransform) -> np.ndarray:
    """Return (6,) translation [m] and rotation vector on the right [rad] that are off."""
    turn = (true.rotation.inv() * found.rotation).as_rotvec()
    return np.concatenate([found.translation - true.translation, turn])


def board_panel() -> Panel:
    """Return the board as a printed panel, with half a square of white around it."""
    columns, rows = BOARD.columns + 1, BOARD.rows + 1
    halves = np.full((2 * rows + 2, 2 * columns + 2), _BRIGHT)
    dark = np.add.outer(np.arange(rows), np.arange(columns)) % 2 == 0
    halves[1:-1, 1:-1][np.kron(dark, np.ones((2, 2), dtype=bool))] = _DARK
    middle = RigidTransform.from_translation(BOARD.points.mean(axis=0))
    size = 0.5 * BOARD.square * np.array(halves.shape[::-1])
    return Panel("board", BASE_T_BOARD * middle, size, halves)


def render_views(
    seed: int, n: int, *, noise: float, panels: tuple[Panel, ...] | None = None
) -> tuple[list[RigidTransform], list[np.ndarray], list[np.ndarray]]:
    """Return n poses base_T_flange of the RX60, the pictures there, and the true corners (k, 2) in each.

    ``panels`` stand in the place of the board.
    """
    camera = FISHEYE
    rng = np.random.default_rng(seed)
    arm = Arm.rx60()
    near = np.radians([0.0, 45.0, 60.0, 0.0, 75.0, 0.0])
    scene = Scene(arm, RigidTransform.identity(), FLANGE_T_CAMERA, camera, near, sensor=Sensor(noise=noise),
                  panels=panels or (board_panel(),))  # fmt: skip
    renderer = UnifiedRenderer(World(scene))
    poses, pictures, corners = [], [], []
    while len(poses) < n:
        try:
            q = scene.joints_for(draw_camera(rng, cone=35.0, distance=(0.22, 0.4)), near)
        except InputError:
            continue
        camera_T_board = scene.world_T_camera(q).inv() * BASE_T_BOARD
        pixels, valid = camera.project(camera_T_board.apply(BOARD.points))
        if valid.all() and camera.in_image(pixels).all():
            poses.append(arm.base_T_flange(q))
            pictures.append(renderer.photograph(q, rng))
            corners.append(pixels)
    return poses, pictures, corners
