"""Natural matches between real photographs; the reference pose was measured from a board alone."""

import json
import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from omniservo.cameras import UnifiedCamera
from omniservo.estimation import estimate_two_view


@pytest.fixture(scope="module")
def pairs(shared_data):
    data = json.loads((shared_data / "vinsfusion_calib" / "pairs.json").read_text())
    plain = data["models"]["ba_pure"]
    width, height = data["image_size"]
    camera = UnifiedCamera(*(plain[k] for k in ("fx", "fy", "cx", "cy", "xi")), width, height)
    return camera, data["pairs"]


def errors(estimate, pair):
    truth = pair["gt_models"]["radtan"]
    rotation = Rotation.from_matrix(np.array(truth["R21"]).T)
    translation = -rotation.apply(truth["t21"])
    t = estimate.initial_T_goal.translation
    swing = math.atan2(np.linalg.norm(np.cross(t, translation)), t @ translation)
    return math.degrees((estimate.initial_T_goal.rotation.inv() * rotation).magnitude()), math.degrees(swing)


@pytest.mark.parametrize("index", range(4))
@pytest.mark.parametrize("robust", [True, False])
def test_flagged_matches_give_the_boards_pose_within_a_third_of_a_degree(pairs, index, robust):
    camera, all_pairs = pairs
    pair = all_pairs[index]
    flags = np.array(pair["gt_inlier"], dtype=bool)
    estimate = estimate_two_view(
        camera, np.array(pair["u1"])[flags], np.array(pair["u2"])[flags], robust=robust
    )
    assert estimate.status == "ok"
    turn, swing = errors(estimate, pair)
    assert turn <= 0.3
    assert swing <= 1.5


@pytest.mark.parametrize("index", range(4))
def test_all_matches_give_the_boards_pose_without_being_told_the_wrong_ones(pairs, index):
    camera, all_pairs = pairs
    pair = all_pairs[index]
    estimate = estimate_two_view(camera, pair["u1"], pair["u2"])
    assert estimate.status == "ok"
    turn, swing = errors(estimate, pair)
    assert turn <= 0.5
    assert swing <= 4.0
    wrong = ~np.array(pair["gt_inlier"], dtype=bool)
    assert (estimate.inliers & wrong).sum() <= 3
