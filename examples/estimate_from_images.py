"""Estimate the camera's motion and the target's structure from two image files.

Three printed panels are rendered from two places; with photographs of your own, start at `estimate_images`.
Prints what was matched, the motion with its uncertainty, how far off it is, and how far the points are.
"""

from pathlib import Path

import numpy as np
from PIL import Image
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import RigidTransform, Rotation

import omniservo
from omniservo.robots import load_arm
from omniservo.runs import estimate_images
from omniservo.scenes import Panel, Scene
from omniservo.simulation import UnifiedRenderer, World

CAMERA = omniservo.UnifiedCamera(210.0, 210.0, 159.5, 119.5, 0.0, 320, 240)
PLACES = (([-0.2, 0.0, 0.5], -0.4), ([0.15, 0.05, 0.4], 0.3), ([0.0, -0.1, 0.6], 0.0))  # [m], [rad]


def take_images(files: list[Path]) -> RigidTransform:
    """Write both images; return where the second camera stands in the first one's frame."""
    arm, mount = load_arm("rx60"), RigidTransform.from_translation([0.0, 0.0, 0.09])
    start, rng = np.radians([0.0, 20.0, 110.0, 0.0, 50.0, 0.0]), np.random.default_rng(0)
    panels = []
    for number, (place, lean) in enumerate(PLACES):
        spots = sum(gaussian_filter(rng.standard_normal((200, 300)), size) for size in (3.0, 8.0))
        pose = RigidTransform.from_components(place, Rotation.from_rotvec([0.0, lean, 0.0]))
        world_T_panel = arm.base_T_flange(start) * mount * pose
        panels.append(Panel(f"panel {number}", world_T_panel, [0.36, 0.24], np.where(spots > 0, 0.8, 0.1)))
    scene = Scene(arm, RigidTransform.identity(), mount, CAMERA, start, panels=tuple(panels))
    renderer, goal = UnifiedRenderer(World(scene)), start + np.radians([12.0, 10.0, -15.0, 5.0, 10.0, 8.0])
    for file, joints in zip(files, (start, goal), strict=True):
        Image.fromarray(renderer.photograph(joints, rng)).save(file)
    return scene.world_T_camera(start).inv() * scene.world_T_camera(goal)


def main() -> None:
    Path("out").mkdir(exist_ok=True)
    files = [Path("out/initial.png"), Path("out/goal.png")]
    truth = take_images(files)
    # Without `displacement`, the distance between the two camera centres [m], the estimate has no scale.
    length = float(np.linalg.norm(truth.translation))
    found = estimate_images(CAMERA, *files, features="natural", displacement=length).estimate
    print(f"{found.status} {found.message}: {found.inliers.sum()} of {len(found.inliers)} matches agree")
    if found.initial_T_goal is None:
        return
    motion, sigma = found.initial_T_goal, np.sqrt(np.diag(found.covariance))
    print(f"moved by {1e3 * motion.translation.round(5)} ± {1e3 * sigma[:3].round(5)} mm", end=", ")
    print(f"turned by {np.degrees(motion.rotation.as_rotvec()).round(3)} deg")
    off, depths = (motion.inv() * truth).translation, found.points[found.inliers, 2]
    print(f"off by {1e3 * np.linalg.norm(off):.2f} mm;", end=" ")
    print(f"points from {depths.min():.2f} to {depths.max():.2f} m ahead")


if __name__ == "__main__":
    main()
