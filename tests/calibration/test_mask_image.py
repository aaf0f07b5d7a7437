"""Mask images: every hidden pixel is covered, little else is, and what cannot be covered is refused."""

import struct
import zlib

import numpy as np
import pytest
from PIL import Image

from omniservo.camera_files.mask_image import load_mask
from omniservo.cameras import UnifiedCamera
from omniservo.cameras.image_mask import mask_from
from omniservo.errors import InputError

WIDTH, HEIGHT = 320, 240
V, U = np.mgrid[:HEIGHT, :WIDTH]
RADIUS = np.hypot(U - 158.0, V - 121.5)

MASKS = {
    "outside a circle": (RADIUS > 115.0, 0.012),
    "outside a large circle": (RADIUS > 150.0, 0.006),
    "outside a circle, and its middle": ((RADIUS > 115.0) | (RADIUS < 30.0), 0.015),
    "a disc": (RADIUS < 70.0, 0.004),
    "an arm from below": ((V > 200) | ((abs(U - 140) < 18) & (V > 120)), 0.002),
    "an L": (((U < 40) & (V < 200)) | ((U < 200) & (V < 30)), 0.001),
    "two blobs": ((np.hypot(U - 60, V - 60) < 25) | (np.hypot(U - 250, V - 180) < 40), 0.004),
    "a diagonal line": (abs(U - V) < 1, 0.004),
    "a pixel": ((U == 5) & (V == 7), 0.0),
    "a corner pixel": ((U == 0) & (V == 0), 0.0),
    "a column": (U == WIDTH - 1, 0.0),
}


def saved(tmp_path, hidden, name="mask.png"):
    Image.fromarray(np.where(hidden, 0, 255).astype(np.uint8)).save(tmp_path / name)
    return tmp_path / name


@pytest.mark.parametrize("mask", MASKS)
def test_every_hidden_pixel_is_covered_and_little_else(tmp_path, mask):
    hidden, allowed = MASKS[mask]
    cover = load_mask(saved(tmp_path, hidden), (WIDTH, HEIGHT))
    assert mask_from(cover.polygons) == cover.polygons
    camera = UnifiedCamera(150.0, 150.0, 160.0, 120.0, 1.2, WIDTH, HEIGHT, mask=cover.polygons)
    for shift in ((0, 0), (-0.499, -0.499), (0.499, 0.2), (0.1, 0.499)):
        inside = camera.in_image(np.stack([U + shift[0], V + shift[1]], axis=-1))
        assert not inside[hidden].any()
    lost = ~camera.in_image(np.stack([U, V], axis=-1)) & ~hidden
    assert (cover.hidden_pixels, cover.lost_pixels) == (hidden.sum(), lost.sum())
    assert lost.sum() <= allowed * (~hidden).sum()
    distances = [np.hypot(U[hidden] - u, V[hidden] - v).min() for v, u in np.argwhere(lost)]
    assert cover.overhang_px == pytest.approx(max(distances, default=0.0), abs=0.01)


@pytest.mark.parametrize(
    "kind", ["grey.png", "black and white.png", "16 bit.png", "colour.png", "m.pgm", "m.bmp", "m.tiff"]
)
def test_black_is_hidden_in_every_kind_of_image(tmp_path, kind):
    hidden = (U > 250) & (V > 100)
    grey = np.where(hidden, 0, 1).astype(np.uint8)  # 1 is as visible as 255
    images = {
        "black and white.png": Image.fromarray(grey * 255).convert("1"),
        "16 bit.png": Image.fromarray(np.where(hidden, 0, 256).astype(np.uint16)),
        "colour.png": Image.fromarray(np.stack([grey * 0, grey, grey * 0], axis=-1)),
    }
    images.get(kind, Image.fromarray(grey)).save(tmp_path / kind)
    cover = load_mask(tmp_path / kind, (WIDTH, HEIGHT))
    assert (cover.hidden_pixels, cover.lost_pixels, len(cover.polygons)) == (hidden.sum(), 0, 1)


def test_nothing_hidden_is_no_polygon(tmp_path):
    assert load_mask(saved(tmp_path, RADIUS < 0), (WIDTH, HEIGHT)).polygons == ()


@pytest.mark.parametrize(
    ("hidden", "size", "message"),
    [
        (RADIUS >= 0, (WIDTH, HEIGHT), "every pixel is hidden"),
        ((U + V)[:40, :50] % 2 == 0, (50, 40), r"64 convex polygons .* would hide \d+\.\d% of the visible"),
        (U > 100, (HEIGHT, WIDTH), "320x240 pixels; the camera's image has 240x320"),
    ],
)
def test_what_cannot_be_a_mask_is_refused_with_the_reason(tmp_path, hidden, size, message):
    with pytest.raises(InputError, match=rf"mask\.png: {message}"):
        load_mask(saved(tmp_path, hidden), size)


def test_broken_hostile_and_lossy_images_are_refused(tmp_path):
    size = (WIDTH, HEIGHT)
    good = saved(tmp_path, U > 100).read_bytes()
    broken = tmp_path / "broken.png"
    for data in (b"", b"hello", good[:60], good[: len(good) // 2], good[:40] + b"\xff" * 20 + good[60:]):
        broken.write_bytes(data)
        with pytest.raises(InputError, match=r"broken\.png: not an image that is read"):
            load_mask(broken, size)
    saved(tmp_path, U > 100, "mask.jpg")
    with pytest.raises(InputError, match="JPEG blurs"):
        load_mask(tmp_path / "mask.jpg", size)
    head = struct.pack(">IIBBBBB", 60000, 60000, 1, 0, 0, 0, 0)  # 450 MB of nothing
    chunk = b"IHDR" + head
    bomb = good[:8] + struct.pack(">I", 13) + chunk + struct.pack(">I", zlib.crc32(chunk)) + good[33:]
    broken.write_bytes(bomb)
    with pytest.raises(InputError, match=r"broken\.png: "):
        load_mask(broken, (60000, 60000))
    broken.write_bytes(b"\x89PNG" + b"\0" * 2**24)
    with pytest.raises(InputError, match="bytes; at most"):
        load_mask(broken, size)
    Image.fromarray(np.zeros((HEIGHT, WIDTH, 4), dtype=np.uint8)).save(broken)
    with pytest.raises(InputError, match="mode RGBA given; legal: grey"):
        load_mask(broken, size)
