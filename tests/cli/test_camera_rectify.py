"""``omniservo camera rectify`` and the figures of ``show``."""

import math

import numpy as np
import pytest
from PIL import Image
from tests.cli.valid_output import check_output

from omniservo.cameras import preset
from omniservo.cli.main import main


def done(arguments):
    with pytest.raises(SystemExit) as end:
        main(arguments)
    assert not end.value.code


@pytest.fixture
def picture(tmp_path):
    """A picture of the paper's fisheye whose grey is the longitude, with a red channel of its own."""
    camera = preset("fe185")
    v, u = np.mgrid[0 : camera.height, 0 : camera.width].astype(float)
    rays, valid = camera.unproject(np.stack([u, v], axis=-1))
    longitude = np.degrees(np.arctan2(rays[..., 0], rays[..., 2]))
    grey = np.where(valid, np.nan_to_num(128 + longitude), 0)
    path = tmp_path / "fisheye.png"
    Image.fromarray(np.stack([grey, grey, 0 * grey + 7], axis=-1).astype(np.uint8)).save(path)
    return path


@pytest.mark.parametrize(
    ("options", "size", "middle"),
    [
        (["--view-size", "200x100"], (200, 100), 128),
        (["--direction", "1,0,1", "--view-size", "201x101", "--field-of-view", "40"], (201, 101), 173),
        (["--view", "cylindrical", "--view-size", "361x101"], (361, 101), 128),
        (["--view", "equirectangular", "--view-size", "360x180"], (360, 180), 128),
    ],
)
def test_view_is_written(picture, tmp_path, capsys, options, size, middle):
    out = tmp_path / "view.png"
    done(["camera", "rectify", "fe185", str(picture), str(out), "--json", *options])
    said = check_output(capsys.readouterr().out)
    image = np.asarray(Image.open(out))
    assert image.shape == (size[1], size[0], 3)
    assert abs(int(image[size[1] // 2, size[0] // 2, 0]) - middle) <= 1
    assert image[size[1] // 2, size[0] // 2, 2] == 7
    assert 0.3 < said["seen"] <= 1.0


def test_perspective_has_the_name_of_before_too(picture, tmp_path):
    views = []
    for name in ("perspective", "tangent"):
        out = tmp_path / f"{name}.png"
        done(["camera", "rectify", "fe185", str(picture), str(out), "--view", name, "--view-size", "60x40"])
        views.append(out.read_bytes())
    assert views[0] == views[1]


def test_columns_of_the_cylinder_are_meridians(picture, tmp_path):
    out = tmp_path / "view.png"
    options = ["--view", "cylindrical", "--view-size", "180x90", "--field-of-view", "120", "--quiet"]
    done(["camera", "rectify", "fe185", str(picture), str(out), *options])
    row = np.asarray(Image.open(out))[45, :, 0].astype(float)
    longitude = (np.arange(180) - 89.5) * 120 / 180
    assert np.abs(row - 128 - longitude).max() < 2.0
    assert math.isclose(row[90] - row[89], 120 / 180, abs_tol=1.01)


def test_up_turns_the_view_over(picture, tmp_path):
    views = []
    for up in ("0,-1,0", "0,1,0"):
        out = tmp_path / f"{len(views)}.png"
        done(["camera", "rectify", "fe185", str(picture), str(out), "--view-size", "101x81", "--up", up])
        views.append(np.asarray(Image.open(out)).astype(int))
    assert np.abs(views[0] - views[1][::-1, ::-1]).max() <= 1


@pytest.mark.parametrize(
    ("options", "named"),
    [
        (["--view-size", "200"], "--view-size"),
        (["--view-size", "99999x99999"], "size"),
        (["--direction", "1,0"], "--direction"),
        (["--direction", "0,0,0"], "direction"),
        (["--up", "up"], "--up"),
        (["--up", "0,0,1"], "up"),
        (["--field-of-view", "180"], "--field-of-view: 180 given; legal: above 0, below 180 (degrees)"),
        (["--field-of-view", "nan"], "--field-of-view: nan given"),
        (["--view", "cylindrical", "--field-of-view", "361"], "361 given; legal: above 0, at most 360"),
        (["--view", "equirectangular", "--field-of-view", "90"], "--field-of-view"),
    ],
)
def test_wrong_options_are_one_message(picture, tmp_path, capsys, options, named):
    out = tmp_path / "view.png"
    with pytest.raises(SystemExit) as end:
        main(["camera", "rectify", "fe185", str(picture), str(out), *options])
    said = capsys.readouterr().err
    assert end.value.code == 2
    assert named in said
    assert not out.exists()


@pytest.mark.slow
def test_show_draws_the_field(tmp_path, capsys):
    folder = tmp_path / "field"
    done(["camera", "show", "fe185", "--out", str(folder)])
    assert sorted(p.name for p in folder.iterdir()) == [
        "camera-density.png",
        "camera-density.svg",
        "camera-field.png",
        "camera-field.svg",
    ]
    assert "past 90 deg" in capsys.readouterr().out


def test_show_cannot_draw_into_a_file(tmp_path, capsys):
    (tmp_path / "field").write_text("mine")
    with pytest.raises(SystemExit) as end:
        main(["camera", "show", "fe185", "--out", str(tmp_path / "field")])
    assert end.value.code == 2
    assert "--out" in capsys.readouterr().err


def test_an_image_of_another_size_is_named(tmp_path, capsys):
    image, out = tmp_path / "small.png", tmp_path / "view.png"
    Image.fromarray(np.zeros((24, 32), dtype=np.uint8)).save(image)
    with pytest.raises(SystemExit) as end:
        main(["camera", "rectify", "fe185", str(image), str(out)])
    assert end.value.code == 2
    assert capsys.readouterr().err == f"omniservo: {image}: 32×24 px; the camera has 659×432\n"
    assert not out.exists()
