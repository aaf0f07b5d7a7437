"""The law of a motion before a plane holds what the homography's own region decomposes to."""

import numpy as np
import pytest
from benchmarks.flat_pairs import judged
from benchmarks.pictured_scenes import LENS, WIDE, motion
from scipy.spatial.transform import Rotation

from omniservo import estimate_two_view
from omniservo.cameras import ModelError
from omniservo.estimation.refinement.planar_motion import PlanarMotion
from omniservo.estimation.uncertainty.planar_region import planar_stretches


def flat_pair(seed, tile=20.0):
    """9 to 24 points of a plane seen small by a wide lens, neighbours alike in 0.05 px of their errors."""
    rng, camera = np.random.default_rng([31, seed]), (WIDE, LENS)[seed % 2]
    tilt = Rotation.from_rotvec([*rng.uniform(-0.7, 0.7, 2), rng.uniform(-np.pi, np.pi)])
    count, half = int(rng.integers(9, 25)), rng.uniform(0.1, 0.3, 2)
    flat = np.column_stack([rng.uniform(-1.0, 1.0, (count, 2)) * half, np.zeros(count)])
    points = tilt.apply(flat) + np.array([*rng.uniform(-0.1, 0.1, 2), rng.uniform(0.4, 0.8)])
    goal = motion(rng, length=rng.uniform(0.05, 0.3), turn=rng.uniform(0.1, 0.6))
    (one, seen), (other, too) = camera.project(points), camera.project(goal.inv().apply(points))
    images, noise = (one[seen & too], other[seen & too]), rng.uniform(0.05, 0.3)
    shared = [ModelError(0.05, tile).rows(image) for image in images]
    pixels = [
        image
        + noise * rng.normal(size=image.shape)
        + np.stack([rng.normal(size=len(rows)) @ rows for _ in range(2)], axis=1)
        for image, rows in zip(images, shared, strict=True)
    ]
    return camera, pixels, noise, goal


@pytest.mark.parametrize("seed", [15, 40, 64, 72, 93, 136, 140])
def test_a_plane_that_is_seen_small_is_not_answered_surely_and_wrongly(seed):
    """3 to 26° off; the law of first order says 5 to 48 σ."""
    camera, pixels, noise, goal = flat_pair(seed)
    found = estimate_two_view(camera, *pixels, method="homography", noise=noise)
    assert judged(found, (goal, np.zeros((6, 6)))) == ("ok", False)


def test_a_plane_that_is_seen_large_and_sharp_keeps_its_law_of_first_order():
    rng = np.random.default_rng(1)
    flat = np.column_stack([rng.uniform(-0.4, 0.4, (60, 2)), np.full(60, 0.5)])
    flat[:, 2] += 0.4 * flat[:, 0]
    goal = motion(rng, length=0.25, turn=0.3)
    pixels = [LENS.project(p)[0] + 0.01 * rng.normal(size=(60, 2)) for p in (flat, goal.inv().apply(flat))]
    found = estimate_two_view(LENS, *pixels, method="homography", noise=0.01)
    if found.status == "ok":
        assert len(found.uncertainty.noise) == 8
    else:
        assert found.status == "ambiguous"


def test_the_law_is_stretched_to_another_motion_and_no_farther():
    """pᵀC⁻¹p of the other motion is then the quantile of 95%, χ² of 5."""
    rays = np.array([[x, y, 1.0] for x in (-0.3, 0.0, 0.3) for y in (-0.3, 0.0, 0.3)])
    here = PlanarMotion(np.eye(3), np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 2.0]))
    turn = Rotation.from_rotvec([0.0, 0.02, -0.01])
    aside = np.array([np.cos(0.1), np.sin(0.1), 0.0])
    across = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    other = PlanarMotion(turn.as_matrix(), aside, here.normal)
    rows = planar_stretches(here, [other], rays, across, 1e-8 * np.eye(8), np.inf)
    offset = np.array([0.0, 0.02, -0.01, np.sin(0.1), 0.0])
    law = np.hstack([rows[:, 3:6], rows[:, :3] @ across])
    stretched = 1e-8 * np.eye(5) + law.T @ law
    assert offset @ np.linalg.solve(stretched, offset) == pytest.approx(11.0705, rel=1e-3)
    assert offset @ offset / 1e-8 > 1e5
