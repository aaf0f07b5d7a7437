"""What two pictures say, in words."""

import re

import numpy as np

from omniservo.cameras import preset
from omniservo.estimation import estimate_two_view
from omniservo.reporting.estimate_table import estimate_table


def test_a_sigma_is_never_shown_as_zero():
    rng, camera = np.random.default_rng(1), preset("fe185")
    points = rng.uniform([-0.3, -0.3, 0.4], [0.3, 0.3, 0.8], (60, 3))
    pixels = [
        camera.project(p)[0] + 1e-3 * rng.normal(size=(60, 2)) for p in (points, points - [0.1, 0.0, 0.05])
    ]
    found = estimate_two_view(camera, *pixels)
    shown = dict(re.findall(r'<th scope="row">(.*?)</th><td>(.*?)</td>', estimate_table(found).html))
    sigma = np.sqrt(np.diag(found.covariance))
    for name, values in (
        ("… 1σ", sigma[:3]),
        ("… 1σ, about the goal camera&#x27;s axes", np.rad2deg(sigma[3:])),
    ):
        said = [float(word) for word in shown[name].split(", ")]
        np.testing.assert_allclose(said, values, atol=0.06 * values.max())
