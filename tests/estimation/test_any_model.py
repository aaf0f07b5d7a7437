"""Estimates rest on the bearings of a camera's own model, whatever model that is.

Each of them is made of pixels that the lens's own model gives, and of one that is so far from any unified
camera that its nearest one would miss the truth.
"""

import numpy as np
import pytest
from benchmarks.lens_conversions import PUBLISHED
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo import KnownPoints, estimate_known_target, estimate_pose, estimate_two_view, estimate_views
from omniservo.cameras.conversion import to_unified
from omniservo.cameras.models import camera_from_dict
from omniservo.errors import InputError
from omniservo.estimation import TwoViewEstimate, refine_pose

NAMES = tuple(PUBLISHED)
WIDE = {"RealSense T265, fisheye", "TUM VI at 1024 px", "Kodak, OCam, 235°"}
GOAL = RigidTransform.from_components([0.12, -0.06, 0.08], Rotation.from_rotvec([0.1, -0.2, 0.15]))
NOISE = 0.1
LENGTH = float(np.linalg.norm(GOAL.translation))


class Seen:
    """Points all over a lens's image, seen from the identity and from GOAL, and where in either image."""

    def __init__(self, name, seed=0, n=60):
        rng, self.lens = np.random.default_rng(seed), PUBLISHED[name]
        edge = np.array([self.lens.width, self.lens.height])
        points = np.empty((0, 3))
        while len(points) < n:
            pixels = rng.uniform(0.0, 1.0, (400, 2)) * edge
            bearings, valid = self.lens.unproject(pixels)
            valid &= bearings[:, 2] > -0.5
            drawn = bearings[valid] * rng.uniform(0.4, 0.9, (int(valid.sum()), 1))
            again, also = self.lens.project(GOAL.inv().apply(drawn))
            also &= self.lens.in_image(np.where(also[:, None], again, -1e3))
            points = np.concatenate([points, drawn[also]])[:n]
        self.points = points
        self.initial = self.lens.project(points)[0]
        self.goal = self.lens.project(GOAL.inv().apply(points))[0]
        self.noisy = [p + NOISE * rng.standard_normal(p.shape) for p in (self.initial, self.goal)]


def off(found: RigidTransform) -> np.ndarray:
    """Return (6,) by which a goal pose is off: [m], and [rad] on the right."""
    turn = (GOAL.rotation.inv() * found.rotation).as_rotvec()
    return np.concatenate([found.translation - GOAL.translation, turn])


@pytest.mark.parametrize("name", NAMES)
def test_exact_pixels_of_any_model_give_the_exact_motion(name):
    seen = Seen(name)
    found = estimate_two_view(seen.lens, seen.initial, seen.goal, scale=LENGTH)
    assert found.status == "ok"
    assert np.abs(off(found.initial_T_goal)).max() < 1e-6
    assert np.abs(found.points - seen.points).max() < 1e-5


@pytest.mark.parametrize("name", sorted(WIDE))
def test_the_nearest_unified_camera_would_have_missed_it(name):
    """So the tests above see whose bearings are used."""
    lens = PUBLISHED[name]
    if to_unified(lens).residual.largest_px < 1.0:
        pytest.skip("the conversion leaves next to nothing")
    seen = Seen(name)
    found = estimate_two_view(to_unified(lens).camera, seen.initial, seen.goal, scale=LENGTH)
    assert found.initial_T_goal is None or np.abs(off(found.initial_T_goal)).max() > 1e-4


@pytest.mark.parametrize("name", NAMES)
def test_noisy_estimates_err_as_they_state(name):
    squares = []
    for seed in range(16):
        seen = Seen(name, seed)
        found = estimate_two_view(seen.lens, *seen.noisy, scale=LENGTH, noise=NOISE)
        assert found.noise_px == pytest.approx(NOISE, rel=0.35)
        turn = off(found.initial_T_goal)[3:]
        squares.append(turn @ np.linalg.solve(found.covariance[3:, 3:], turn) / 3.0)
        pose = estimate_pose(seen.lens, seen.points, seen.noisy[1], noise=NOISE)
        error = off(pose.reference_T_camera)
        squares.append(error @ np.linalg.solve(pose.covariance, error) / 6.0)
    assert 0.6 < np.mean(squares) < 1.5


@pytest.mark.parametrize("name", NAMES)
def test_a_pose_by_known_points_is_exact(name):
    seen = Seen(name)
    exact = estimate_pose(seen.lens, seen.points, seen.goal)
    assert np.abs(off(exact.reference_T_camera)).max() < 1e-8
    near = GOAL * RigidTransform.from_components([1e-3, 0.0, 0.0], Rotation.from_rotvec([0.0, 1e-3, 0.0]))
    refined = refine_pose(seen.lens, seen.points, seen.goal, near)
    assert np.abs(off(refined.reference_T_camera)).max() < 1e-8


@pytest.mark.parametrize("name", NAMES)
def test_a_known_target_and_several_views_are_exact(name):
    seen = Seen(name, n=24)
    known = estimate_known_target(seen.lens, seen.points, seen.initial, seen.goal)
    assert np.abs(off(known.initial_T_goal)).max() < 1e-7
    first = KnownPoints(np.arange(5), seen.points[:5])
    several = estimate_views(seen.lens, np.stack([seen.initial, seen.goal]), scale=first)
    assert np.abs(off(several.initial_T_views[1])).max() < 1e-6


def test_an_estimate_keeps_its_camera_in_its_file_and_is_sampled_with_it(tmp_path):
    seen = Seen("RealSense T265, fisheye", n=20)
    stated = {"sigma_px": 0.1, "length_px": 80.0}
    lens = camera_from_dict({**seen.lens.to_dict(), "model_error": stated})
    found = estimate_known_target(lens, seen.points, *seen.noisy, noise=NOISE)
    assert np.trace(found.covariance[:3, :3]) > 1.5 * np.trace(
        estimate_known_target(seen.lens, seen.points, *seen.noisy, noise=NOISE).covariance[:3, :3]
    )
    found = estimate_two_view(lens, *seen.noisy, scale=LENGTH, noise=NOISE)
    vars(found)["camera"] = lens
    found.save(tmp_path / "estimate.json")
    loaded = TwoViewEstimate.load(tmp_path / "estimate.json")
    assert loaded.camera == lens
    drawn = loaded.sample(np.random.default_rng(0), 4000, camera=loaded.camera)
    turns = (found.initial_T_goal.rotation.inv() * drawn.initial_T_goal.rotation).as_rotvec()
    assert turns.std(axis=0) == pytest.approx(np.sqrt(np.diag(found.covariance)[3:]), rel=0.25)


def test_pixels_without_a_bearing_and_parameters_of_another_model_are_refused_by_name():
    seen = Seen("TUM VI at 1024 px", n=12)
    lens = camera_from_dict({**seen.lens.to_dict(), "max_angle": 1.0})
    rim = np.where(np.arange(12)[:, None] == 3, [5.0, 6.0], seen.initial * 0.0 + 512.0)
    with pytest.raises(InputError, match=r"pixels_initial: \(5, 6\) at index 3 is outside .* 57.3° from"):
        estimate_two_view(lens, rim, rim, robust=False)
    with pytest.raises(InputError, match=r"pixels: \(5, 6\) at index 3 is outside"):
        estimate_pose(lens, seen.points, rim, robust=False)
    with pytest.raises(InputError, match="calibration_covariance: given with a KannalaBrandt"):
        estimate_two_view(seen.lens, seen.initial, seen.goal, calibration_covariance=np.eye(5))
