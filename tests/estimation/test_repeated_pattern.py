"""Windows of a facade that are taken for their neighbours turn a motion that the facade leaves half free."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.cameras import UnifiedCamera
from omniservo.estimation import estimate_two_view
from omniservo.estimation.matches import Matches
from omniservo.estimation.robust.two_view_fit import fit_two_views, sharper_fit
from omniservo.estimation.status.camera_evidence import foreign_evidence
from omniservo.estimation.uncertainty.two_view_uncertainty import Lens

ERROR = {"sigma_px": 0.46, "length_px": 77.0}
"""what a calibration that says nothing of its own error is taken to have"""
NOISE = 0.035
EXACT = UnifiedCamera(690.0, 690.0, 383.5, 255.5, 0.0, 768, 512)
CAMERA = UnifiedCamera.from_dict({**EXACT.to_dict(), "model_error": ERROR})
TRUE = RigidTransform.from_components(
    [3.0, 0.2, 0.3], Rotation.from_euler("xyz", [2.0, -20.0, 1.0], degrees=True)
)


def lens_of(sigma_px):
    """Return what is said of a camera whose model is off by so much [px]."""
    error = {**ERROR, "sigma_px": sigma_px}
    return Lens(UnifiedCamera.from_dict({**EXACT.to_dict(), "model_error": error}), np.empty((0, 5)))


def facade(seed, wrong, before=18, period=2.0, sides=(-1.0, 1.0)):
    """Pixels of a facade 15 m away, of which ``before`` stand before it and ``wrong`` are a window off."""
    rng = np.random.default_rng(seed)
    points = rng.uniform([-8.0, -5.0, 15.0], [8.0, 5.0, 15.1], (300, 3))
    points[:before, 2] -= rng.uniform(0.5, 3.0, before)
    shown = points.copy()
    shown[before : before + wrong, 0] += period * rng.choice(sides, wrong)
    seen = [CAMERA.project(p)[0] for p in (points, TRUE.inv().apply(shown))]
    both = np.all([CAMERA.in_image(pixels) for pixels in seen], axis=0)
    return [pixels[both] + NOISE * rng.normal(size=(both.sum(), 2)) for pixels in seen]


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(("wrong", "before", "period"), [(16, 18, 2.0), (24, 18, 2.0), (40, 30, 1.0)])
def test_wrong_windows_of_a_facade_do_not_turn_the_motion(seed, wrong, before, period):
    found = estimate_two_view(CAMERA, *facade(seed, wrong, before, period), noise=NOISE)
    assert found.status == "ok", found.message
    turn = (TRUE.rotation.inv() * found.initial_T_goal.rotation).magnitude()
    direction = TRUE.translation / np.linalg.norm(TRUE.translation)
    swing = np.arccos(found.initial_T_goal.translation @ direction)
    assert np.degrees(turn) < 0.05
    assert np.degrees(swing) < 0.15


def matches_and_fits(wrong=24, sides=(-1.0, 1.0)):
    """Matches, their fit within wide gates, the matches and fit within narrow ones."""
    pixels = np.hstack(facade(3, wrong, sides=sides))
    matches = Matches.of_pixels(CAMERA, pixels, np.full((len(pixels), 2), np.hypot(NOISE, 0.46)))
    wide = fit_two_views(matches, 0, True)
    return matches, wide, *sharper_fit(matches, wide, 0, NOISE)


def test_gates_are_narrow_only_where_the_wide_ones_let_wrong_matches_in():
    _, wide, narrow, sharp = matches_and_fits()
    assert narrow.noise_px == pytest.approx(NOISE)
    assert sharp.members.sum() < wide.members.sum()
    matches, wide, same, fit = matches_and_fits(wrong=0)
    assert fit is wide
    assert same is matches


def test_matches_that_do_not_agree_to_the_pixels_noise_keep_wide_gates():
    matches, wide, _, _ = matches_and_fits()
    same, fit = sharper_fit(matches, wide, 0, 0.01 * NOISE)
    assert fit is wide
    assert same is matches


def test_gates_are_wider_where_the_stated_noise_of_pixels_is_too_small():
    matches, wide, _, _ = matches_and_fits()
    narrow, sharp = sharper_fit(matches, wide, 0, 0.2 * NOISE)
    assert narrow.noise_px == pytest.approx(0.4 * NOISE)
    assert sharp.members.sum() < wide.members.sum()


def test_wrong_matches_a_few_pixels_off_are_not_called_badly_found_where_most_agree_to_the_pixels_noise():
    initial, goal = facade(3, 16)
    rng = np.random.default_rng(0)
    off = rng.permutation(len(goal))[: len(goal) // 5]
    goal[off, 1] += rng.choice([-1.0, 1.0], len(off)) * rng.uniform(3.0, 6.0, len(off))
    found = estimate_two_view(CAMERA, initial, goal, noise=NOISE)
    assert found.status == "ok", found.message
    assert not found.inliers[off].any()


def test_wrong_windows_are_no_evidence_of_another_camera_where_most_agree_to_the_pixels_noise():
    _, _, narrow, sharp = matches_and_fits(sides=(1.0,))
    assert 0.05 < np.mean(~sharp.members) < 0.2
    assert foreign_evidence(sharp, narrow, 0.0, lens_of(0.46)) is None
    assert foreign_evidence(sharp, narrow, 0.0, lens_of(0.5 * NOISE)) is not None
    unknown = narrow._replace(noise_px=0.0)  # then nothing says that they agree so well
    assert foreign_evidence(sharp, unknown, 0.0, lens_of(0.1)) is not None
