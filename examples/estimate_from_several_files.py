"""Estimate motion, structure and scale from several image files of a scene that stands still.

Four images of three textured panels are rendered first; with photographs of your own, start at
`estimate_many_images`. Prints each motion with its uncertainty and error, and what one more image would gain.
"""

from pathlib import Path

import numpy as np
from PIL import Image
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import RigidTransform, Rotation

import omniservo
from omniservo.robots import load_arm
from omniservo.runs import ImageScale, estimate_many_images
from omniservo.scenes import Panel, Scene
from omniservo.simulation import UnifiedRenderer, World

CAMERA = omniservo.UnifiedCamera(210.0, 210.0, 159.5, 119.5, 0.0, 320, 240)
PLACES = (([-0.2, 0.0, 0.5], -0.4), ([0.15, 0.05, 0.4], 0.3), ([0.0, -0.1, 0.6], 0.0))  # [m], [rad]
MOVES = ([0, 0, 0, 0, 0, 0], [9, 6, -9, 3, 6, 5], [-6, 4, -4, 2, 0, 3], [12, 10, -15, 5, 10, 8])  # [deg]


def take_images(files: list[Path]) -> list[RigidTransform]:
    """Write the images; return where the cameras stand in the first one's frame."""
    arm, mount = load_arm("rx60"), RigidTransform.from_translation([0.0, 0.0, 0.09])
    start, rng = np.radians([0.0, 20.0, 110.0, 0.0, 50.0, 0.0]), np.random.default_rng(0)
    panels = []
    for number, (place, lean) in enumerate(PLACES):
        spots = sum(gaussian_filter(rng.standard_normal((200, 300)), size) for size in (3.0, 8.0))
        pose = RigidTransform.from_components(place, Rotation.from_rotvec([0.0, lean, 0.0]))
        world_T_panel = arm.base_T_flange(start) * mount * pose
        panels.append(Panel(f"panel {number}", world_T_panel, [0.36, 0.24], np.where(spots > 0, 0.8, 0.1)))
    scene = Scene(arm, RigidTransform.identity(), mount, CAMERA, start, panels=tuple(panels))
    renderer, joints = UnifiedRenderer(World(scene)), [start + np.radians(move) for move in MOVES]
    for file, q in zip(files, joints, strict=True):
        Image.fromarray(renderer.photograph(q, rng)).save(file)
    return [scene.world_T_camera(joints[0]).inv() * scene.world_T_camera(q) for q in joints]


def main() -> None:
    Path("out").mkdir(exist_ok=True)
    files = [Path(f"out/view-{k}.png") for k in range(len(MOVES))]
    truth = take_images(files)
    length = float(np.linalg.norm(truth[-1].translation))  # first to last camera centre [m]
    views = estimate_many_images(CAMERA, files, features="natural", scale=ImageScale(displacement=length))
    found = views.estimate
    print(found)
    for file, pose, true, spread in zip(files, found.initial_T_views, truth, found.covariance, strict=True):
        if pose is not None:
            off, sigma = (pose.inv() * true).translation, np.sqrt(np.trace(spread[:3, :3]))
            print(f"{file.name}: off by {1e3 * np.linalg.norm(off):.2f} mm, sigma {1e3 * sigma:.2f} mm")
    print("one more image, at best:", views.further[0] if views.further else found.message)


if __name__ == "__main__":
    main()
