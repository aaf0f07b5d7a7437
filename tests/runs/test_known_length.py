"""A known length between two dots, which are numbered as the first image shows them."""

import cv2
import numpy as np
import pytest
from changed_task import shipped, written
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.cameras import preset
from omniservo.errors import InputError
from omniservo.perception import DotKind, find_dots
from omniservo.runs import ImageScale, estimate_many_images
from omniservo.runs.estimate_task import estimate_task
from omniservo.runs.see import see
from omniservo.tasks import load_task

CAMERA = preset("fe185")
FINE = 8
"""places a pixel side of which its grey is the mean"""
RADIUS = 0.009
HIDDEN = ([0.02, -0.11, 0.0], [0.0, 0.0, -1.0])
"""centre and normal of a dot that the first image alone shows: it comes first there"""
VIEWS = (((0, 0), (0, 0, 0.36)), ((0, 25), (0.08, 0.0, 0.36)), ((20, -15), (-0.07, -0.05, 0.33)))
FIRST, SECOND = 1, 3
"""numbers of two dots in the first image"""


def dots():
    """Centres and normals of 3 × 3 dots on two faces that meet at a ridge, off them by 4 mm."""
    i, k = (g.ravel().astype(float) for g in np.meshgrid([-1, 0, 1], [-1, 0, 1]))
    off = 0.004 * np.array([1, -1, -1, -1, 1, -1, 1, 1, -1])
    centres = np.stack([0.06 * i, 0.055 * k, -0.04 * np.abs(i) + off], 1)
    normals = np.stack([-0.04 * i, 0 * i, np.where(i, -0.06, -1.0)], 1)
    return centres, normals / np.linalg.norm(normals, axis=1, keepdims=True)


def camera_T_target(view):
    tilt, place = VIEWS[view]
    return RigidTransform.from_components(place, Rotation.from_rotvec([*np.radians(tilt), 0.0]))


def picture(pose, centres, normals):
    """Dark discs on a bright ground as the camera sees them."""
    image = np.full((FINE * CAMERA.height, FINE * CAMERA.width), 215, np.uint8)
    angle = np.linspace(0.0, 2.0 * np.pi, 200, endpoint=False)[:, None]
    for centre, normal in zip(centres, normals, strict=True):
        x = np.cross([0.0, 1.0, 0.0], normal)
        x /= np.linalg.norm(x)
        rim = centre + RADIUS * (np.cos(angle) * x + np.sin(angle) * np.cross(normal, x))
        outline = FINE * (CAMERA.project(pose.apply(rim))[0] + 0.5) - 0.5
        cv2.fillPoly(image, [np.rint(256.0 * outline).astype(np.int32)], 15, shift=8)
    return cv2.resize(image, (CAMERA.width, CAMERA.height), interpolation=cv2.INTER_AREA)


@pytest.fixture(scope="module")
def images():
    """Three images, and the points of the first one's dots in their order."""
    centres, normals = dots()
    more = np.vstack([HIDDEN[0], centres]), np.vstack([HIDDEN[1], normals])
    pictures = [
        picture(camera_T_target(view), *((centres, normals) if view else more)) for view in range(len(VIEWS))
    ]
    found = find_dots(pictures[0], CAMERA).pixels
    true = CAMERA.project(camera_T_target(0).apply(more[0]))[0]
    order = [int(np.linalg.norm(true - pixel, axis=1).argmin()) for pixel in found]
    assert order[0] == 0
    assert sorted(order) == list(range(10))
    return pictures, more[0][order]


def displacement(view):
    return np.linalg.norm((camera_T_target(0) * camera_T_target(view).inv()).translation)


@pytest.mark.slow
def test_dots_keep_their_numbers_where_another_image_lacks_one(tmp_path, images):
    """They were counted among those that are matched: the camera moved by 44 mm, and not 80."""
    pictures, points = images
    files = [tmp_path / f"{k}.png" for k in range(len(pictures))]
    for file, image in zip(files, pictures, strict=True):
        cv2.imwrite(str(file), image)
    metres = float(np.linalg.norm(points[FIRST] - points[SECOND]))
    found = estimate_many_images(CAMERA, files, scale=ImageScale(length=(FIRST, SECOND, metres))).estimate
    assert found.status == "ok"
    for view in (1, 2):
        length = np.linalg.norm(found.initial_T_views[view].translation)
        assert length == pytest.approx(displacement(view), rel=0.01)
    for number, words in ((0, "the first image shows it, and no other"), (10, "the first image shows 10, ")):
        with pytest.raises(InputError, match=f"length: dot {number} given; {words}"):
            estimate_many_images(CAMERA, files, scale=ImageScale(length=(number, SECOND, metres)))
    with pytest.raises(InputError, match="length: given with features: 'natural'; 'dots' or 'tags'"):
        estimate_many_images(CAMERA, files, features="natural", scale=ImageScale(length=(0, 1, metres)))


@pytest.mark.slow
def test_a_copy_of_an_image_makes_the_estimate_no_surer(tmp_path, images):
    """Every image twice: σ was two thirds of what it is."""
    files = [tmp_path / f"{k}.png" for k in range(6)]
    for k, file in enumerate(files):
        cv2.imwrite(str(file), images[0][k % 3])
    once, twice = (estimate_many_images(CAMERA, some).estimate for some in (files[:3], files))
    np.testing.assert_allclose(twice.covariance[:3], once.covariance)
    statuses = estimate_many_images(CAMERA, files).statuses()
    assert statuses[3:] == [("not_matched", f"a copy of {file}") for file in files[:3]]


def test_a_task_numbers_dots_as_the_initial_image_shows_them(tmp_path, images):
    pictures, points = images
    metres = float(np.linalg.norm(points[FIRST] - points[SECOND]))
    document = shipped("paper-example-1")

    def estimated(*numbers):
        document["scale"] = {"known_length": {"dots": numbers, "length": 1000.0 * metres}}
        task = load_task(str(written(tmp_path, document)))
        return estimate_task(task, None, see(DotKind(), CAMERA, *pictures[:2]), None, None)

    length = np.linalg.norm(estimated(FIRST, SECOND).initial_T_goal.translation)
    assert length == pytest.approx(displacement(1), rel=0.02)
    with pytest.raises(InputError, match="known_length.dots: dot 0 given; the first image shows it, and no"):
        estimated(0, SECOND)
