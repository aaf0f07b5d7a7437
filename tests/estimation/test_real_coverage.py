"""Real pairs with the pose from a board: covariances hold the truth; flat boards are never sure and wrong."""

import itertools

import pytest
from benchmarks.flat_pairs import SURE, WRONG_DEG
from benchmarks.real_coverage import RealSet, estimates, score
from scipy.stats import chi2

from omniservo import estimate_two_view


@pytest.fixture(scope="module")
def fisheye(shared_data):
    data = RealSet.read("fisheye2")
    return data, data.calibrated()


@pytest.mark.slow
def test_real_pairs_are_answered_and_their_covariance_holds_the_truth(fisheye):
    found = [(e, t) for _, _, e, t in estimates(*fisheye, "given", "calibration")]
    scores = [score(e, t) for e, t in found if e.status == "ok"]
    assert len(scores) >= 9
    assert sum(s.square <= chi2.ppf(0.95, 5) for s in scores) >= 7
    assert max(s.rotation_deg for s in scores) <= 1.0


@pytest.mark.parametrize("noise", [None, 0.003])
def test_a_flat_board_is_no_scene_whatever_its_noise_is_stated_to_be(fisheye, noise):
    data, calibration = fisheye
    for one, other in itertools.combinations(list(data.corners)[::2], 2):
        found = estimate_two_view(calibration.camera, data.corners[one], data.corners[other], noise=noise)
        assert found.status in ("planar_points", "ambiguous")


@pytest.mark.slow
def test_a_flat_board_answered_as_a_plane_is_never_sure_and_wrong(fisheye):
    data, calibration = fisheye
    answered = 0
    for one, other in itertools.combinations(list(data.corners)[::2], 2):
        found = estimate_two_view(
            calibration.camera, data.corners[one], data.corners[other], noise=0.003, method="homography",
            calibration_covariance=calibration.covariance,
        )  # fmt: skip
        if found.status == "ok":
            answered += 1
            s = score(found, data.truth(one, other))
            assert max(s.rotation_deg, s.direction_deg) <= WRONG_DEG or s.square <= SURE**2
    assert answered > 10
