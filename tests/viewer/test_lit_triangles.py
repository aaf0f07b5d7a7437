import io
import json

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from omniservo.viewer.lit_triangles import lit_triangles

COLOUR = (200, 120, 40)


def shades(turn, opacity=1.0):
    """Points, normals in the world and colours (n, 4) of a box as it is lit where it is turned so."""
    file = lit_triangles([(trimesh.creation.box([0.2, 0.4, 0.6]), COLOUR)], turn, opacity)
    (shape,) = trimesh.load(io.BytesIO(file), file_type="glb", process=False).geometry.values()
    colours = np.array(shape.visual.vertex_attributes["color"])
    return np.array(shape.vertices), turn.apply(np.array(shape.vertex_normals)), colours


def test_a_box_keeps_its_corners_and_each_side_has_one_shade_of_its_colour():
    points, normals, colours = shades(Rotation.identity())
    assert np.allclose(np.abs(points), [0.1, 0.2, 0.3])
    assert len(points) == 24  # its sides share no corner: edges are sharp
    linear = (np.array(COLOUR) / 255.0) ** 2.2
    share = colours[:, :1] / 255.0 / linear[0]
    assert np.abs(colours[:, :3] - 255.0 * share * linear).max() <= 1.0
    for normal in np.unique(normals.round(6), axis=0):
        assert len(np.unique(colours[np.abs(normals - normal).max(axis=1) < 1e-5], axis=0)) == 1


def test_light_comes_from_above_wherever_the_shape_is_turned():
    for turn in (Rotation.identity(), Rotation.from_rotvec([2.0, 0.3, 0.0])):
        _, normals, colours = shades(turn)
        red = colours[:, 0].astype(float)
        assert red[normals[:, 2].argmax()] > 1.3 * red[normals[:, 2].argmin()]


def test_the_file_is_drawn_without_lights_and_what_is_transparent_once():
    for opacity, seen in ((1.0, {}), (0.2, {"alphaMode": "BLEND"})):
        file = lit_triangles([(trimesh.creation.box(), COLOUR)], Rotation.identity(), opacity)
        fields = json.loads(file[20 : 20 + int.from_bytes(file[12:16], "little")])
        assert fields["materials"] == [{"extensions": {"KHR_materials_unlit": {}}, **seen}]
        assert fields["meshes"][0]["primitives"][0]["material"] == 0
