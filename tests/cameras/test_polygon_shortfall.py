"""How much the polygon leaves out, against its area on the plane and counted by hand."""

import numpy as np
import pytest

from omniservo.cameras import UnifiedCamera
from omniservo.cameras.polygon_shortfall import polygon_shortfall


def test_a_camera_without_distortion_loses_nothing():
    assert polygon_shortfall(UnifiedCamera(300.0, 300.0, 320.0, 240.0, 1.2, 640, 480)) == 0.0


@pytest.mark.parametrize("margin", [0.0, 8.0])
def test_the_shortfall_is_the_share_of_random_pixels_that_the_limits_refuse(margin):
    camera = UnifiedCamera(
        420.0, 420.0, 320.0, 240.0, 0.0, 640, 480, distortion=(0.2, 0.05, 1e-3, -5e-4), max_angle=0.8
    )
    limits = camera.image_limits(margin)
    high = np.array([camera.width, camera.height]) - 0.5 - margin
    pixels = np.random.default_rng(4).uniform(margin - 0.5, high, (60_000, 2))
    rays, valid = camera.unproject(pixels)
    for angle in np.linspace(0, 6, 7) if margin else ():
        valid &= camera.unproject(pixels + margin * np.array([np.cos(angle), np.sin(angle)]))[1]
    refused = [not (limits.normals @ ray <= limits.kappas).all() for ray in rays[valid]]
    assert polygon_shortfall(camera, margin) == pytest.approx(np.mean(refused), abs=0.01)
    assert 0.0 < polygon_shortfall(camera, margin) < 0.1


def test_a_region_that_is_not_convex_on_the_plane_loses_more():
    """Barrel distortion bends the border outward on the plane between the corners: a pincushion region."""
    barrel = UnifiedCamera(420.0, 420.0, 320.0, 240.0, 0.0, 640, 480, distortion=(-0.28, 0.07, 0.0, 0.0))
    cushion = UnifiedCamera(420.0, 420.0, 320.0, 240.0, 0.0, 640, 480, distortion=(0.1, 0.0, 0.0, 0.0))
    assert polygon_shortfall(barrel) > polygon_shortfall(cushion)
