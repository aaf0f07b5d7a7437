"""A mask of a distorted camera: its cover on the undistorted image holds what it hides and little more."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from omniservo.cameras import UnifiedCamera
from omniservo.cameras.distorted_mask import distort, mask_on_plane
from omniservo.cameras.image_mask import distance_beyond


def places(camera, polygon):
    """A grid of the plane inside the polygon (k, 2)."""
    low, high = polygon.min(axis=0), polygon.max(axis=0)
    grid = np.stack(np.meshgrid(*np.linspace(low, high, 400).T), axis=-1).reshape(-1, 2)
    lines = ConvexHull(polygon).equations
    return grid[(grid @ lines[:, :2].T + lines[:, 2] < 0).all(axis=1)]


def random_polygon(rng, camera, size):
    centre = rng.uniform(0.1, 0.9, 2) * [camera.width, camera.height]
    points = centre + size * rng.normal(size=(7, 2))
    return points[ConvexHull(points).vertices]


@pytest.mark.parametrize("margin", [0.0, 4.0])
def test_cover_holds_what_the_mask_hides_and_hardly_more(distorted_camera, margin):
    rng = np.random.default_rng(int(distorted_camera.width + margin))
    plain = distorted_camera.to_dict()
    region = distorted_camera.image_limits(margin).polygon
    m = places(distorted_camera, region)
    pixels = distort(distorted_camera, m)
    straight = m @ distorted_camera.matrix[:2, :2].T + distorted_camera.matrix[:2, 2]
    for _ in range(4):
        corners = random_polygon(rng, distorted_camera, 0.06 * distorted_camera.width)
        mask = UnifiedCamera.from_dict(plain | {"mask": [corners.tolist()]}).mask
        beyond = distance_beyond(mask, pixels) - margin
        lines = mask_on_plane(distorted_camera, mask[0], margin, region)
        if lines is None:
            assert (beyond > 0).all()
            continue
        covered = (straight @ lines[:, :2].T < lines[:, 2]).all(axis=1)
        assert covered[beyond < 0].all()
        assert beyond[covered].max(initial=0.0) < 0.04 * distorted_camera.width
        assert len(lines) <= 64


def test_limits_hold_the_covers_of_what_is_seen_alone():
    fields = {"fx": 500.0, "fy": 505.0, "cx": 320.0, "cy": 240.0, "xi": 0.9, "width": 640, "height": 480}
    seen, unseen = [[300, 200], [340, 200], [320, 260]], [[-40, -40], [-10, -40], [-10, -10]]
    camera = UnifiedCamera(**fields, distortion=(-0.1, 0.02, 1e-3, -5e-4), mask=[seen, unseen])
    limits = camera.image_limits(2.0)
    assert len(limits.mask) == 1
    assert np.hypot(*limits.mask[0][:, :2].T) == pytest.approx(1.0)


def test_a_mask_over_everything_leaves_nothing():
    fields = {"fx": 500.0, "fy": 505.0, "cx": 320.0, "cy": 240.0, "xi": 0.9, "width": 640, "height": 480}
    whole = [[-100, -100], [800, -100], [800, 600], [-100, 600]]
    camera = UnifiedCamera(**fields, distortion=(-0.1, 0.02, 1e-3, -5e-4), mask=[whole])
    limits = camera.image_limits()
    m = places(camera, limits.polygon)
    straight = m @ camera.matrix[:2, :2].T + camera.matrix[:2, 2]
    lines = limits.mask[0]
    assert (straight @ lines[:, :2].T < lines[:, 2]).all()


def test_the_limits_of_a_distorted_camera_hold_its_masks_grown_by_the_margin():
    corners = [[100.0, 100.0], [140.0, 100.0], [140.0, 150.0], [100.0, 150.0]]
    camera = UnifiedCamera(
        300.0, 300.0, 320.0, 240.0, 1.0, 640, 480, distortion=(-0.05, 0.01, 1e-3, 0.0), mask=[corners]
    )
    for margin in (0.0, 12.0):
        limits = camera.image_limits(margin)
        (held,) = limits.mask
        assert np.array_equal(held, mask_on_plane(camera, camera.mask[0], margin, limits.polygon))
        # what is nearer to the mask than the margin lies within all lines of its cover
        rays, valid = camera.unproject([[120.0, 149.9 + margin], [120.0, 125.0]])
        straight = rays[:, :2] / (rays[:, 2:] + camera.xi) @ camera.matrix[:2, :2].T + camera.matrix[:2, 2]
        assert valid.all()
        assert (straight @ held[:, :2].T < held[:, 2]).all()
