"""Tags in raw wide-angle pictures: found, read, located, and never made up."""

import cv2
import numpy as np
import pytest
import tag_scenes
from scipy.ndimage import gaussian_filter, map_coordinates
from scipy.stats import chi2
from tag_scenes import facing, render, true_pixels, whole

from omniservo.cameras import UnifiedCamera
from omniservo.cameras.models import KannalaBrandt
from omniservo.errors import InputError
from omniservo.perception import find_tags, tag_cells, tag_picture
from omniservo.perception.tag_candidates import candidate_planes
from omniservo.perception.tag_kernels import PARAMETERS, POSE, normal_equations
from omniservo.tag_dictionaries import APRIL_TAGS_3, tag_layout

CAMERAS = tag_scenes.cameras()
FISHEYE = CAMERAS["fe185"]
ANGLES = {"fe185": (25, 50, 78), "fisheye": (10, 40, 70), "catadioptric": (45, 65, 88)}


def towards(angle, around):
    a, b = np.deg2rad([angle, around])
    return np.array([np.sin(a) * np.cos(b), np.sin(a) * np.sin(b), np.cos(a)])


def scene(camera, rng, name="tag36h11", angles=(25, 50, 78), side=0.26):
    """Whole tags a metre off, at these angles from the axis, spread round it."""
    tags = []
    for k, angle in enumerate(angles):
        for _ in range(1000):
            around = rng.uniform(0, 360)
            lean, spin = rng.uniform(-0.5, 0.5, 2), rng.uniform(-np.pi, np.pi)
            tag = facing(name, 3 * k + 1, towards(angle, around), 1.0, side, lean=lean, spin=spin)
            clear = all(np.linalg.norm(tag.centre - other.centre) > 2 * side for other in tags)
            if clear and whole(camera, tag):
                tags.append(tag)
                break
    assert len(tags) == len(angles)
    return tags


def errors(camera, tags, found):
    """Distances (k, 4) [px] of the corners of these tags, each of which is found."""
    assert found.ids.tolist() == sorted(tag.number for tag in tags)
    true = {tag.number: true_pixels(camera, tag) for tag in tags}
    return np.linalg.norm(
        found.corners - np.array([true[number] for number in found.ids]).reshape(-1, 4, 2), axis=2
    )


@pytest.mark.slow
@pytest.mark.parametrize("name", CAMERAS)
def test_tags_are_located_to_hundredths_of_a_pixel_out_to_the_rim(name):
    camera = CAMERAS[name]
    for seed in range(2):
        tags = scene(camera, np.random.default_rng(seed), angles=ANGLES[name])
        assert errors(camera, tags, find_tags(render(camera, tags, seed=seed), camera)).max() < 0.08


@pytest.mark.parametrize(
    "name", ["tag16h5", "tag25h9", "tag36h10", "4x4_50", "7x7_1000", "aruco_original", *APRIL_TAGS_3]
)
def test_every_family_is_read_with_its_corners_in_order(name):
    side = 0.26 * tag_cells(name) / 8 if name in APRIL_TAGS_3 else 0.26
    tags = scene(FISHEYE, np.random.default_rng(5), name, side=side)
    assert errors(FISHEYE, tags, find_tags(render(FISHEYE, tags), FISHEYE, name)).max() < 0.08


def test_a_tag_that_looks_the_same_upside_down_is_not_reported():
    camera = UnifiedCamera(400.0, 400.0, 159.5, 119.5, 0.0, 320, 240)
    for number, ids in ((1023, []), (1022, [1022])):
        image = np.full((240, 320), 200, dtype=np.uint8)
        image[60:150, 90:180] = tag_picture("aruco_original", number, pixels_per_cell=10)
        assert find_tags(image, camera, "aruco_original").ids.tolist() == ids


@pytest.mark.slow
def test_cameras_of_other_models_and_narrow_ones_find_tags_too():
    for camera in (
        KannalaBrandt(200.0, 200.0, 319.5, 239.5, 640, 480, k=(0.01, -0.003, 0.0, 0.0)),
        UnifiedCamera(500.0, 500.0, 319.5, 239.5, 0.0, 640, 480),
    ):
        tags = scene(camera, np.random.default_rng(1), angles=(8, 20), side=0.15)
        assert errors(camera, tags, find_tags(render(camera, tags), camera)).max() < 0.08


