import math

import numpy as np
import pytest

from omniservo.errors import InputError
from omniservo.servoing import ExponentialLaw, RestToRestLaw

LAWS = [ExponentialLaw(0.7), RestToRestLaw(3.0)]


@pytest.mark.parametrize("law", LAWS)
def test_rate_is_the_derivative(law):
    for time in np.linspace(0.01, 5.0, 57):
        slope = (law(time + 1e-6)[0] - law(time - 1e-6)[0]) / 2e-6
        assert law(time)[1] == pytest.approx(slope, abs=1e-8)


@pytest.mark.parametrize("law", LAWS)
def test_motion_at_many_times_is_that_at_each_and_its_acceleration_the_rates_derivative(law):
    times = np.linspace(0.01, 5.0, 57)
    w, rate, growth = law.motion(times)
    np.testing.assert_allclose(np.transpose([w, rate]), [law(time) for time in times], atol=1e-14)
    slopes = [(law(time + 1e-6)[1] - law(time - 1e-6)[1]) / 2e-6 for time in times]
    np.testing.assert_allclose(growth, slopes, atol=1e-7)


@pytest.mark.parametrize("law", LAWS)
def test_parameter_starts_at_zero_never_decreases_and_never_exceeds_one(law):
    values = np.array([law(time)[0] for time in np.linspace(-1.0, 50.0, 5001)])
    assert (np.diff(values) >= 0.0).all()
    assert values[0] == 0.0
    assert law(0.0)[0] == 0.0
    assert values[-1] == pytest.approx(1.0, abs=1e-12)
    assert values.max() <= 1.0


def test_rest_to_rest_does_not_exceed_one_by_rounding_either():
    law, times = RestToRestLaw(3.0), 3.0 * (1.0 - np.logspace(-7, -1, 2000))
    assert max(law(time)[0] for time in times) <= 1.0
    assert law.motion(times)[0].max() <= 1.0


@pytest.mark.parametrize("law", LAWS)
def test_nothing_moves_before_the_start(law):
    assert law(-0.02) == (0.0, 0.0)
    assert not law.finished(-0.02)


def test_rest_to_rest_has_no_speed_and_no_acceleration_at_both_ends():
    law = RestToRestLaw(2.0)
    for time in (0.0, 2.0):
        assert law(time)[1] == 0.0
        for side in (-1e-4, 1e-4):
            assert abs(law(time + side)[1]) < 1e-6
    assert law(1.0) == (0.5, pytest.approx(1.875 / 2.0))
    assert law(2.0)[0] == 1.0
    assert law(1e9) == (1.0, 0.0)


def test_rest_to_rest_is_finished_at_its_duration():
    law = RestToRestLaw(2.0)
    assert not law.finished(1.999)
    assert law.finished(2.0)


def test_exponential_starts_with_its_rate_and_finishes_at_a_thousandth():
    law = ExponentialLaw(2.0)
    assert law(0.0) == (0.0, 2.0)
    end = math.log(1e3) / 2.0
    assert not law.finished(0.999 * end)
    assert law.finished(1.001 * end)


@pytest.mark.parametrize("bad", [0.0, -1.0, np.nan, np.inf])
def test_rate_and_duration_must_be_positive(bad):
    with pytest.raises(InputError, match="rate"):
        ExponentialLaw(bad)
    with pytest.raises(InputError, match="duration"):
        RestToRestLaw(bad)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("time", [np.nan, np.inf, -np.inf])
def test_a_time_that_is_not_finite_is_refused(law, time):
    with pytest.raises(InputError, match="time"):
        law(time)
