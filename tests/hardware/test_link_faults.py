"""A line with faults does what it says, and always the same."""

import numpy as np
import pytest

from omniservo.errors import InputError
from omniservo.hardware import FaultyLine, LinkFaults


def delays(faults, count=4000):
    line, found = FaultyLine(faults, 0.0), []
    for k in range(count):
        line.put(k, 0.01 * k)
    while (now := line.next_due()) is not None:
        found += [(k, now - 0.01 * k) for k in line.due(now)]
    return np.array(found)


def test_a_good_line_delivers_at_once_and_in_order():
    line = FaultyLine(LinkFaults(), 0.0)
    for k in range(3):
        line.put(k, 1.0)
    assert line.due(0.999) == []
    assert line.due(1.0) == [0, 1, 2]
    assert line.due(2.0) == []
    assert line.next_due() is None


def test_delay_jitter_and_loss_are_what_was_stated():
    found = delays(LinkFaults(0.1, 0.03, 0.05, seed=2, reordered=True))
    assert len(found) == pytest.approx(3800, abs=60)
    assert 0.07 <= found[:, 1].min() < 0.0705
    assert 0.1295 < found[:, 1].max() <= 0.13
    assert found[:, 1].mean() == pytest.approx(0.1, abs=1e-3)
    assert (np.diff(found[:, 0]) < 0).any()


def test_a_stream_keeps_its_order():
    found = delays(LinkFaults(0.1, 0.09, seed=2))
    assert (np.diff(found[:, 0]) > 0).all()
    assert found[:, 1].min() >= 0.01 - 1e-9
    assert delays(LinkFaults(0.01, 0.05)).min() >= 0.0


def test_the_same_seed_gives_the_same_line():
    np.testing.assert_array_equal(*(delays(LinkFaults(0.1, 0.05, 0.2, seed=7)) for _ in range(2)))


def test_the_servers_clock():
    line = FaultyLine(LinkFaults(clock_offset=-1.0, drift_ppm=100.0), 50.0)
    assert line.stamp(50.0) == 49.0
    assert line.stamp(60.0) == pytest.approx(59.001)


@pytest.mark.parametrize(
    "name, value",
    [("latency", -1.0), ("jitter", np.nan), ("loss", 1.1), ("clock_offset", np.inf), ("drift_ppm", 1e6)],
)
def test_what_no_line_does_is_refused(name, value):
    with pytest.raises(InputError, match=name):
        LinkFaults(**{name: value})
