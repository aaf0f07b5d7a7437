"""Pairs that agree on one motion are told from pairs that chance brings together."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from omniservo.cameras import preset
from omniservo.perception.agreeing_pairs import agree_on_one_plane, agreeing_pairs, share_on_one_plane

CAMERA = preset("fe185")


def pairs(rng, right, wrong, *, flat=False):
    """Pixels (n, 2) of right pairs to a tenth of a pixel, and of wrong ones that belong to no point."""
    points = rng.uniform([-1.2, -1.2, 1.2], [1.2, 1.2, 2.5], (right + 2 * wrong, 3))
    points[:, 2] = 1.8 if flat else points[:, 2]
    turn = Rotation.from_rotvec(rng.normal(0.0, 0.15, 3))
    initial = CAMERA.project(points)[0]
    goal = CAMERA.project(turn.apply(points - rng.normal(0.0, 0.15, 3)))[0]
    goal[right : right + wrong] = goal[right + wrong :]
    initial, goal = initial[: right + wrong], goal[: right + wrong]
    return initial + rng.normal(0.0, 0.1, initial.shape), goal + rng.normal(0.0, 0.1, goal.shape)


@pytest.mark.parametrize(("right", "wrong"), [(50, 0), (50, 15), (60, 40), (100, 20)])
def test_right_pairs_are_found_among_wrong_ones(right, wrong):
    for seed in range(10):
        agree = agreeing_pairs(CAMERA, *pairs(np.random.default_rng(seed), right, wrong))
        assert agree is not None
        assert agree.members[:right].mean() > 0.85
        assert agree.members[right:].sum() <= 0.4 * wrong


@pytest.mark.parametrize("wrong", [8, 45, 80, 150])
def test_wrong_pairs_agree_on_no_motion(wrong):
    for seed in range(25):
        assert agreeing_pairs(CAMERA, *pairs(np.random.default_rng(seed), 0, wrong)) is None


def test_a_few_right_pairs_among_many_wrong_ones_are_not_believed():
    for seed in range(10):
        assert agreeing_pairs(CAMERA, *pairs(np.random.default_rng(seed), 10, 60)) is None


def test_a_plane_agrees_too_and_fewer_than_forty_never_do():
    assert agreeing_pairs(CAMERA, *pairs(np.random.default_rng(0), 50, 5, flat=True)) is not None
    assert agreeing_pairs(CAMERA, *pairs(np.random.default_rng(0), 39, 0)) is None


@pytest.mark.parametrize("share", [0.4, 0.7, 1.0])
def test_the_share_of_pairs_on_one_plane_is_counted(share):
    for seed in range(5):
        flat = pairs(np.random.default_rng(seed), round(60 * share), 0, flat=True)
        deep = pairs(np.random.default_rng(seed + 100), 60 - round(60 * share), 0)
        found = share_on_one_plane(CAMERA, *(np.vstack(both) for both in zip(flat, deep, strict=True)))
        assert share - 0.02 < found < share + 0.15


@pytest.mark.parametrize(("right", "wrong"), [(16, 0), (16, 6), (60, 20)])
def test_most_pairs_of_a_plane_agree_however_few_they_are(right, wrong):
    for seed in range(10):
        assert agree_on_one_plane(CAMERA, *pairs(np.random.default_rng(seed), right, wrong, flat=True))


@pytest.mark.parametrize(("right", "wrong"), [(15, 0), (30, 20), (0, 20), (0, 100)])
def test_a_dozen_pairs_or_half_of_them_wrong_ones_do_not_agree_on_a_plane(right, wrong):
    for seed in range(10):
        assert not agree_on_one_plane(CAMERA, *pairs(np.random.default_rng(seed), right, wrong, flat=True))


def test_wrong_pairs_that_lead_to_one_line_or_one_place_are_no_plane():
    for seed in range(10):
        rng = np.random.default_rng(seed)
        initial, goal = pairs(rng, 0, 40)
        for squeeze in ([0.01, 1.0], [0.01, 0.01]):
            assert not agree_on_one_plane(CAMERA, initial, goal.mean(0) + (goal - goal.mean(0)) * squeeze)
