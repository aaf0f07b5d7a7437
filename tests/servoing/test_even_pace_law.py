import numpy as np
import pytest

from omniservo.errors import InputError
from omniservo.servoing import EvenPaceLaw, RestToRestLaw


def uneven(w):
    """A path that moves ten times as fast in its middle as elsewhere."""
    return 0.2 + 1.8 * np.exp(-(((w - 0.5) / 0.05) ** 2))


LAW = EvenPaceLaw(uneven, 0.5)
TIMES = np.linspace(0.0, LAW.duration, 2001)


def test_the_length_is_run_through_from_rest_to_rest_at_no_more_than_the_top_speed():
    w, speed, _ = LAW.motion(TIMES)
    length_speed = uneven(w) * speed
    assert length_speed.max() == pytest.approx(0.5, rel=1e-3)
    assert length_speed[[0, -1]] == pytest.approx([0.0, 0.0], abs=1e-9)
    assert w[[0, -1]] == pytest.approx([0.0, 1.0], abs=1e-9)
    assert (np.diff(w) >= 0.0).all()


def test_it_is_done_long_before_the_law_that_is_paced_for_the_fastest_place():
    slow = RestToRestLaw(1.875 * uneven(np.array([0.5]))[0] / 0.5)
    assert LAW.duration < 0.25 * slow.duration
    assert LAW.finished(LAW.duration)
    assert not LAW.finished(0.999 * LAW.duration)


def test_speed_and_acceleration_are_the_derivatives_of_place_and_speed():
    step = 1e-4
    inside = TIMES[20:-20:50]
    w, speed, change = LAW.motion(inside)
    before, after = (LAW.motion(inside + off) for off in (-step, step))
    assert np.allclose((after[0] - before[0]) / (2 * step), speed, atol=1e-5 * speed.max())
    assert np.allclose((after[1] - before[1]) / (2 * step), change, atol=2e-3 * np.abs(change).max())
    each = np.array([LAW(time) for time in inside])
    assert np.allclose(each, np.column_stack((w, speed)))


@pytest.mark.parametrize("after", [0.0, 10.0, 100.0])
def test_a_pace_that_jumps_neither_lets_w_fall_nor_runs_away(after):
    def jumping(w):
        return np.where(w < 0.5, 1.0, after)

    law = EvenPaceLaw(jumping, 1.0)
    w, speed, _ = law.motion(np.linspace(0.0, law.duration, 20001))
    assert (np.diff(w) >= 0.0).all()
    assert (jumping(w) * speed).max() < 1.25


def test_before_and_after_it_rests():
    assert LAW(-1.0) == (0.0, 0.0)
    assert LAW(2 * LAW.duration) == pytest.approx((1.0, 0.0), abs=1e-9)


def test_it_is_no_shorter_than_its_least_duration_and_something_has_to_move():
    assert EvenPaceLaw(uneven, 100.0, 3.0).duration == 3.0
    still = EvenPaceLaw(np.zeros_like, 1.0, 2.0)
    assert still(1.0)[0] == pytest.approx(0.5)
    with pytest.raises(InputError, match="pace"):
        EvenPaceLaw(lambda w: np.full_like(w, np.nan), 1.0)
    with pytest.raises(InputError, match="pace: nothing moves; give a least_duration > 0"):
        EvenPaceLaw(np.zeros_like, 1.0)


def test_a_place_ten_times_as_fast_on_a_hundredth_of_the_way_keeps_the_top_speed():
    def narrow(w):
        return 0.2 + 1.8 * np.exp(-(((w - 0.5) / 0.005) ** 2))

    law = EvenPaceLaw(narrow, 0.5)
    w, speed, _ = law.motion(np.linspace(0.0, law.duration, 20001))
    assert (narrow(w) * speed).max() == pytest.approx(0.5, rel=5e-3)


def test_rounding_puts_no_place_beyond_the_ends():
    rng = np.random.default_rng(0)
    for _ in range(50):
        factors = rng.uniform(-1.0, 2.0, 5)
        law = EvenPaceLaw(lambda w, f=factors: np.abs(np.polyval(f, w - 0.3)), rng.uniform(0.1, 3.0))
        for time in (0.0, law.duration):
            assert 0.0 <= law.motion(np.array([time]))[0][0] <= 1.0
            assert 0.0 <= law(time)[0] <= 1.0


@pytest.mark.parametrize(("top", "least", "name"), [(0.0, 0.0, "top_speed"), (1.0, -1.0, "least_duration")])
def test_speeds_and_durations_that_are_none_are_refused(top, least, name):
    with pytest.raises(InputError, match=name):
        EvenPaceLaw(uneven, top, least)
