"""What a stand-in of a UR controller knows of programs: two, by their text, and the registers they read.

It does not interpret URScript. A program that is none of the two is refused.
"""

from __future__ import annotations

import re
import time
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.hardware.rtde.control_program import BEAT, ECHO, NUMBER, VELOCITIES, limits_of_program

NONE = -2
"""no number of a command"""


@dataclass
class Registers:
    """What clients wrote and programs said, by RTDE's names."""

    values: dict[str, float] = field(default_factory=dict)
    """newest value of each; what was never written is 0"""
    written: dict[str, float] = field(default_factory=dict)
    """when a client wrote each [s]"""

    def write(self, name: str, value: float) -> None:
        """Take in a client's value."""
        self.values[name], self.written[name] = value, time.monotonic()

    def number(self, name: str) -> int:
        """Return an integer register."""
        return int(self.values.get(name, 0))


class StandInProgram(Protocol):
    """A program that runs."""

    watched: tuple[str, float] | None
    """the register that must be written at least so often [s], else the program is stopped; None: no watch"""

    def step(self, registers: Registers) -> FloatArray | None:
        """Do what the program does in one control period: joint speeds (6,) [rad/s], or None at its end."""
        ...


class ControlProgram:
    """What the text of `control_program` does."""

    def __init__(self, watchdog: float, registers: Registers) -> None:
        self._limit = watchdog
        self._old, self._beat = registers.number(NUMBER), 0
        self.watched: tuple[str, float] | None = None
        """see StandInProgram"""

    def step(self, registers: Registers) -> FloatArray | None:
        """See StandInProgram."""
        number = registers.number(NUMBER)
        if number != self._old:
            self._old = NONE
        if number < 0 and self._old == NONE:
            return None
        speeds = np.zeros(6)
        if number > 0 and self._old == NONE:
            speeds = np.array([registers.values.get(name, 0.0) for name in VELOCITIES])
            self.watched = self.watched or (NUMBER, self._limit)
        else:
            self.watched = None
        self._beat += 1
        registers.values[ECHO], registers.values[BEAT] = number, self._beat
        return speeds


class UrRtdeProgram:
    """What the program of the client library `ur_rtde` does with its registers: the commands of joint speeds.

    Args:
        first: where its integer registers begin.
        first_double: where its other registers begin.
    """

    SPEED_J, SPEED_STOP, STOPS, WATCHDOG, END = 9, 15, (33, 34), 35, 255
    READY, DONE = 1, 2

    def __init__(self, first: int, first_double: int, registers: Registers, refused: list[str]) -> None:
        self._command, self._answer = f"input_int_register_{first}", f"output_int_register_{first}"
        self._doubles = [f"input_double_register_{first_double + k}" for k in range(6)]
        self._refused = refused
        self._speeds: FloatArray = np.zeros(6)
        self.watched: tuple[str, float] | None = None
        """see StandInProgram"""
        registers.values[self._answer] = self.READY

    def step(self, registers: Registers) -> FloatArray | None:
        """See StandInProgram."""
        command = registers.number(self._command)
        if command == 0:
            registers.values[self._answer] = self.READY
            return self._speeds
        if registers.number(self._answer) == self.DONE:
            return self._speeds
        numbers = np.array([registers.values.get(name, 0.0) for name in self._doubles])
        if command == self.SPEED_J:
            self._speeds = numbers  # commands of a stream follow one another without being answered
            return self._speeds
        if command == self.END:
            return None
        if command in (self.SPEED_STOP, *self.STOPS):
            self._speeds = np.zeros(6)
        elif command == self.WATCHDOG:
            self.watched = (self._command, 1.0 / numbers[0]) if numbers[0] > 0.0 else None
        else:
            self._refused.append(f"command {command} of ur_rtde")
        registers.values[self._answer] = self.DONE
        return self._speeds


def program_of(text: str, registers: Registers, refused: list[str]) -> StandInProgram | None:
    """Return the program of a text; None, and a line in ``refused``, where it is none that is known."""
    limits = limits_of_program(text)
    if limits is not None:
        return ControlProgram(limits[0], registers)
    if "def rtde_control():" in text:
        first, first_double = (  # the number stands behind the comment, on the next line
            re.search(rf"reg_offset_{kind} =\s*(?:#[^\n]*\n)?\s*(\d+)", text) for kind in ("int", "float")
        )
        starts = [int(each[1]) if each else 0 for each in (first, first_double)]
        return UrRtdeProgram(starts[0], starts[1], registers, refused)
    refused.append(f"a program of {len(text)} bytes, which is none of the two that are known")
    return None
