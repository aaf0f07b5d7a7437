"""What the robot does while there is no image to act on: it slows down along its path, stands, and waits."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from omniservo.errors import ServoStop, StaleImage
from omniservo.field_docs import with_field_docs
from omniservo.robots import CameraImage
from omniservo.safety.measured_delays import MeasuredDelays
from omniservo.safety.path_controller import PathController
from omniservo.safety.supervised_robot import SupervisedRobot
from omniservo.safety.supervisor import Passed, Wish

TICK = 1e-3
"""How often a new image is looked for [s]."""

OVERDUE = 2.5
"""An image is overdue so many of the camera's periods after the last one: one may be lost, and one late."""

LATE = 1.5
"""It may be missing after so many, where slowing down has to begin lest there be too little room."""

RENEWED = 0.01
"""While there are no images a twist is commanded anew so often [s]."""

STANDS_BEFORE = 0.05
"""The robot is led to rest so long before the newest image is too old to be acted on [s]."""

BEGINS_BEFORE = 0.02
"""Slowing down begins at the latest so long before the newest image is too old [s], whatever the camera's
period: the next one of images that are late may come only then, and moving on would be refused for good."""

BRAKING = 2.0
"""Slowing down takes so many times of what the joints need to brake: its steepest asks 3/4 of that of them;
the rest is for the path's bends."""

LEAST_BRAKING = 3 * RENEWED
"""Slowing down takes so many twists at least [s]."""

SLOWINGS = 17
"""So many ways of slowing down are tried: the gentlest that keeps within its room is taken."""

SLOWEST = 1.0
"""Nothing is slowed down for longer [s], unless the joints need it."""

RISING = 0.3
"""Afterwards the reference takes at least so long to be as fast as planned [s]."""


@with_field_docs
@dataclass(frozen=True)
class Waiting:
    """A time without images that could be acted on."""

    since: float
    """when the robot began to slow down, since the loop's first image [s]"""
    why: str
    """in words"""
    stands_at: float
    """when it stands, likewise [s]"""
    until: float = np.nan
    """when an image could be acted on again, or the robot was stopped, likewise [s]; NaN: it still waits"""
    resumed: float = np.nan
    """when the reference goes on, likewise [s]; NaN: it does not, or not yet"""
    rising: float = np.nan
    """how long it takes to be as fast as planned [s]"""


