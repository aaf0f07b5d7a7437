"""What render draws of a MuJoCo model is what MuJoCo's own rays meet and its own renderer shows."""

import inspect
import subprocess
import sys
from pathlib import Path

import cv2
import mujoco
import numpy as np
import pytest
from PIL import Image, PngImagePlugin
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo import UnifiedCamera, render
from omniservo.cameras.models import Equirectangular, KannalaBrandt
from omniservo.errors import InputError
from omniservo.simulation import load_scene_model
from omniservo.simulation.mesh_coordinates import mesh_coordinates
from omniservo.simulation.video import video_bytes

SCENE = Path(__file__).resolve().parents[2] / "examples/scene.xml"
POSE = RigidTransform.from_components([0.1, -0.9, 0.5], Rotation.from_euler("x", -100, degrees=True))
SHOWN = np.array([1, 1, 1, 0, 0, 0], dtype=np.uint8)

CAMERAS = {
    "perspective": UnifiedCamera(90, 90, 79.5, 59.5, 0.0, 160, 120),
    "fisheye": UnifiedCamera(74, 74, 79.5, 59.5, 1.3, 160, 120, max_angle=np.radians(92.5)),
    "mirror": UnifiedCamera(-40, 40, 79.5, 59.5, 0.9, 160, 120, dead_zone={"center": [80, 60], "radius": 12}),
    "past 180°": KannalaBrandt(35, 35, 79.5, 59.5, 160, 120, k=(0, 0, 0, 0), max_angle=np.radians(110)),
    "masked": UnifiedCamera(90, 90, 79.5, 59.5, 0.0, 160, 120, mask=[[[0, 0], [40, 0], [0, 40]]]),
    "whole sphere": Equirectangular(160, 80),
}


@pytest.fixture(scope="module")
def scene():
    model = load_scene_model(SCENE)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


@pytest.mark.parametrize("name", CAMERAS)
def test_distances_and_geoms_are_those_of_mujocos_own_ray_of_each_pixel(scene, name):
    model, data = scene
    camera = CAMERAS[name]
    seen = render(model, data, camera, POSE)
    u, v = np.meshgrid(np.arange(0, camera.width, 5), np.arange(0, camera.height, 5))
    bearings, valid = camera.unproject(np.stack([u, v], axis=-1).astype(float))
    valid &= camera.in_image(np.stack([u, v], axis=-1).astype(float))
    assert (seen.valid[v, u] == valid).all()
    assert (seen.geoms[v, u][~valid] == -1).all()
    met, geom = set(), np.zeros(1, dtype=np.int32)
    for row, column in np.argwhere(valid):
        way = POSE.rotation.apply(bearings[row, column])
        alone = mujoco.mj_ray(model, data, POSE.translation, way, SHOWN, True, -1, geom)
        at = v[row, column], u[row, column]
        if alone < 0.0:
            assert np.isnan(seen.distance[at])
            assert seen.geoms[at] == -1
        else:
            assert seen.distance[at] == pytest.approx(alone, abs=1e-9)
            assert seen.geoms[at] == geom[0]
            met.add(int(geom[0]))
    assert len(met) >= 2  # the mirror reverses what is beside it


@pytest.mark.parametrize(("name", "row", "column"), [("masked", 3, 3), ("mirror", 60, 80), ("fisheye", 2, 2)])
def test_what_the_lens_does_not_see_is_black(scene, name, row, column):
    seen = render(*scene, CAMERAS[name], POSE)
    assert not seen.valid[row, column]
    assert not seen.image[row, column].any()
    assert np.isnan(seen.distance[row, column])
    assert seen.image.any()


OWN = """
import sys, mujoco, numpy as np
model = mujoco.MjModel.from_xml_path(sys.argv[1])
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
renderer = mujoco.Renderer(model, 240, 320)
renderer.update_scene(data, camera="own")
np.save(sys.argv[2], renderer.render())
"""


def shown_by_mujoco(folder, program):
    """Return what a program in the folder saves of MuJoCo's own images, in a process of its own."""
    (folder / "own.py").write_text(program)
    ended = subprocess.run(
        [sys.executable, "own.py", "scene.xml", "own.npy"], cwd=folder, capture_output=True, check=False,
        env={"MUJOCO_GL": "egl", "PYTHONPATH": ":".join(sys.path)},
    )  # fmt: skip
    if not (folder / "own.npy").exists():
        pytest.skip(f"no EGL here: {ended.stderr[-80:]!r}")
    return np.load(folder / "own.npy").astype(int)


