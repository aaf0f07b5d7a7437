import io

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from omniservo.viewer.path_rods import PathRods


class Scene:
    """Keeps what is added, as viser's scene does."""

    def __init__(self):
        self.added, self.lengths = {}, []

    def add_frame(self, name, **given):
        self.added[name] = Node(given["visible"])
        return self.added[name]

    def add_glb(self, name, file):
        (shape,) = trimesh.load(io.BytesIO(file), file_type="glb").geometry.values()
        self.lengths.append(np.ptp(shape.vertices[:, 2]))
        self.added[name] = Node(True)
        return self.added[name]


class Node:
    def __init__(self, visible):
        self.visible, self.position, self.wxyz = visible, np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])


GREEN, RED = (0, 255, 0), (255, 0, 0)


def ends(scene, group):
    """Both ends of every visible rod (n, 2, 3), without its rounding."""
    half = 0.5 * scene.lengths[-1] - 0.001
    rods = [node for name, node in scene.added.items() if name.startswith(f"{group}/")]
    turns = Rotation.from_quat([rod.wxyz for rod in rods], scalar_first=True)
    ahead = turns.apply([0.0, 0.0, half])
    middles = np.array([rod.position for rod in rods])
    return np.stack([middles - ahead, middles + ahead], axis=1)


def test_rods_lie_end_to_end_along_the_path_and_in_its_colour_alone():
    scene, turn = Scene(), np.linspace(0.0, 2.5, 200)
    path = 0.3 * np.stack([np.cos(turn), np.sin(turn), -0.4 * turn], axis=-1)
    rods = PathRods(scene, "/path", 0.001, (GREEN, RED))
    rods.show(path, RED)
    found = ends(scene, "/path/1")
    assert (scene.added["/path/0"].visible, scene.added["/path/1"].visible) == (False, True)
    off = [np.linalg.norm(path - place, axis=1).min() for place in found.reshape(-1, 3)]
    assert max(off[1:-1]) < 3e-3
    reach = np.einsum("ni,ni->n", found[:-1, 1] - found[1:, 0], found[:-1, 1] - found[:-1, 0])
    assert (reach >= 0.0).all()  # each ends where the next has begun
    assert np.linalg.norm(found[0, 0] - path[0]) < 0.01
    assert np.linalg.norm(found[-1, 1] - path[-1]) < 0.01


def test_rods_are_made_anew_only_for_a_path_of_another_length():
    scene = Scene()
    rods = PathRods(scene, "/path", 0.001, (GREEN,))
    straight = np.linspace([0.0, 0.0, 0.0], [0.0, 0.0, -1.0], 9)
    for scale, made in ((1.0, 1), (1.2, 1), (0.6, 1), (1.5, 2), (0.5, 3), (0.0, 4)):
        rods.show(scale * straight, GREEN)
        assert len(scene.lengths) == 16 * made
        assert np.isfinite([node.wxyz for node in scene.added.values()]).all()


def test_a_path_that_stands_still_has_its_rods_from_the_first():
    scene = Scene()
    rods = PathRods(scene, "/path", 0.001, (GREEN, RED))
    for _ in range(2):
        rods.show(np.tile([0.1, 0.2, 0.3], (9, 1)), RED)
        assert len(scene.lengths) == 2 * 16
    assert scene.added["/path/1"].visible
    assert np.allclose(
        [node.position for name, node in scene.added.items() if "/1/" in name], [0.1, 0.2, 0.3]
    )
