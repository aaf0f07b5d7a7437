"""Scene files that no one need trust are read within bounds, or refused by name."""

import mujoco
import numpy as np
import pytest
from PIL import Image

from omniservo.errors import InputError
from omniservo.simulation import load_scene_model


def written(folder, inner="", asset="", top=""):
    text = f"<mujoco>{top}<asset>{asset}</asset><worldbody><geom size='.1'/>{inner}</worldbody></mujoco>"
    (folder / "scene.xml").write_text(text)
    return folder / "scene.xml"


REFUSED = {
    "a document type": ({"top": ""}, "DOCTYPE", "<!DOCTYPE x [<!ENTITY a 'b'>]>"),
    "an include outside": ({"top": "<include file='../../other.xml'/>"}, "inside the file's folder", ""),
    "an include of itself": ({"top": "<include file='scene.xml'/>"}, "included twice; once is legal", ""),
    "a texture outside": ({"asset": "<texture type='2d' file='/etc/passwd'/>"}, "inside the file's", ""),
    "a texture that is none": ({"asset": "<texture type='2d' file='scene.xml'/>"}, "not an image", ""),
    "a huge texture": (
        {"asset": "<texture type='2d' builtin='flat' width='100000' height='9'/>"}, "at most 4096 a side", "",
    ),
    "a cube, of which MuJoCo makes six sides": (
        {"asset": "<texture name='c' builtin='flat' width='4096'/>"}, "4096 × 4096 given", "",
    ),
    "a texture of fewer pixels than none": (
        {"asset": "".join(f"<texture name='{name}' type='2d' builtin='flat' width='{width}' height='4096'/>"
                          for name, width in (("a", -4096), ("b", 4096), ("c", 4096), ("d", 4096)))},
        "4096 × 4096 given", "",
    ),
    "a huge height field": (
        {"asset": "<hfield name='h' nrow='90000' ncol='9' size='1 1 1 1'/>"}, "at most 4096 a side", "",
    ),
    "a mesh outside": ({"asset": "<mesh file='../../a.stl'/>"}, "inside the file's folder", ""),
    "a mesh of another format": ({"asset": "<mesh file='a.msh'/>"}, "legal: .stl, .obj", ""),
    "a made mesh": ({"asset": "<mesh name='m' builtin='supersphere' params='9 9 9'/>"}, "vertex", ""),
    "a plugin": ({"top": "<extension><plugin plugin='x'/></extension>"}, "<extension> in <mujoco>", ""),
    "many parts of one element": ({"inner": "<replicate count='1000000'/>"}, "<replicate> in the tree", ""),
    "a composite": ({"inner": "<composite type='cable'/>"}, "<composite> in the tree", ""),
    "a model of another file": ({"asset": "<model file='scene.xml'/>"}, "<model> in <asset>", ""),
    "an infinite number": ({"inner": "<geom size='inf'/>"}, "inf", ""),
    "a texture far outside": ({"asset": "<texture type='2d' file='../../t.png'/>"}, "inside the file's", ""),
    "an unknown material": ({"inner": "<geom size='.1' material='no'/>"}, "MuJoCo cannot read it", ""),
}  # fmt: skip


@pytest.mark.parametrize("what", REFUSED)
def test_what_could_read_or_grow_is_refused_by_name(tmp_path, what):
    parts, words, before = REFUSED[what]
    path = written(tmp_path, **parts)
    path.write_text(before + path.read_text())
    with pytest.raises(InputError, match=words) as refused:
        load_scene_model(path)
    assert str(tmp_path) in str(refused.value)


def test_a_scene_with_includes_textures_meshes_and_what_moves_is_read(tmp_path):
    Image.fromarray(np.full((4, 8, 3), [200, 10, 10], dtype=np.uint8)).save(tmp_path / "red.png")
    (tmp_path / "more.xml").write_text(
        "<mujocoinclude><asset><texture name='t' type='2d' file='red.png'/><material name='m' texture='t'/>"
        "</asset></mujocoinclude>"
    )
    path = written(
        tmp_path,
        inner="<body name='b'><joint name='j' type='hinge'/><geom name='g' size='.2' material='m'/></body>",
        top="<include file='more.xml'/><option timestep='1'/><actuator><motor joint='j'/></actuator>",
    )
    model = load_scene_model(path)
    assert isinstance(model, mujoco.MjModel)
    assert (model.ngeom, model.njnt, model.nu) == (2, 1, 0)
    assert model.tex_data[:3].tolist() == [200, 10, 10]


def test_files_as_others_write_them_are_read(tmp_path):
    """Joints of huge damping, skins, files named by themselves and beside the folder, trees of 60 bodies."""
    (tmp_path / "scenes").mkdir()
    (tmp_path / "textures").mkdir()
    grey = np.arange(64, dtype=np.uint8).reshape(8, 8)
    Image.fromarray(grey).save(tmp_path / "scenes/hills.png")
    Image.fromarray(np.full((4, 4, 3), [10, 200, 10], dtype=np.uint8)).save(tmp_path / "textures/green.png")
    path = written(
        tmp_path / "scenes",
        inner="<geom type='hfield' hfield='hills'/><geom type='plane' size='1 1 1' material='m'/>"
        + "<body pos='0 0 .1'><joint axis='1 0 0' damping='1e+11' stiffness='1e12'/><geom size='.01'/>" * 60
        + "</body>" * 60,
        asset="<skin name='s' file='s.skn'/><hfield file='hills.png' size='1 1 1 1'/>"
        "<texture type='2d' file='green.png'/>"
        "<material name='m' texture='green'/>",
        top="<compiler texturedir='../textures' settotalmass='3'/>",
    )
    text = path.read_text().replace("file='hills.png'", "file='../scenes/hills.png'")
    path.write_text(text)
    model = load_scene_model(path)
    assert (model.nhfield, model.nbody, model.njnt) == (1, 61, 60)
    assert model.tex_data[:3].tolist() == [10, 200, 10]


def test_what_is_wrong_is_said_once(tmp_path):
    with pytest.raises(InputError) as refused:
        load_scene_model(written(tmp_path, asset="<mesh file='a.msh'/>"))
    assert str(refused.value).count(str(tmp_path)) == 1
