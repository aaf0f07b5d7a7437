"""Images of every kind are read as the grey values that were stored, or refused."""

import numpy as np
import pytest
from PIL import Image

from omniservo.errors import InputError
from omniservo.files import image_files
from omniservo.files.image_files import read_grey_image, read_image

GREY = np.tile(np.arange(256, dtype=np.uint8), (40, 1))
COLOURS = np.stack([GREY] * 3, axis=-1)

KINDS = {
    "grey.png": GREY,
    "16 bits.png": 257 * GREY.astype(np.uint16),
    "12 of 16 bits.png": 16 * GREY.astype(np.uint16),
    "16 bits.tif": 257 * GREY.astype(np.uint16),
    "32 bits.tif": 257 * GREY.astype(np.int32),
    "floats.tif": GREY.astype(np.float32) / 255,
    "colours.png": COLOURS,
    "colours.webp": COLOURS,
}


@pytest.mark.parametrize("name", KINDS)
def test_grey_values_are_those_that_were_stored(name, tmp_path):
    Image.fromarray(KINDS[name]).save(tmp_path / name, **({"lossless": True} if "webp" in name else {}))
    assert np.array_equal(read_grey_image(tmp_path / name), GREY)
    pixels = read_image(tmp_path / name)
    assert np.array_equal(pixels, COLOURS if "colours" in name else GREY)


@pytest.mark.parametrize("mode", ["LA", "RGBA", "CMYK", "YCbCr"])
def test_transparency_and_other_colour_spaces_change_no_grey_value_by_more_than_one(mode, tmp_path):
    Image.fromarray(COLOURS).convert(mode).save(tmp_path / "image.tif")
    assert np.abs(read_grey_image(tmp_path / "image.tif").astype(int) - GREY).max() <= 1


def test_a_palette_and_two_colours_are_read_as_what_they_stand_for(tmp_path):
    Image.fromarray(GREY).convert("P").save(tmp_path / "palette.png")
    assert np.array_equal(read_grey_image(tmp_path / "palette.png"), GREY)
    Image.fromarray(GREY > 127).save(tmp_path / "two.png")
    assert np.array_equal(read_grey_image(tmp_path / "two.png"), np.where(GREY > 127, 255, 0))


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("kind", ["png", "tif", "webp"])
def test_an_image_is_as_it_is_stored_whatever_orientation_it_states(kind, orientation, tmp_path):
    exif = Image.Exif()
    exif[0x0112] = orientation
    stored = COLOURS.copy()
    stored[:20] = 0  # no symmetry
    lossless = {"lossless": True} if kind == "webp" else {}
    Image.fromarray(stored).save(tmp_path / f"image.{kind}", exif=exif, **lossless)
    assert np.array_equal(read_image(tmp_path / f"image.{kind}"), stored)
    assert np.array_equal(read_grey_image(tmp_path / f"image.{kind}"), stored[..., 0])
    assert image_files.image_size(tmp_path / f"image.{kind}") == (256, 40)


def test_of_several_images_in_a_file_the_first_is_read(tmp_path):
    both = Image.fromarray(GREY), Image.fromarray(255 - GREY)
    both[0].save(tmp_path / "moving.gif", save_all=True, append_images=both[1:])
    assert np.array_equal(read_grey_image(tmp_path / "moving.gif"), GREY)


@pytest.mark.parametrize("read", [read_image, read_grey_image])
def test_values_beyond_16_bits_and_below_0_are_cut_off(read, tmp_path):
    Image.fromarray(np.array([[-7, 0, 257 * 100, 65535, 2**20]], dtype=np.int32)).save(tmp_path / "i.tif")
    assert read(tmp_path / "i.tif").tolist() == [[0, 0, 100, 255, 255]]
    Image.fromarray(np.array([[-0.5, 0.0, 0.4]], dtype=np.float32)).save(tmp_path / "f.tif")
    assert read(tmp_path / "f.tif").tolist() == [[0, 0, 102]]  # of a white that is 1


@pytest.mark.parametrize("read", [read_image, read_grey_image])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_grey_value_that_is_not_finite_is_refused_wherever_it_stands(read, value, tmp_path):
    values = np.zeros((1000, 600), dtype=np.float32)
    values[-1, -1] = value
    Image.fromarray(values).save(tmp_path / "f.tif")
    with pytest.raises(InputError, match="not finite"):
        read(tmp_path / "f.tif")


@pytest.mark.parametrize("read", [read_image, read_grey_image, image_files.image_size])
def test_an_image_of_too_many_pixels_is_refused_by_its_size(read, tmp_path, monkeypatch):
    monkeypatch.setattr(image_files, "MOST_PIXELS", GREY.size - 1)
    Image.fromarray(GREY).save(tmp_path / "large.png")
    with pytest.raises(InputError, match=f"256×40 pixels; at most {GREY.size - 1} are read"):
        read(tmp_path / "large.png")
