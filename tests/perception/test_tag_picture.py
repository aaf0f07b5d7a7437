"""Pictures of tags, the dictionaries' names, and points with their errors."""

import cv2
import numpy as np
import pytest

from omniservo.errors import InputError
from omniservo.perception import ImagePoints, tag_cells, tag_picture, tag_picture_corners
from omniservo.tag_dictionaries import (
    APRIL_TAGS_3,
    dictionary_name,
    dictionary_names,
    dictionary_size,
    opencv_name,
)


@pytest.mark.parametrize("name", ["tag16h5", "tag25h9", "tag36h10", "tag36h11", "4x4_50", "7x7_1000"])
def test_opencv_reads_every_picture_and_agrees_on_its_corners(name):
    number = dictionary_size(name) - 1
    picture = cv2.copyMakeBorder(tag_picture(name, number), 20, 20, 20, 20, cv2.BORDER_CONSTANT, value=255)
    known = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, opencv_name(name)))
    corners, ids, _ = cv2.aruco.ArucoDetector(known).detectMarkers(picture)
    assert ids.ravel().tolist() == [number]
    # the reader gives the outermost dark pixels' centres
    assert np.abs(corners[0][0] - 20 - tag_picture_corners(name)).max() <= 0.51


def test_the_border_is_white_and_the_tags_rim_black():
    picture = tag_picture("tag36h11", 7, pixels_per_cell=3)
    assert picture.shape == (30, 30)
    assert tag_cells("tag36h11") == 8
    assert (picture[:3] == 255).all()
    assert (picture[3:6, 3:27] == 0).all()
    assert set(np.unique(picture)) == {0, 255}


def test_dictionaries_have_short_names_and_opencvs():
    assert {"tag16h5", "tag25h9", "tag36h10", "tag36h11", "4x4_50", "aruco_original"} <= set(
        dictionary_names()
    )
    assert len(set(dictionary_names())) == len(dictionary_names())
    for name in set(dictionary_names()) - set(APRIL_TAGS_3):
        assert opencv_name(opencv_name(name)) == opencv_name(name)
        assert dictionary_name(opencv_name(name)) == name
    with pytest.raises(InputError, match="dictionary: 'tag99' given; legal: 4x4_100"):
        opencv_name("tag99")


def test_wrong_tags_are_refused():
    with pytest.raises(InputError, match="tag_id: 30 given; legal: >= 0 and <= 29"):
        tag_picture("tag16h5", 30)
    with pytest.raises(InputError, match="tag_id"):
        tag_picture("tag16h5", 1.5)
    with pytest.raises(InputError, match="pixels_per_cell"):
        tag_picture("tag16h5", 0, pixels_per_cell=0)


def test_points_keep_what_they_are_given():
    pixels, covariance, ids = np.array([[1.0, 2.0]]), np.eye(2)[None], np.array([7])
    points = ImagePoints(pixels, covariance, ids)
    assert len(points) == 1
    pixels[:], covariance[:], ids[:] = 0.0, 0.0, 0
    assert points.pixels.tolist() == [[1.0, 2.0]]
    assert points.ids.tolist() == [7]
    np.testing.assert_array_equal(points.covariance, np.eye(2)[None])


def test_points_that_are_none_are_refused():
    two = np.zeros((2, 2))
    with pytest.raises(InputError, match="pixels"):
        ImagePoints(np.array([[np.nan, 0.0]]), np.eye(2)[None])
    with pytest.raises(InputError, match="covariance: shape"):
        ImagePoints(two, np.eye(2)[None])
    with pytest.raises(InputError, match="index 1; symmetric"):
        ImagePoints(two, np.stack([np.eye(2), -np.eye(2)]))
    with pytest.raises(InputError, match="ids: 3 stands twice"):
        ImagePoints(two, np.stack([np.eye(2)] * 2), [3, 3])
    with pytest.raises(InputError, match="ids"):
        ImagePoints(two, np.stack([np.eye(2)] * 2), [0.5, 1.0])


@pytest.mark.parametrize("scale", [0, -3, 2.5, np.nan, 1001])
def test_corners_are_those_of_a_picture_that_there_is(scale):
    for made in (lambda: tag_picture("tag36h11", 7, pixels_per_cell=scale),
                 lambda: tag_picture_corners("tag36h11", pixels_per_cell=scale)):  # fmt: skip
        with pytest.raises(InputError, match="pixels_per_cell"):
            made()