@pytest.mark.slow
def test_a_perspective_image_is_that_of_mujocos_own_renderer(tmp_path):
    """Shadows' borders and acne aside; the headlight off, which shines from the centre here."""
    xml = SCENE.read_text().replace("<headlight", '<headlight active="0"')
    camera = '<camera name="own" pos="1.2 -1.1 1.1" xyaxes=".67 .74 0 -.42 .38 .82" fovy="45"/></worldbody>'
    (tmp_path / "scene.xml").write_text(xml.replace("</worldbody>", camera))
    own = shown_by_mujoco(tmp_path, OWN)
    model = load_scene_model(tmp_path / "scene.xml")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    axes = data.cam_xmat[0].reshape(3, 3) @ np.diag([1.0, -1.0, -1.0])
    pose = RigidTransform.from_components(data.cam_xpos[0], Rotation.from_matrix(axes))
    focal = 120.0 / np.tan(np.radians(22.5))
    ours = render(model, data, UnifiedCamera(focal, focal, 159.5, 119.5, 0.0, 320, 240), pose)
    off = np.abs(ours.image - own).max(axis=-1)
    for geom in range(model.ngeom):
        of_it = off[ours.geoms == geom]
        assert len(of_it) > 50, geom
        smoothed = model.geom(geom).name == "pyramid"  # there; by its faces here
        assert np.median(of_it) <= (30 if smoothed else 6), model.geom(geom).name
    assert np.quantile(off, 0.9) <= 20
    assert np.median(off[ours.geoms < 0]) <= 2  # the sky


_CORNERS = "-.3 -.2 -.25 .3 -.2 -.25 .3 .2 -.25 -.3 .2 -.25 -.3 -.2 .25 .3 -.2 .25 .3 .2 .25 -.3 .2 .25"
_FACES = "0 2 1 0 3 2 4 5 6 4 6 7 0 1 5 0 5 4 1 2 6 1 6 5 2 3 7 2 7 6 3 0 4 3 4 7"
_SHAPES = {
    "plane": "size='.45 .3 .1'", "strip": "size='0 .3 .1'", "box": "size='.3 .2 .25'", "sphere": "size='.35'",
    "ellipsoid": "size='.3 .2 .4'", "cylinder": "size='.2 .3'", "capsule": "size='.2 .25'",
    "hfield": "hfield='hills'", "mesh": "mesh='block'", "spread": "mesh='spread'",
}  # fmt: skip
_TYPES = {"strip": "plane", "spread": "mesh"}


def painted(path):
    """The file's model with clouds for its texture, and its data; also run where MuJoCo's renderer is."""
    import mujoco
    import numpy as np
    from scipy.ndimage import gaussian_filter

    model = mujoco.MjModel.from_xml_path(path)
    clouds = gaussian_filter(np.random.default_rng(0).normal(size=(192, 32, 3)), (4, 4, 0), mode="wrap")
    clouds = np.round(255 * (clouds - clouds.min()) / np.ptp(clouds)).astype(np.uint8)
    model.tex_data[:] = clouds.ravel()[: model.tex_data.size]
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


