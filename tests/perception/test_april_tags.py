"""The AprilTag 3 families: codes and prints are those of AprilRobotics' library, and are read."""

import numpy as np
import pytest
import tag_scenes
from benchmarks.april_tag_codes import family_of, library
from tag_scenes import facing, render, true_pixels

from omniservo.cameras import UnifiedCamera
from omniservo.errors import InputError
from omniservo.perception import TagTracker, find_tags, tag_cells, tag_picture, tag_picture_corners
from omniservo.tag_dictionaries import APRIL_TAGS_3, dark_cells, dictionary, dictionary_size, tag_layout

FISHEYE = tag_scenes.cameras()["fe185"]
# as published: tags, bits, cells of the square and of the print, first and last code
PUBLISHED = {
    "tagCircle21h7": (38, 21, 5, 9, 0x157863, 0x1EC1E3),
    "tagCircle49h12": (65535, 49, 5, 11, 0xC6C921D8614A, 0x1E520C2997B43),
    "tagCustom48h12": (42211, 48, 6, 10, 0xD6C8AE76DFF0, 0x18BCCAC8B0F5),
    "tagStandard41h12": (2115, 41, 5, 9, 0x1BD8A64AD10, 0x1EE40155A64),
    "tagStandard52h13": (48714, 52, 6, 10, 0x4064A19651FF1, 0xCDC7A163ACC66),
}


@pytest.mark.parametrize("name", APRIL_TAGS_3)
def test_a_family_has_as_many_tags_bits_and_cells_as_published(name):
    tags, bits, border, cells, first, last = PUBLISHED[name]
    layout = tag_layout(name)
    assert dictionary_size(name) == tags
    assert (layout.code.sum(), layout.border, layout.cells) == (bits, border, cells)
    bright = ~dark_cells(name, np.array([0, tags - 1]))[:, layout.code]
    assert bright.sum(axis=1).tolist() == [first.bit_count(), last.bit_count()]


def test_the_first_prints_are_those_that_are_published():
    rows = "..#....## ######### .#.....## ##.....#. ##.##..## ##.#.#.#. .#.....## ######### ..#.##.##"
    dark = dark_cells("tagStandard41h12", np.array([0]))[0]
    assert ["".join(".#"[cell] for cell in row) for row in dark.astype(int)] == rows.split()
    # the corners of round tags are not printed
    rows = "....#.... .#######. .#.....#. ##.#...## ##.....#. .#.#.#.#. .#.....#. .#######. ...###..."
    dark = dark_cells("tagCircle21h7", np.array([0]))[0]
    assert ["".join(".#"[cell] for cell in row) for row in dark.astype(int)] == rows.split()


@pytest.mark.parametrize("name", APRIL_TAGS_3)
def test_a_familys_codes_differ_in_as_many_bits_as_its_name_says_however_turned(name):
    numbers = np.random.default_rng(0).choice(dictionary_size(name), 30, replace=False)
    code = tag_layout(name).code
    dark = dark_cells(name, np.arange(dictionary_size(name)))
    bits = np.packbits(dark[:, code], axis=1)
    for number in numbers:
        for turn in range(4):
            turned = np.packbits(np.rot90(dark[number], turn)[code])
            differ = np.bitwise_count(bits ^ turned).sum(axis=1, dtype=int)
            differ[number] = 99 if turn == 0 else differ[number]
            assert differ.min() >= int(name.rpartition("h")[2])


def test_every_code_and_its_cells_are_the_librarys():
    known = library()
    if known is None:
        pytest.skip("pyapriltags is not installed")
    for name in APRIL_TAGS_3:
        family = family_of(known, name)
        dark = dark_cells(name, np.arange(len(family.codes)))
        x, y = family.places.T + (family.cells - family.border) // 2
        bits = np.array(family.codes)[:, None] >> np.arange(family.bits)[::-1] & 1
        assert np.array_equal(dark[:, y, x], bits == 0)


@pytest.mark.parametrize("name", APRIL_TAGS_3)
def test_the_library_finds_our_prints_with_the_same_number_and_corners(name):
    peer = pytest.importorskip("pyapriltags")
    if dictionary_size(name) > 5000:
        pytest.skip("its tables for large families take gigabytes")
    picture = np.pad(tag_picture(name, 7, pixels_per_cell=10), 30, constant_values=255)
    (found,) = peer.Detector(families=name, quad_decimate=1.0).detect(picture)
    assert found.tag_id == 7
    # from the bottom left one counter-clockwise, and half a pixel on, as it counts them
    corners = tag_picture_corners(name, pixels_per_cell=10) + 30.0
    assert np.abs(found.corners[::-1] - 0.5 - corners).max() < 0.5


@pytest.mark.parametrize("name", ["tagCircle21h7", "tagCustom48h12"])
def test_what_lies_where_nothing_is_printed_does_not_matter(name):
    side, size = tag_cells(name) * 10, tag_layout(name).cells * 10
    camera = UnifiedCamera(300.0, 300.0, 159.5, 159.5, 0.0, 320, 320)
    picture = tag_picture(name, 3, pixels_per_cell=10)
    empty = np.kron(~tag_layout(name).printed, np.ones((10, 10))) > 0
    for grey in (0, 90):
        image = np.full((320, 320), 200, dtype=np.uint8)
        image[60 : 60 + size, 60 : 60 + size] = np.where(empty, grey, picture)
        found = find_tags(image, camera, name)
        assert found.ids.tolist() == [3]
        assert np.abs(found.corners[0] - 60.0 - tag_picture_corners(name, pixels_per_cell=10)).max() < 0.05
        assert np.ptp(found.corners[0], axis=0) == pytest.approx([side, side], abs=0.1)


def test_a_tracker_follows_tags_of_these_families():
    tag = facing("tagStandard41h12", 5, np.array([0.5, 0.2, 1.0]), 1.0, 0.16)
    tracker = TagTracker(FISHEYE, "tagstandard41h12", [5])
    true = true_pixels(FISHEYE, tag)
    pixels, valid = tracker.update(render(FISHEYE, [tag]), true + 3.0)
    assert valid.all()
    assert np.linalg.norm(pixels - true, axis=1).max() < 0.08


def test_a_covered_cell_outside_of_the_square_loses_the_tag():
    tag = facing("tagStandard41h12", 5, np.array([0.5, 0.2, 1.0]), 1.0, 0.2)
    image = render(FISHEYE, [tag])
    assert find_tags(image, FISHEYE, tag.name).ids.tolist() == [5]
    bright = np.argwhere(~tag.pattern()[0])[0, 0]
    place = (2.0 * np.array([bright, 0]) + 1.0 - 9.0) / 5.0
    (pixel,), _ = FISHEYE.project(tag.centre + 0.5 * tag.side * place @ tag.axes[:, :2].T[None])
    u, v = np.rint(pixel).astype(int)
    image[v - 3 : v + 4, u - 3 : u + 4] = 25
    assert len(find_tags(image, FISHEYE, tag.name)) == 0


def test_boards_refuse_these_families_by_name():
    with pytest.raises(InputError, match="'tagStandard41h12' given, which no board has; legal: 4x4_100"):
        dictionary("tagStandard41h12")
