"""The flange was called the tool: an arm is still made, and asked for it, by that name, with a warning."""

import pytest

from omniservo.errors import InputError
from omniservo.robots import Arm, load_arm

RENAMED = "tool is called flange now"


def test_an_arm_is_made_by_the_arguments_of_before():
    path = load_arm("rx60").path
    for make in (lambda name: Arm(path, tool=name), lambda name: load_arm("rx60", tool=name)):
        with pytest.warns(DeprecationWarning, match=RENAMED) as told:
            assert make("flange").flange == "flange"
        assert [warning.filename for warning in told] == [__file__]
        with (
            pytest.warns(DeprecationWarning, match=RENAMED),
            pytest.raises(InputError, match="flange 'shoulder': carried by 1 joint"),
        ):
            make("shoulder")


def test_the_name_of_before_and_of_now_together_are_a_wrong_call():
    with pytest.raises(TypeError, match="unexpected keyword argument 'tool'"):
        load_arm("rx60", tool="flange", flange="flange")


def test_an_arm_still_answers_to_the_attributes_of_before():
    arm = load_arm("rx60")
    with pytest.warns(DeprecationWarning, match=f"Arm.{RENAMED}"):
        assert arm.tool == arm.flange
    with pytest.warns(DeprecationWarning, match=r"Arm.tool_link is called flange_link now"):
        assert arm.tool_link == arm.flange_link
