"""The calls of a loop to the robot that it leads: a number each in a recording."""

from __future__ import annotations

from enum import IntEnum


class Call(IntEnum):
    """A question and its answer, or what the robot took in meanwhile."""

    BEGUN = 0
    """the history of the motion begins with the newest reading, at this time [s]"""
    MEASURED = 1
    """the reading of this time [s] was taken into the history"""
    SENT = 2
    """the next command was taken into the history"""
    WARMED = 3
    """the points were detected in the image of this time [s] before the servo"""
    IMAGE = 4
    """there was another image, of this time, which has this standard deviation [s]"""
    SAME = 5
    """there was no other image"""
    READ = 6
    """the joints were read"""
    TIME = 7
    """it was this time [s]"""
    WAITED = 8
    """so long was waited [s]"""
    HISTORY = 9
    """the history was looked into"""
    PASSED = 10
    """a command was passed on: velocities that it came to, and those aimed for, n each [rad/s]"""
    STOPPED = 11
    """the robot was brought to rest"""
    RAISED = 12
    """the robot stopped by itself instead of an answer"""

    def count(self, dof: int) -> int:
        """Return how many numbers belong to it, for so many joints."""
        if self is Call.PASSED:
            return 2 * dof
        return 2 if self is Call.IMAGE else int(self in _TIMES)


_TIMES = (Call.BEGUN, Call.MEASURED, Call.WARMED, Call.TIME, Call.WAITED)
