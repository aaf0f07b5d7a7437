"""What slows and approaches a command, for random ones: limits, directions, and where braking ends."""

import numpy as np
import pytest

from omniservo.safety.motion_limits import approached, braked, slowed, stopping_distance


@pytest.fixture
def rng():
    return np.random.default_rng(11)


def test_a_slowed_command_keeps_its_direction_and_every_limit(rng):
    for size in (0.1, 1.0, 10.0, 1e300):
        limits, given = rng.uniform(0.5, 5.0, 7), size * rng.normal(size=7)
        kept = slowed(given, limits)
        assert (np.abs(kept) <= limits).all()
        np.testing.assert_allclose(kept / np.abs(kept).max(), given / np.abs(given).max(), rtol=1e-12, atol=0)


def test_an_approached_command_is_within_the_change_and_not_beyond_what_is_wanted(rng):
    for _ in range(2000):
        last, wanted, change = rng.normal(size=6), rng.normal(size=6), rng.uniform(0.0, 2.0, 6)
        wanted[rng.random(6) < 0.2] = 0.0
        near = approached(last, wanted, change)
        assert (np.abs(near - last) <= change * (1 + 1e-12) + 1e-15).all()
        assert (np.abs(near) <= np.maximum(np.abs(last), np.abs(wanted)) + 1e-12).all()


def test_an_approached_command_keeps_the_direction_where_one_in_reach_has_it(rng):
    kept = 0
    for _ in range(2000):
        wanted, change = rng.normal(size=6), rng.uniform(0.01, 0.5, 6)
        last = rng.uniform(0.0, 1.0) * wanted + 0.5 * change * rng.uniform(-1, 1, 6)
        near = approached(last, wanted, change)
        factors = near / wanted
        assert np.ptp(factors) < 1e-9
        assert -1e-12 <= factors[0] <= 1 + 1e-12
        kept += factors[0] < 1.0
    assert kept > 100


def test_approaching_again_and_again_arrives(rng):
    for _ in range(40):
        now, wanted, change = rng.normal(size=6), rng.normal(size=6), rng.uniform(0.01, 0.5, 6)
        for _ in range(1000):
            now = approached(now, wanted, change)
        np.testing.assert_allclose(now, wanted, atol=1e-9)


def test_braking_ends_at_the_stopping_distance(rng):
    for _ in range(20):
        speed, acceleration, reaction = rng.normal(size=6), rng.uniform(1.0, 20.0, 6), rng.uniform(0.0, 0.2)
        step, way, now = 1e-3, speed * reaction, speed
        while now.any():
            after = braked(now, acceleration * step)
            way, now = way + 0.5 * (now + after) * step, after
        np.testing.assert_allclose(stopping_distance(speed, acceleration, reaction), way, atol=5e-3)
