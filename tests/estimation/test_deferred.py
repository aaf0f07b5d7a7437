"""Fields that are worked out when they are read, in the object itself and in its copies."""

from __future__ import annotations

from dataclasses import dataclass, field

from omniservo.estimation.deferred import changed, deferring, later


@deferring("costly")
@dataclass(frozen=True)
class Result:
    """One cheap number, one that costs, and one that follows from another."""

    cheap: int
    costly: int
    twice: int = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "twice", 2 * self.cheap)


def test_a_changed_copy_does_not_work_out_what_nobody_has_read() -> None:
    worked_out: list[int] = []

    def work() -> int:
        worked_out.append(7)
        return 7

    first = Result(1, later(work))
    copy = changed(first, cheap=5)
    assert worked_out == []
    assert (copy.cheap, copy.twice, copy.costly, copy.costly) == (5, 10, 7, 7)
    assert worked_out == [7]
    assert (first.cheap, first.costly) == (1, 7)


def test_a_changed_copy_keeps_what_was_read_and_takes_what_is_given() -> None:
    first = Result(1, later(lambda: 7))
    assert first.costly == 7
    assert changed(first, cheap=2).costly == 7
    assert changed(first, costly=9).costly == 9