class BlindMotion:
    """Leads the robot between two images that are acted on.

    Until an image is overdue the last twist acts on. Then a controller with a path is slowed down on it, led
    by the joints alone: as gently as lets the camera stand within ``blind_room`` and before the newest image
    is too old, but no faster than the joints can. Where that would take more room or time than there is, it
    begins earlier, once an image is missing. Any other robot is braked. It stands by twists of zero, given
    again and again, until an image can be acted on, or for ``patience`` at most. That image's twist is of a
    reference that stands, so until the next one the path leads by the joints.

    Args:
        supervisor: leads the robot.
        path: the controller, where it has a path; None: it has none.
        delays: of the images.
        told: called when it begins to slow down, and when that is over.
    """

    def __init__(
        self,
        supervisor: SupervisedRobot,
        path: PathController | None,
        delays: MeasuredDelays,
        told: Callable[[Waiting], None],
    ) -> None:
        self._supervisor, self._path, self._delays, self._told = supervisor, path, delays, told
        self._options = supervisor.options
        self.start = np.nan
        """the time of the loop's first image [s]"""
        self._exposed = self._acted = self._led = np.nan
        self._braking = 0.0
        self._waiting: Waiting | None = None
        self._resumes = False

    @property
    def waiting(self) -> bool:
        """Whether the robot slows down or stands because images are missing."""
        return self._waiting is not None

    def acted(self, image: CameraImage, passed: Passed) -> None:
        """Note that a command rests on an image; what was slowed down goes on."""
        now = self._supervisor.time
        self._exposed, self._acted = image.earliest, now
        self._resumes, self._led = self.waiting and self._path is not None, np.nan
        if not self.waiting:
            turning = np.abs(passed.target) / self._supervisor.arm.joint_acceleration
            self._braking = max(BRAKING * float(turning.max()), LEAST_BRAKING)
        else:
            self._go_on(now)
        self.end()

    def end(self) -> None:
        """Tell that a waiting is over, where there is one."""
        if self._waiting is not None:
            self._told(replace(self._waiting, until=self._supervisor.time - self.start))
            self._waiting = None

    def _go_on(self, now: float) -> None:
        """Let the reference go on."""
        if self._waiting is None or self._path is None:
            return
        resumed, rising = now + self._options.command_lag - self.start, max(RISING, self._braking)
        self._waiting = replace(self._waiting, resumed=resumed, rising=rising)
        self._path.go_on(self._waiting.resumed, self._waiting.rising)

    def pass_time(self, why: ServoStop | None, wish: Wish | None) -> None:
        """Let a moment pass without an image that can be acted on.

        Args:
            why: what is wrong with the newest image; None: none came.
            wish: where joints go in what the twist leaves free, and near singularities; None: nowhere.

        Raises:
            ServoStop: ``why``, or `StaleImage`, after ``patience``; or the robot was stopped.
        """
        now = self._supervisor.read().time
        if np.isnan(self._acted):
            self._acted = now  # nothing was commanded yet
        waited, patience = now - self._acted, max(self._options.patience, self._options.image_age)
        if waited > patience:
            words = f"no new image for {waited:.3f} s; at most {patience:g} s is waited"
            raise StaleImage(words) if why is None else why
        if not self.waiting and self._overdue(now, waited):
            self._begin(now, f"no new image for {waited:.3f} s" if why is None else str(why))
        if (self.waiting or self._resumes) and not now - self._led < RENEWED:
            self._lead(now, wish)
        self._supervisor.wait(TICK)

    def _overdue(self, now: float, waited: float) -> bool:
        """Return whether to slow down after so long without an image [s]."""
        period = self._delays.period
        if now - self._exposed > self._options.image_age - BEGINS_BEFORE:
            return True
        if np.isnan(period):  # after the first image
            age = self._options.image_age
            return waited > 0.5 * age and now - self._exposed > age - STANDS_BEFORE
        if waited > OVERDUE * period:
            return True
        if not waited > LATE * period:
            return False
        if now - self._exposed + self._braking > self._options.image_age - STANDS_BEFORE:
            return True
        room = self._options.blind_room
        if self._path is None or room == 0.0:
            return False
        return self._path.off_path(now + RENEWED + self._held - self.start, self._braking) > room

    @property
    def _held(self) -> float:
        """How much later than it should a twist acts, that of the moment before being held until then [s]."""
        return RENEWED + self._options.command_lag

    def _slowing(self, path: PathController, now: float) -> float:
        """Return how long slowing down takes [s]."""
        least, time = self._braking, now + self._held - self.start
        most = min(self._options.image_age - STANDS_BEFORE - (now - self._exposed), SLOWEST)
        tried = np.linspace(max(most, least), least, SLOWINGS).tolist()
        return next((t for t in tried if path.off_path(time, t) <= self._options.blind_room), least)

    def _begin(self, now: float, why: str) -> None:
        """Begin to slow down, where the robot may move."""
        if np.isnan(self._exposed):
            return
        since = stands_at = now - self.start
        if self._path is not None:
            stands_at = self._path.slow_down(since, self._slowing(self._path, now))
        self._waiting = Waiting(since, why, stands_at)
        self._told(self._waiting)

    def _lead(self, now: float, wish: Wish | None) -> None:
        """Command the twist of this moment."""
        self._led, time = now, now - self.start
        moves = self._waiting is None or time < self._waiting.stands_at
        if self._path is None or not moves or now - self._exposed > self._options.image_age - STANDS_BEFORE:
            self._supervisor.carry(np.zeros(6))
        else:
            twist = self._path.coast(time, time + self._options.command_lag)
            self._supervisor.carry(twist, wish)