@pytest.mark.slow
def test_errors_are_as_large_as_their_covariance_says():
    normalised = []
    for seed in range(10):
        rng = np.random.default_rng(seed)
        tags = scene(FISHEYE, rng, angles=(20, 35, 50, 65), side=rng.uniform(0.18, 0.3))
        found = find_tags(render(FISHEYE, tags, blur=rng.uniform(0.5, 1.2), noise=5.0, seed=seed), FISHEYE)
        for tag in tags:
            k = found.ids.tolist().index(tag.number)
            off = found.corners[k] - true_pixels(FISHEYE, tag)
            normalised += np.einsum("ki,kij,kj->k", off, np.linalg.inv(found.covariance[k]), off).tolist()
    # of 160 corners, four and four on one tag: the mean of χ²(2) is 2, its deviation at most 2/√40
    assert abs(np.mean(normalised) - 2.0) < 4 * 2 / np.sqrt(40)
    assert np.mean(np.array(normalised) < chi2.ppf(0.95, 2)) > 0.88


@pytest.mark.slow
@pytest.mark.parametrize("name", ["tag36h11", "tagStandard41h12"])
def test_a_print_that_is_bent_has_corners_as_uncertain_as_they_are_off(name):
    normalised, off, stated = [], [], []
    side = 0.26 if name == "tag36h11" else 0.13
    for seed in range(6):
        rng = np.random.default_rng(seed)
        tags = scene(FISHEYE, rng, name, angles=(20, 35, 50, 65), side=side)
        image = render(FISHEYE, tags, seed=seed).astype(float)
        bend = np.stack([gaussian_filter(rng.standard_normal(image.shape), 8.0) for _ in range(2)])
        bend *= 0.15 / bend.std()
        v, u = np.indices(image.shape)
        image = map_coordinates(image, [v + bend[1], u + bend[0]], order=3, mode="nearest")
        found = find_tags(np.clip(np.rint(image), 0, 255).astype(np.uint8), FISHEYE, name)
        for tag in (tag for tag in tags if tag.number in found.ids):
            k, true = found.ids.tolist().index(tag.number), true_pixels(FISHEYE, tag)
            true = true - np.stack([map_coordinates(b, true.T[::-1], order=1) for b in bend], axis=1)
            error = found.corners[k] - true
            normalised += np.einsum("ki,kij,kj->k", error, np.linalg.inv(found.covariance[k]), error).tolist()
            off.append(np.mean(error**2))
            stated.append(np.trace(found.covariance[k], axis1=1, axis2=2).mean() / 2.0)
    assert len(off) >= 22
    # the noise alone would state 0.012 px of 0.04 to 0.14
    assert 0.6 < np.sqrt(np.mean(stated) / np.mean(off)) < 2.5
    assert np.mean(np.array(normalised) < chi2.ppf(0.95, 2)) > 0.8


def test_corners_are_closer_than_the_librarys_refined_ones():
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    known = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    ours, theirs = [], []
    for seed in range(4):
        tags = scene(FISHEYE, np.random.default_rng(20 + seed), angles=(10, 30, 45))
        image = render(FISHEYE, tags, seed=seed)
        ours += errors(FISHEYE, tags, find_tags(image, FISHEYE)).ravel().tolist()
        corners, ids, _ = cv2.aruco.ArucoDetector(known, parameters).detectMarkers(image)
        for number, square in zip(ids.ravel(), corners, strict=True):
            tag = next(tag for tag in tags if tag.number == number)
            theirs += np.linalg.norm(square[0] - true_pixels(FISHEYE, tag), axis=1).tolist()
    assert np.median(ours) < 0.1 * np.median(theirs)
    assert np.percentile(ours, 95) < 0.2 * np.percentile(theirs, 95)


def test_points_carry_four_ids_for_each_tag():
    tags = scene(FISHEYE, np.random.default_rng(0))
    found = find_tags(render(FISHEYE, tags), FISHEYE)
    assert found.points.ids.tolist() == [4 * tag.number + c for tag in tags for c in range(4)]
    assert np.array_equal(found.points.pixels, found.corners.reshape(-1, 2))


def pictures_without_tags():
    rng = np.random.default_rng(0)
    shape = (FISHEYE.height, FISHEYE.width)
    for deviation, scale in ((0.0, 40.0), (1.0, 400.0), (3.0, 1200.0)):
        noise = rng.standard_normal(shape)
        yield np.clip(128 + scale * gaussian_filter(noise, deviation), 0, 255).astype(np.uint8)
    cells = np.kron(rng.integers(0, 2, (54, 83)), np.full((8, 8), 255))
    yield np.ascontiguousarray(cells[: shape[0], : shape[1]], dtype=np.uint8)
    for grey in (0, 255):
        yield np.full(shape, grey, dtype=np.uint8)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["tag36h11", "4x4_1000"])
def test_noise_has_no_tags_and_a_bounded_number_of_squares_to_read(name):
    for image in pictures_without_tags():
        found = find_tags(image, FISHEYE, name)
        assert len(found) == len(found.repeated) == 0
        assert len(candidate_planes(image, FISHEYE, tag_layout(name), ())) <= 400


