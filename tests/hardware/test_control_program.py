"""The program that the controller runs: its text, run as written, and the stand-in's copy of it."""

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from omniservo.hardware.rtde.control_program import (
    BEAT,
    ECHO,
    NUMBER,
    VELOCITIES,
    control_program,
    limits_of_program,
)
from omniservo.hardware.rtde.stand_in_programs import Registers, UrRtdeProgram, program_of

STEP, SPEEDS = 0.002, [0.1, -0.2, 0.3, 0.4, -0.5, 0.6]

DOCUMENTED = {
    "read_input_integer_register",
    "read_input_float_register",
    "write_output_integer_register",
    "rtde_set_watchdog",
    "get_steptime",
    "speedj",
}


class Ended(Exception):
    pass


def run_text(text, steps):
    """Run the program's text: without its `end` lines it is Python. Return what it did in every step.

    A step is what the registers have in one control period: number, speeds.
    """
    done, watch = [], []
    state = {"k": 0}
    outputs = {}

    def speedj(speeds, acceleration, duration):
        assert duration == STEP
        assert acceleration == 5.0
        done.append((list(speeds), dict(outputs), list(watch)))
        watch.clear()
        state["k"] += 1
        if state["k"] == len(steps):
            raise Ended

    names = {
        "read_input_integer_register": lambda k: steps[state["k"]][0] if k == 24 else None,
        "read_input_float_register": lambda k: steps[state["k"]][1][k - 24],
        "write_output_integer_register": lambda k, value: outputs.update({k: value}),
        "rtde_set_watchdog": lambda *given: watch.append(given),
        "get_steptime": lambda: STEP,
        "speedj": speedj,
    }
    lines = [line for line in text.splitlines() if line.strip() != "end"]
    exec("\n".join(lines), names)  # noqa: S102
    try:
        names["omniservo"]()
    except Ended:
        return done, False
    return done, True


def test_it_is_short_and_uses_documented_calls_only():
    text = control_program(0.1, 5.0)
    assert text.count("\n") < 35
    assert set(re.findall(r"(\w+)\(", text)) - {"omniservo"} == DOCUMENTED
    assert limits_of_program(text) == (pytest.approx(0.1), 5.0)


def test_a_number_from_before_moves_nothing_and_the_next_one_does():
    done, _ = run_text(control_program(0.1, 5.0), [(7, SPEEDS)] * 3 + [(8, SPEEDS)] * 2 + [(0, SPEEDS)] * 2)
    assert [speeds for speeds, _, _ in done] == [[0.0] * 6] * 3 + [SPEEDS] * 2 + [[0.0] * 6] * 2
    assert [watch for _, _, watch in done] == [
        [],
        [],
        [],
        [("input_int_register_24", 10.0, "stop")],
        [],
        [("input_int_register_24", 10.0, "ignore")],
        [],
    ]


def test_an_end_from_before_ends_nothing_and_the_next_one_does():
    done, ended = run_text(
        control_program(0.1, 5.0), [(-1, SPEEDS)] * 2 + [(0, SPEEDS), (3, SPEEDS), (-1, SPEEDS)]
    )
    assert [speeds for speeds, _, _ in done] == [[0.0] * 6] * 3 + [SPEEDS]
    assert ended


@pytest.mark.slow
@given(
    steps=st.lists(
        st.tuples(
            st.sampled_from([0, 0, 1, 2, 3, 2**31 - 1, -1]),
            st.lists(st.floats(-1, 1), min_size=6, max_size=6),
        ),
        min_size=1,
        max_size=12,
    )
)
@settings(max_examples=300, deadline=None)
def test_the_stand_in_does_what_the_text_does(steps):
    text = control_program(0.1, 5.0)
    by_text, ended = run_text(text, steps)
    registers = Registers()
    registers.write(NUMBER, steps[0][0])
    program = program_of(text, registers, [])
    watched = None
    for k, (number, speeds) in enumerate(steps):
        for name, value in zip((NUMBER, *VELOCITIES), (number, *speeds), strict=True):
            registers.write(name, value)
        found = program.step(registers)
        if found is None:
            assert ended
            assert len(by_text) == k
            return
        commanded, outputs, watch = by_text[k]
        for _, frequency, action in watch:
            watched = (NUMBER, 1.0 / frequency) if action == "stop" else None
        assert np.array_equal(found, commanded)
        assert outputs == {24: registers.number(ECHO), 25: registers.number(BEAT)}
        assert program.watched == (watched and (watched[0], pytest.approx(watched[1])))
    assert not ended


@pytest.mark.parametrize("change", [("0.0, 0.0,", "0.1, 0.0,"), ("n > 0", "n > 1"), ("stop", "pause")])
def test_a_program_that_was_changed_is_not_taken_for_it(change):
    refused = []
    assert program_of(control_program(0.1, 5.0).replace(*change), Registers(), refused) is None
    assert len(refused) == 1


def test_a_command_that_is_not_known_of_ur_rtde_is_said():
    registers, refused = Registers(), []
    program = program_of("global reg_offset_int = 24\ndef rtde_control():\nend\n", registers, refused)
    assert isinstance(program, UrRtdeProgram)
    registers.write("input_int_register_24", 1)
    assert np.array_equal(program.step(registers), np.zeros(6))
    assert refused == ["command 1 of ur_rtde"]
