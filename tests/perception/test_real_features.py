"""Our own features of real photographs, their camera calibrated here; the reference pose is a board's."""

import numpy as np
import pytest

from benchmarks import real_pairs
from omniservo.estimation import estimate_two_view
from omniservo.files.image_files import read_grey_image
from omniservo.perception import find_features, match_features, refine_matches


@pytest.fixture(scope="module")
def camera(shared_data):
    return real_pairs.own_camera(step=4)


@pytest.fixture(scope="module")
def found(camera):
    names = sorted({pair[k] for pair in real_pairs.read_pairs() for k in ("image1", "image2")})
    images = {name: read_grey_image(real_pairs.FOLDER / name) for name in names}
    return {name: (image, find_features(image, camera)) for name, image in images.items()}


@pytest.mark.slow
@pytest.mark.parametrize("index", range(4))
def test_our_own_features_give_the_boards_pose(camera, found, index):
    pair = real_pairs.read_pairs()[index]
    (initial, a), (goal, b) = found[pair["image1"]], found[pair["image2"]]
    match = refine_matches(camera, initial, goal, a, b, match_features(a, b))
    assert match.status == "ok"
    assert len(match) > 200
    estimate = estimate_two_view(camera, match.initial.pixels, match.goal.pixels)
    assert estimate.status == "ok"
    assert estimate.inliers.mean() > 0.85
    assert estimate.rms_px < 0.15
    turn, swing = real_pairs.errors_deg(estimate, pair)
    assert turn <= 0.4
    assert swing <= 4.0


@pytest.mark.slow
@pytest.mark.parametrize("index", range(4))
def test_with_the_noise_and_windows_that_they_state_they_are_not_taken_for_another_cameras(
    camera, found, index
):
    pair = real_pairs.read_pairs()[index]
    (initial, a), (goal, b) = found[pair["image1"]], found[pair["image2"]]
    match = refine_matches(camera, initial, goal, a, b, match_features(a, b))
    variances = [np.trace(p.covariance, axis1=1, axis2=2) / 2.0 for p in (match.initial, match.goal)]
    noise = np.sqrt(np.stack(variances, axis=1))
    pixels = match.initial.pixels, match.goal.pixels
    estimate = estimate_two_view(camera, *pixels, noise=noise, windows=match.window)
    assert estimate.status == "ok", estimate.message
    turn, swing = real_pairs.errors_deg(estimate, pair)
    assert turn <= 0.4
    assert swing <= 4.0


@pytest.mark.parametrize("index", range(4))
def test_all_given_matches_give_the_boards_pose(camera, index):
    pair = real_pairs.read_pairs()[index]
    wide = real_pairs.without_largest_angle(camera)
    estimate = estimate_two_view(wide, pair["u1"], pair["u2"])
    assert estimate.status == "ok"
    turn, swing = real_pairs.errors_deg(estimate, pair)
    assert turn <= 0.4
    assert swing <= 4.0
