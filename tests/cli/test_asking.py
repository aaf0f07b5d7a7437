"""What a person is asked stands on the terminal until it is answered."""

import sys

import pytest
from tests.cli.terminal import answered_on_terminal

from omniservo.cli.progress import DOING, Progress
from omniservo.cli.robot_file import Approval

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
    assert "the motion was not agreed to, and not made" in asked(b"\x04")[2]


def test_who_ends_the_program_at_the_question_is_told_that_the_arm_stands(monkeypatch):
    def ended(*asked, **how):
        raise KeyboardInterrupt

    monkeypatch.setattr("omniservo.cli.robot_file.Confirm.ask", ended)
    monkeypatch.setattr("sys.stdin.isatty", lambda: True)
    monkeypatch.setattr(DOING, "written", [])
    with pytest.raises(KeyboardInterrupt), Progress("loading", silent=True) as progress:
        progress("following the path")
        Approval(progress, yes=False)("move the camera")
    said = "interrupted while asking whether the arm may move; it stands still; nothing was written"
    assert DOING.ended("interrupted") == said
    with Progress("loading", silent=True) as progress:
        progress("following the path")
        Approval(progress, yes=True)("move the camera")
        assert DOING.stage == "following the path"


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
