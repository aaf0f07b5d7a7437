"""The report of an estimate: its first lines, and whether residuals are noise."""

from dataclasses import replace

import numpy as np
import pytest

from omniservo.perception import MatchedPoints
from omniservo.reporting.estimate_report import estimate_html, what_is_left
from omniservo.reporting.residual_agreement import residual_agreement
from omniservo.reporting.spelling import spell


def test_the_banner_says_what_was_found_and_tiles_how_well(run):
    page = estimate_html(run.seen, run.estimate)
    turn = spell(run.estimate.initial_T_goal.rotation.magnitude(), "rad")
    assert f"The camera moved 224 mm and turned {turn}; 9 of 9 matched points agree with that." in page
    for label in ("Left in the images", "Translation known to", "Rotation known to", "Points used"):
        assert f"<dt>{label}</dt>" in page
    assert page.index("Left in the images") < page.index("<table")


def test_without_a_pose_the_banner_has_the_reason_and_there_are_no_tiles(run):
    none = replace(run.estimate, status="no_motion", message="nothing moved", initial_T_goal=None)
    page = estimate_html(run.seen, none)
    assert "No pose: no motion" in page
    assert "nothing moved" in page
    assert 'class="tiles"' not in page


@pytest.mark.parametrize("across_epipolar_lines", [False, True])
def test_noise_agrees_with_its_neighbours_no_more_than_chance(across_epipolar_lines):
    rng = np.random.default_rng(5)
    found, chance = [], 0.0
    for _ in range(200):
        pixels = rng.uniform(0.0, 500.0, size=(60, 2))
        noise = rng.normal(size=(60, 2))
        if across_epipolar_lines:
            noise[:, 0] = 0.0
        most, chance = residual_agreement(pixels, noise)
        found.append(most)
    assert abs(np.mean(found)) < 0.03
    assert np.std(found) < 1.05 * chance


def scattered(run, residuals):
    """The run's estimate with as many points as residuals (n, 4), scattered over the image."""
    n = len(residuals)
    pixels = np.random.default_rng(1).uniform(50.0, 400.0, size=(n, 2))
    seen = replace(run.seen, matched=MatchedPoints(pixels, pixels))
    return seen, replace(run.estimate, inliers=np.ones(n, dtype=bool), residuals_px=residuals)


def test_a_pattern_in_the_residuals_is_told_and_noise_is_called_noise(run):
    noise = np.random.default_rng(2).normal(0.0, 0.1, size=(80, 4))
    assert "looks like noise" in what_is_left(*scattered(run, noise))
    seen, found = scattered(run, noise)
    bent = noise.copy()
    bent[:, :2] += 0.4 * np.sin(seen.matched.initial / 60.0)
    assert "agrees in neighbouring points" in what_is_left(seen, replace(found, residuals_px=bent))


def test_few_points_say_nothing_of_a_pattern(run):
    assert what_is_left(run.seen, run.estimate) == ""
