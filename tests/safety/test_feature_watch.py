"""What the watch over the features stops."""

import numpy as np
import pytest

from omniservo.errors import Divergence, FeatureLoss, NotFinite, SingularInteraction
from omniservo.safety import FeatureWatch, SafetyOptions

GRID = np.array([[0.1 * i, 0.1 * k, 0.5] for i in (-1, 0, 1) for k in (-1, 0, 1)])
ALL = np.ones(9, dtype=bool)
GOAL = np.zeros((9, 2))


@pytest.fixture
def watch():
    return FeatureWatch(SafetyOptions())


def test_a_grid_of_points_passes(watch):
    watch.check(0.0, GRID, ALL, 1.0, GOAL)


def test_too_few_points_are_named(watch):
    with pytest.raises(FeatureLoss, match="3 of 9"):
        watch.check(0.0, GRID, np.arange(9) < 3, 1.0, GOAL)


@pytest.mark.parametrize("points", [GRID * [1e-2, 1e-2, 1.0], GRID * [1.0, 0.0, 1.0]], ids=["close", "line"])
def test_points_too_close_together_or_on_a_line_are_named(watch, points):
    with pytest.raises(SingularInteraction, match="9 features"):
        watch.check(0.0, points, ALL, 1.0, GOAL)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_place_that_is_not_finite_is_named(watch, value):
    points = GRID.copy()
    points[4, 1] = value
    with pytest.raises(NotFinite):
        watch.check(0.0, points, ALL, 1.0, GOAL)
    watch.check(0.0, points, np.arange(9) != 4, 1.0, GOAL)  # nobody sees it


def test_an_error_that_is_not_a_number_is_named(watch):
    with pytest.raises(NotFinite):
        watch.check(0.0, GRID, ALL, np.nan, GOAL)


def follow(watch, errors, speed=0.0):
    """Check errors at 30 frames a second, the reference moving at a speed; return the time of the stop."""
    for k, error in enumerate(errors):
        try:
            watch.check(k / 30, GRID, ALL, float(error), GOAL + speed * k / 30)
        except Divergence:
            return k / 30
    return None


def test_a_growing_error_stops_within_its_time(watch):
    noise = 0.3 * np.random.default_rng(0).normal(size=90)
    time = follow(watch, 2.0 * np.exp(np.arange(90) / 30) + noise)
    assert time is not None
    assert time < 2.2


@pytest.mark.parametrize("seed", range(5))
def test_an_error_that_falls_stays_or_is_small_never_stops(seed):
    rng = np.random.default_rng(seed)
    t = np.arange(300) / 30
    for errors in (100 * np.exp(-t), np.full(300, 30.0), 1.0 + 0.8 * t):
        assert follow(FeatureWatch(SafetyOptions()), errors + 0.5 * np.abs(rng.normal(size=300))) is None


def test_what_a_lagging_drive_leaves_behind_is_no_divergence_and_more_than_it_is():
    options = SafetyOptions()
    for speed in (50.0, 200.0):
        behind = options.drive_lag * np.sqrt(2.0) * speed
        growing = np.linspace(0.0, options.growing_px + behind, 60)
        assert follow(FeatureWatch(options), growing[:-1], speed) is None
        assert follow(FeatureWatch(options), 1.3 * growing, speed) is not None
        assert follow(FeatureWatch(options), growing[:-1]) is not None  # the reference stands
