"""What a run strays in the image is measured from the planned way, not from a few places of it."""

import numpy as np
import pytest

arm_runs = pytest.importorskip("benchmarks.arm_runs", reason="benchmarks/ is not part of this copy")


def test_between_two_places_of_the_plan_nothing_has_strayed():
    random = np.random.default_rng(1)
    begin, way = random.uniform(0.0, 400.0, (2, 6, 2))
    planned = begin + np.linspace(0.0, 1.0, 5)[:, None, None] * way
    for w in random.uniform(0.0, 1.0, 20):
        assert arm_runs.strayed_px(planned, begin + w * way) == pytest.approx(0.0, abs=1e-9)
        across = np.stack([-way[:, 1], way[:, 0]], axis=1) / np.linalg.norm(way, axis=1)[:, None]
        seen = begin + w * way + 0.3 * across * (np.arange(6) == 4)[:, None]
        assert arm_runs.strayed_px(planned, seen) == pytest.approx(0.3, rel=1e-6)


def test_beyond_the_end_of_the_plan_it_has():
    planned = np.array([[[0.0, 0.0]], [[10.0, 0.0]]])
    assert arm_runs.strayed_px(planned, np.array([[13.0, 4.0]])) == pytest.approx(5.0)
