"""What a person is asked stands on the terminal until it is answered."""

import sys

import pytest
from tests.cli.terminal import answered_on_terminal

from omniservo.cli.progress import Progress

ASKS = """
from omniservo.cli.output import Output
from omniservo.cli.robot_file import Approval
with Output().working("listening") as progress:
    Approval(progress, yes=False)("turn a joint")
    progress("turning")
"""


def asked(answer):
    return answered_on_terminal([sys.executable, "-c", ASKS], b"(n): ", answer)


def test_nothing_is_drawn_over_the_question_whether_the_arm_may_move():
    before, meanwhile, after = asked(b"y\n")
    assert "listening" in before
    assert "about to: turn a joint" in before.splitlines()[-2]
    assert meanwhile == ""
    assert "turning" in after


def test_who_leaves_the_question_does_not_agree():
    assert "the motion was not agreed to; nothing moved" in asked(b"\x04")[2]


def test_what_is_left_does_not_count_the_time_of_connecting_nor_that_of_an_answer(monkeypatch):
    clock = [0.0]
    monkeypatch.setattr("omniservo.cli.progress.perf_counter", lambda: clock[0])
    progress = Progress("loading", silent=False)
    clock[0] += 1.0
    with progress.uncounted():
        clock[0] += 10.0
    with progress.suspended():
        clock[0] += 100.0
    clock[0] += 2.0
    progress("following", 0.5)
    assert progress._ends - clock[0] == pytest.approx(3.0)
