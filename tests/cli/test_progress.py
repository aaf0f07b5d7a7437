import pytest

from omniservo.cli import progress


@pytest.mark.parametrize(
    ("seconds", "said"),
    [
        (None, ""), (-3.0, "about 0 s left"), (59.6, "about 60 s left"), (599.0, "about 599 s left"),
        (600.0, "about 10 min left"), (3599.0, "about 59 min left"), (3600.0, "about 1 h 0 min left"),
        (90_000.0, "about 25 h 0 min left"),
    ],
)  # fmt: skip
def test_what_is_left_is_said_in_the_units_of_a_clock(monkeypatch, seconds, said):
    monkeypatch.setattr(progress, "perf_counter", lambda: 100.0)
    assert progress._left(None if seconds is None else 100.0 + seconds) == said