def test_clutter_and_tags_of_other_dictionaries_are_not_read():
    for seed in range(2):
        tags = scene(FISHEYE, np.random.default_rng(seed), "4x4_1000")
        # ids that the smaller dictionary does not have
        tags = [tag_scenes.PlacedTag(t.name, 400 + t.number, t.centre, t.axes, t.side) for t in tags]
        image = render(FISHEYE, tags, seed=seed)
        for name in ("4x4_50", "tag16h5", "tag25h9"):
            assert len(find_tags(image, FISHEYE, name)) == 0


def test_a_tag_that_a_border_or_the_rim_cuts_is_none():
    inside = facing("tag36h11", 1, towards(20, 0), 1.0, 0.25)
    rim = facing("tag36h11", 2, towards(90, 180), 1.0, 0.25)
    top = next(
        tag
        for angle in np.arange(60.0, 90.0)
        if not whole(FISHEYE, tag := facing("tag36h11", 3, towards(angle, -90), 1.0, 0.25))
    )
    found = find_tags(render(FISHEYE, [inside, rim, top]), FISHEYE)
    assert 1 in found.ids
    for tag in (rim, top):
        pixels = true_pixels(FISHEYE, tag)
        if not (np.isfinite(pixels).all() and FISHEYE.in_image(pixels).all()):
            assert tag.number not in found.ids


def test_a_tag_that_something_covers_is_not_read():
    tag = facing("tag36h11", 1, towards(20, 0), 1.0, 0.35)
    image = render(FISHEYE, [tag])
    assert len(find_tags(image, FISHEYE)) == 1
    u, v = true_pixels(FISHEYE, tag).mean(axis=0).astype(int)
    image[v : v + 12, u : u + 12] = 60
    assert len(find_tags(image, FISHEYE)) == 0


def test_an_id_at_two_places_is_named_and_left_out():
    places = [towards(20, 0), towards(40, 180), towards(60, 0)]
    tags = [facing("tag36h11", n, p, 1.0, 0.25) for n, p in zip((7, 7, 8), places, strict=True)]
    found = find_tags(render(FISHEYE, tags), FISHEYE)
    assert found.ids.tolist() == [8]
    assert found.repeated.tolist() == [7]


def test_wrong_calls_are_refused():
    with pytest.raises(InputError, match="image: float64"):
        find_tags(np.zeros((432, 659)), FISHEYE)
    with pytest.raises(InputError, match="image: 10×10"):
        find_tags(np.zeros((10, 10), np.uint8), FISHEYE)
    with pytest.raises(InputError, match="dictionary: 'x' given"):
        find_tags(np.zeros((432, 659), np.uint8), FISHEYE, "x")


def test_tiny_pictures_have_no_tags():
    for side in (1, 3, 20):
        camera = UnifiedCamera(5.0, 5.0, 1.0, 1.0, 1.2, side, side)
        assert len(find_tags(np.full((side, side), 90, np.uint8), camera)) == 0


def test_the_fits_derivatives_are_those_of_its_cost():
    rng = np.random.default_rng(3)
    dark = rng.random((6, 6)) < 0.5
    G = np.array([[9.0, 1.5, 0.2], [-1.4, 8.0, -0.1], [0.3, -0.2, 1.0]])
    u, v = np.meshgrid(np.linspace(-0.2, 0.2, 41), np.linspace(-0.2, 0.2, 41))
    rays = np.zeros((u.size, 3, 3))
    rays[:, 0] = np.stack([u.ravel(), v.ravel(), np.ones(u.size)], axis=1)
    rays[:, 1, 0] = rays[:, 2, 1] = 0.01
    others = np.array([np.log(0.9), 200.0, 5.0, -4.0, 150.0, 3.0, 2.0])
    greys = rng.uniform(40, 220, u.size)
    window = np.array([0.0, 1.3])

    def evaluated(step):
        plane = G + np.append(step[:POSE], 0.0).reshape(3, 3) @ G
        matrix, vector = np.zeros((PARAMETERS, PARAMETERS)), np.zeros(PARAMETERS)
        # all pixels count at every step: the window takes in those that the steps move over its border
        count, cost = normal_equations(
            greys, rays, dark, window, (plane, others + step[POSE:]), 1e9, matrix, vector
        )
        return count, count * cost, vector

    _, _, vector = evaluated(np.zeros(PARAMETERS))
    for k in range(PARAMETERS):
        step = np.zeros(PARAMETERS)
        step[k] = 1e-6
        (n_low, low, _), (n_high, high, _) = evaluated(-step), evaluated(step)
        assert n_low == n_high
        slope = -(high - low) / (4e-6)
        assert abs(slope - vector[k]) < 1e-4 * max(abs(slope), 0.05 * np.abs(vector).max())
