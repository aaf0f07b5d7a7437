"""COLLADA documents: what their scenes show, in metres."""

import tracemalloc

import numpy as np
import pytest

from omniservo.errors import InputError
from omniservo.files.mesh_files import read_triangles

SOURCE = """<source id="p"><float_array id="a" count="15">0 0 0  2 0 0  2 3 0  0 3 0  0 0 5</float_array>
<technique_common><accessor source="#a" count="5" stride="3"/></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>"""
TRIANGLES = """<triangles count="2"><input semantic="NORMAL" source="#n" offset="1"/>
<input semantic="VERTEX" source="#v" offset="0"/><p>0 9 1 9 4 9  1 9 2 9 4 9</p></triangles>"""
POLYGONS = """<polylist count="2"><input semantic="VERTEX" source="#v" offset="0"/>
<vcount>4 3</vcount><p>0 1 2 3  0 1 4</p></polylist>"""


def document(
    faces=TRIANGLES, *, node='<instance_geometry url="#g"/>', unit="0.01", up="Y_UP", root="COLLADA"
):
    return f"""<?xml version="1.0"?>
<{root} xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit meter="{unit}"/><up_axis>{up}</up_axis></asset>
<library_geometries><geometry id="g"><mesh>{SOURCE}{faces}</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node>{node}</node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene></{root}>"""


def read(folder, text):
    path = folder / "part.dae"
    path.write_text(text)
    vertices, triangles = read_triangles(path)
    return vertices[triangles]


@pytest.mark.parametrize("up", ["X_UP", "Y_UP", "Z_UP"])
def test_triangles_are_in_metres_whatever_is_up(tmp_path, up):
    wanted = [[[0, 0, 0], [2, 0, 0], [0, 0, 5]], [[2, 0, 0], [2, 3, 0], [0, 0, 5]]]
    np.testing.assert_allclose(read(tmp_path, document(up=up)), 0.01 * np.array(wanted))


def test_polygons_are_cut_into_triangles(tmp_path):
    p = 0.01 * np.array([[0, 0, 0], [2, 0, 0], [2, 3, 0], [0, 3, 0], [0, 0, 5]])
    wanted = p[[[0, 1, 2], [0, 2, 3], [0, 1, 4]]]
    np.testing.assert_allclose(read(tmp_path, document(POLYGONS)), wanted)


def test_nodes_move_what_they_hold(tmp_path):
    inner = '<node><scale>1 1 2</scale><instance_geometry url="#g"/></node>'
    node = f'<translate>1 0 0</translate><rotate>0 0 2 90</rotate>{inner}<instance_geometry url="#g"/>'
    found = read(tmp_path, document(node=node, unit="1"))
    assert found.shape == (4, 3, 3)
    own = np.array([[0, 0, 0], [2, 0, 0], [0, 0, 5]], dtype=float)
    turned = np.stack([1.0 - own[:, 1], own[:, 0], own[:, 2]], axis=1)
    np.testing.assert_allclose(found[0], turned, atol=1e-12)
    np.testing.assert_allclose(found[2], turned * [1, 1, 2], atol=1e-12)
    matrix = "<matrix>0 -1 0 1  1 0 0 0  0 0 1 0  0 0 0 1</matrix>"
    found = read(tmp_path, document(node=matrix + '<instance_geometry url="#g"/>', unit="1"))
    np.testing.assert_allclose(found[0], turned, atol=1e-12)


SHOWN = '<instance_node url="#n{}"/>'


def library(nodes, text):
    return text.replace("<library_visual", f"<library_nodes>{nodes}</library_nodes><library_visual", 1)


def test_nodes_of_a_library_are_shown_where_they_are_named(tmp_path):
    inner = '<node><scale>1 1 2</scale><instance_geometry url="#g"/></node>'
    named = f'<node id="n"><translate>1 0 0</translate>{inner}</node>'
    text = document(node='<translate>0 5 0</translate><instance_node url="#n"/>', unit="1")
    own = np.array([[0, 0, 0], [2, 0, 0], [0, 0, 5]], dtype=float)
    np.testing.assert_allclose(read(tmp_path, library(named, text))[0], own * [1, 1, 2] + [1, 5, 0])


