"""What is led over to: smooth, whatever is asked for later, and complete at the end."""

import numpy as np
import pytest

from omniservo.tracking.goal_blend import GoalBlend

FIRST = np.array([[0.1, -0.2, 0.3]])
LATER = np.array([[0.0, 0.5, -0.1]])


@pytest.mark.parametrize("w", [0.2, 0.5, 0.7, 0.93])
def test_offsets_and_their_slope_have_no_jump_where_others_are_asked_for(w):
    lead, before = GoalBlend(FIRST), GoalBlend(FIRST)
    lead.change_to(LATER, w)
    for value, expected in zip(lead.at(w), before.at(w), strict=True):
        assert value == pytest.approx(expected, abs=1e-12)
    for at in np.linspace(0.0, 0.999, 50):
        slope = (lead.at(at + 1e-6)[0] - lead.at(at - 1e-6)[0]) / 2e-6
        assert lead.at(at)[1] == pytest.approx(slope, abs=1e-5)


def test_nothing_is_added_in_the_first_half_and_what_was_asked_for_last_at_the_end():
    lead = GoalBlend(FIRST)
    for w, asked in ((0.1, LATER), (0.6, FIRST), (0.6, LATER), (0.8, 2 * FIRST)):
        lead.change_to(asked, w)
    assert not lead.at(0.5)[0].any()
    assert lead.at(1.0)[0] == pytest.approx(2 * FIRST, abs=1e-15)


def test_what_is_asked_for_at_the_end_holds_at_once():
    lead = GoalBlend(FIRST)
    lead.change_to(LATER, 1.0)
    assert lead.at(1.0)[0] == pytest.approx(LATER, abs=1e-15)
