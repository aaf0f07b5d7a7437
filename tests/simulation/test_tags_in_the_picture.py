"""Printed tags in the simulator's picture are found where projection says their corners are."""

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.perception import find_tags, tag_cells, tag_picture
from omniservo.scenes import Panel
from omniservo.simulation import UnifiedRenderer, World

EDGE = 0.05
POSES = {
    3: ((0.0, 0.05, 0.3), (0.3, 0.2, 0.8)),
    17: ((0.2, -0.04, 0.15), (0.2, 0.8, -0.3)),
    42: ((-0.25, 0.02, 0.06), (0.1, -1.1, 0.2)),
}
HALF = 0.5 * EDGE
CORNERS = np.array([[-HALF, -HALF, 0.0], [HALF, -HALF, 0.0], [HALF, HALF, 0.0], [-HALF, HALF, 0.0]])


def test_tags_in_the_simulators_picture_are_found_where_they_are(make_scene, fisheye):
    base = make_scene()
    world_T_camera = base.world_T_camera(base.start_joints)
    side = EDGE * (1.0 + 2.0 / tag_cells("tag36h11"))
    panels, truth = [], {}
    for number, (center, rotation) in POSES.items():
        pose = RigidTransform.from_components(center, Rotation.from_rotvec(rotation))
        picture = np.where(tag_picture("tag36h11", number, pixels_per_cell=1) > 0, 0.88, 0.03)
        panels.append(Panel(f"tag {number}", world_T_camera * pose, np.array([side, side]), picture))
        truth[number] = fisheye.project(pose.apply(CORNERS))[0]
    scene = make_scene(camera=fisheye, panels=tuple(panels), boards=(), dots=None, floor=None)
    image = UnifiedRenderer(World(scene)).render(base.start_joints)
    noise = np.random.default_rng(0).normal(0.0, 2.0, image.shape)
    grey = np.clip(np.rint(200.0 * image / image.max() + noise), 0, 255).astype(np.uint8)
    found = find_tags(grey, fisheye)
    assert found.ids.tolist() == sorted(POSES)
    errors = np.linalg.norm(found.corners - np.array([truth[k] for k in found.ids]), axis=2)
    assert errors.max() < 0.1