@pytest.mark.parametrize(
    "nodes",
    [
        '<node id="n"><instance_node url="#n"/></node>',
        '<node id="n">' + '<instance_node url="#n"/>' * 1000 + "</node>",
        "".join(f'<node id="n{k or ""}">{SHOWN.format(k + 1) * 9}</node>' for k in range(9))
        + '<node id="n9"/>',
    ],
)
def test_nodes_that_show_themselves_or_each_other_are_bounded(tmp_path, nodes):
    text = document(node='<instance_node url="#n"/>')
    with pytest.raises(InputError, match="more than 100000 nodes, or one that shows itself"):
        read(tmp_path, library(nodes, text))


def test_vertices_begin_at_the_offset_of_their_accessor(tmp_path):
    text = document(unit="1").replace(' count="15">', ' count="18">7 8 9  ')
    found = read(tmp_path, text.replace('stride="3"', 'stride="3" offset="3"'))
    np.testing.assert_array_equal(
        found, [[[0, 0, 0], [2, 0, 0], [0, 0, 5]], [[2, 0, 0], [2, 3, 0], [0, 0, 5]]]
    )


def test_without_a_scene_everything_is_shown(tmp_path):
    text = document().replace('<scene><instance_visual_scene url="#s"/></scene>', "")
    assert len(read(tmp_path, text)) == 2


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("no xml", "not DAE as far as can be read: document: line 1: not XML"),
        ("<!DOCTYPE a []><COLLADA/>", "document types"),
        (document(root="SDF"), "root element 'SDF'"),
        (document("<tristrips/>"), "<tristrips> is not read"),
        (document(node='<instance_controller url="#c"/>'), "<instance_controller> in a scene is not read"),
        (document(node='<instance_geometry url="#lost"/>'), "lost"),
        (document(node=""), "no triangles in it"),
        (document().replace("4 9  1", "5 9  1"), "a corner 5, but only 5 vertices"),
        (document().replace("4 9  1", "4  1"), "cannot reshape"),
        (document().replace("2 3 0", "2 three 0"), "three"),
        (document().replace("2 3 0", "2 nan 0"), "every number must be finite"),
        (document(POLYGONS.replace("4 3", "5 2")), "a polygon of fewer than 3 corners"),
    ],
)
def test_a_bad_document_is_one_message(tmp_path, text, message):
    with pytest.raises(InputError, match=message) as raised:
        read(tmp_path, text)
    assert str(tmp_path / "part.dae") in str(raised.value)
    assert "\n" not in str(raised.value)


def test_what_is_shown_again_and_again_is_bounded(tmp_path):
    corners = " ".join(["0 0 1 0 4 0"] * 100_000)
    many = f'<triangles><input semantic="VERTEX" source="#v" offset="0"/><p>{corners}</p></triangles>'
    with pytest.raises(InputError, match="more than 2000000 triangles"):
        read(tmp_path, document(many, node='<instance_geometry url="#g"/>' * 20))


def peak_of(folder, text):
    """Return the most memory that reading took [bytes]."""
    tracemalloc.start()
    try:
        with pytest.raises(InputError):
            read(folder, text)
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("counts", ["4 30000000", "4 4", "7 9223372036854775807"])
def test_a_polygon_of_more_corners_than_there_are_takes_no_memory(tmp_path, counts):
    assert peak_of(tmp_path, document(POLYGONS.replace("4 3", counts))) < 2**25


def test_points_that_no_triangle_has_take_no_memory_for_each_part_of_a_mesh(tmp_path):
    points = "0 0 0 " * 20_000
    many = document(TRIANGLES * 200, node='<instance_geometry url="#g"/>' * 20)
    many = many.replace("0 0 5<", f"0 0 5 {points}<")
    tracemalloc.start()
    triangles = read(tmp_path, many)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert len(triangles) == 2 * 200 * 20
    assert peak < 2**25
