"""What docs/real-robot.md says of smaller images in a rehearsal."""

from contextlib import closing

import pytest

from omniservo.cli.sim import _of_size
from omniservo.errors import InputError
from omniservo.runs import teach_goal
from omniservo.simulation import SimulatedCell
from omniservo.tasks import load_task


def taught(width, height):
    """Teach the goal of ur5e-table with images of this size; return how many dots were found."""
    task = _of_size(load_task("ur5e-table"), width, height)
    with closing(SimulatedCell(task, 0)) as cell:
        return len(teach_goal(task, cell).features)


def test_the_size_that_the_docs_state_shows_most_of_the_dots_and_half_of_the_width_too_few():
    assert 11 <= taught(500, 328) <= 14
    with pytest.raises(InputError, match=r"\d dots found; at least 8 are needed"):
        taught(330, 216)