SHOWN_BY_MUJOCO = """
import sys, mujoco, numpy as np
model, data = painted(sys.argv[1])
renderer, images = mujoco.Renderer(model, 120, 160), []
for camera in range(model.ncam):
    renderer.update_scene(data, camera)
    images.append(renderer.render())
np.save(sys.argv[2], images)
"""


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["2d", "cube"])
@pytest.mark.parametrize("uniform", ["false", "true"])
def test_textures_lie_on_every_shape_as_mujocos_own_renderer_lays_them(kind, uniform, tmp_path):
    """Each shape fills an image of its own, seen askew, with nothing but its texture on it."""
    size = "width='32' height='192'" if kind == "2d" else "width='32' height='32'"
    shapes = [name for name in _SHAPES if kind == "2d" or name not in ("spread", "strip")]
    bodies = "".join(
        f"<body pos='{9 * i} 0 0' euler='20 -15 30'><geom name='{name}' type='{_TYPES.get(name, name)}' "
        f"{_SHAPES[name]} material='painted'/></body>"
        f"<camera pos='{9 * i + 0.7} -.9 .8' xyaxes='.79 .61 0 -.35 .45 .82' fovy='40'/>"
        for i, name in enumerate(shapes)
    )
    (tmp_path / "scene.xml").write_text(
        f"""<mujoco><visual><headlight ambient="0 0 0" diffuse="0 0 0" specular="0 0 0"/></visual><asset>
        <texture name="clouds" type="{kind}" builtin="flat" {size}/>
        <material name="painted" texture="clouds" texrepeat="2 .5" texuniform="{uniform}" specular="0"
          emission="1"/>
        <mesh name="block" vertex="{_CORNERS}" face="{_FACES}"/>
        <mesh name="spread" vertex="{_CORNERS}" face="{_FACES}"
          texcoord="0 0 1 0 1 1 0 1 .2 .2 .8 .1 .9 .9 .1 .8"/>
        <hfield name="hills" nrow="4" ncol="4" size=".45 .3 .1 .1" elevation="{"0 1 2 1 " * 4}"/>
        </asset><worldbody>{bodies}</worldbody></mujoco>"""
    )
    images = shown_by_mujoco(tmp_path, inspect.getsource(painted) + SHOWN_BY_MUJOCO)
    model, data = painted(str(tmp_path / "scene.xml"))
    focal = 60.0 / np.tan(np.radians(20.0))
    lens = UnifiedCamera(focal, focal, 79.5, 59.5, 0.0, 160, 120)
    for i, own in enumerate(images):
        axes = data.cam_xmat[i].reshape(3, 3) @ np.diag([1.0, -1.0, -1.0])
        ours = render(
            model, data, lens, RigidTransform.from_components(data.cam_xpos[i], Rotation.from_matrix(axes))
        )
        inside = ours.geoms == model.geom(shapes[i]).id
        off = np.abs(ours.image - own).max(axis=-1)[inside]
        assert len(off) > 1000, shapes[i]
        assert np.median(off) <= 8, (shapes[i], np.median(off))


def test_points_of_a_mesh_lie_in_its_texture_where_its_faces_say(scene):
    """Each face of the pyramid is linear in its corners' coordinates."""
    model, _ = scene
    rng = np.random.default_rng(2)
    mesh = model.mesh("pyramid").id
    faces, begin = model.mesh_face[: model.mesh_facenum[mesh]], int(model.mesh_texcoordadr[mesh])
    shares = rng.dirichlet([1.0, 1.0, 1.0], (len(faces), 40))
    points = np.einsum("fpk,fkj->fpj", shares, model.mesh_vert[faces].astype(float)).reshape(-1, 3)
    stated = model.mesh_texcoord[begin + model.mesh_facetexcoord[: len(faces)]]
    expected = np.einsum("fpk,fkj->fpj", shares, stated.astype(float)).reshape(-1, 2)
    np.testing.assert_allclose(mesh_coordinates(model, mesh, points), expected, atol=1e-6)


@pytest.mark.parametrize(
    ("said", "grey"), [(None, 120), (b"\0", round(255 * ((120 / 255 + 0.055) / 1.055) ** 2.4))]
)
def test_a_texture_that_says_that_it_is_srgb_is_made_linear_as_mujoco_makes_it(said, grey, tmp_path):
    """Its own renderer shows 48 for 120 then."""
    chunks = PngImagePlugin.PngInfo()
    if said is not None:
        chunks.add(b"sRGB", said)
    Image.fromarray(np.full((8, 8, 3), 120, np.uint8)).save(tmp_path / "grey.png", pnginfo=chunks)
    (tmp_path / "scene.xml").write_text(
        """<mujoco><visual><headlight ambient="0 0 0" diffuse="0 0 0" specular="0 0 0"/></visual>
        <asset><texture name="t" type="2d" file="grey.png"/><material name="m" texture="t"
        emission="1"/></asset><worldbody><geom type="plane" size="9 9 1" material="m"/></worldbody>
        </mujoco>"""
    )
    for model in (
        load_scene_model(tmp_path / "scene.xml"),
        mujoco.MjModel.from_xml_path(str(tmp_path / "scene.xml")),
    ):
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        above = RigidTransform.from_components([0.0, 0.0, 2.0], Rotation.from_euler("x", 180, degrees=True))
        assert (render(model, data, CAMERAS["perspective"], above).image == grey).all()


