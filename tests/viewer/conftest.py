"""One page for all tests of this room: each leaves it as the task has it."""

from __future__ import annotations

import pytest

from omniservo.viewer import open_viewed, serve_page

PATIENCE = 240.0
"""[s] for what takes less than one on an idle machine"""


def settled(page, after=0):
    """Return the first answer behind a number that is final and takes all changes into account."""
    return page.wait_for(lambda answer: answer.number > after and page.is_settled(answer), PATIENCE)


@pytest.fixture(scope="session")
def served():
    with serve_page(open_viewed("whole-arm-1"), port=8300) as page:
        settled(page)
        yield page


@pytest.fixture
def page(served):
    yield served
    number = served.answer.number
    served.open(open_viewed("whole-arm-1"))
    settled(served, number)