@pytest.mark.parametrize("kind", ["spot", "point"])
def test_light_fades_with_the_distance_as_stated(kind):
    for height in (0.5, 1.0, 2.0):
        model = mujoco.MjModel.from_xml_string(
            f"""<mujoco><visual><headlight active="0"/></visual><worldbody>
            <light type="{kind}" pos="0 0 {height}" dir="0 0 -1" attenuation="0.5 0.4 0.3" diffuse="1 1 1"
              specular="0 0 0" castshadow="false"/>
            <geom type="plane" size="3 3 .1" rgba="0.5 0.5 0.4 1"/></worldbody></mujoco>"""
        )
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        above = RigidTransform.from_components([0.0, 0.0, 3.0], Rotation.from_euler("x", 180, degrees=True))
        seen = render(model, data, UnifiedCamera(90, 90, 80, 60, 0.0, 161, 121), above).image[60, 80]
        share = 1.0 / (0.5 + 0.4 * height + 0.3 * height**2)
        np.testing.assert_allclose(seen, 255 * np.minimum(share * np.array([0.5, 0.5, 0.4]), 1.0), atol=1)


def test_a_shape_hides_a_lamp_from_what_is_behind_it():
    xml = """<mujoco><visual><headlight active="0"/></visual><worldbody>
      <light type="directional" dir="0 0 -1" diffuse="1 1 1" specular="0 0 0" castshadow="{}"/>
      <geom type="plane" size="3 3 .1" rgba="1 1 1 1"/><geom type="box" size=".2 .2 .01" pos="0 0 1"/>
    </worldbody></mujoco>"""
    below = RigidTransform.from_components([0.0, 0.0, 0.5], Rotation.from_euler("x", 180, degrees=True))
    middles = []
    for shadow in ("true", "false"):
        model = mujoco.MjModel.from_xml_string(xml.format(shadow))
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        image = render(model, data, UnifiedCamera(40, 40, 39.5, 29.5, 0.0, 80, 60), below).image
        middles.append((int(image[30, 40, 0]), int(image[2, 2, 0])))
    assert middles == [(0, 255), (255, 255)]


@pytest.mark.parametrize("wrong", [0, 1, 2, 3])
def test_wrong_values_are_named(scene, wrong):
    given = [*scene, CAMERAS["fisheye"], POSE]
    given[wrong] = "nothing"
    with pytest.raises(InputError, match=f"^{('model', 'data', 'camera', 'pose')[wrong]}: "):
        render(*given)


def test_a_camera_of_more_pixels_than_memory_is_refused_before_any_is_drawn(scene):
    """A small calibration file can state 10¹⁰ of them."""
    with pytest.raises(InputError, match="^camera: 100000x100000 pixels given; legal: at most 33554432"):
        render(*scene, UnifiedCamera(300, 300, 1, 2, 1.0, 100_000, 100_000), POSE)


@pytest.mark.parametrize("ending", [".mp4", ".avi"])
def test_a_video_of_odd_sides_shows_all_of_its_frames(tmp_path, ending):
    """Codecs of even sides cut the last row and column off."""
    frames = np.zeros((3, 77, 101, 3), dtype=np.uint8)
    frames[:, 69:, 93:] = 255
    path = tmp_path / f"video{ending}"
    path.write_bytes(video_bytes(iter(frames), ending, 25.0))
    reader = cv2.VideoCapture(str(path))
    shown = [reader.read()[1] for _ in frames]
    for image in shown:
        assert image.shape == (78, 102, 3)
        assert (image[71:, 95:] > 200).all()
        assert image[:60, :85].max() < 50


def test_data_of_another_model_is_refused(scene):
    model = mujoco.MjModel.from_xml_string("<mujoco/>")
    with pytest.raises(InputError, match="data: of another model"):
        render(scene[0], mujoco.MjData(model), CAMERAS["fisheye"], POSE)
