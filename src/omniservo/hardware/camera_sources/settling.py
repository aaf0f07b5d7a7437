"""When the frames of a source that was just opened are no longer old ones out of some buffer."""

from __future__ import annotations

from collections import deque
from itertools import pairwise

FRAMES, WINDOW = 5, 0.4
"""The last frames of so much time [s] are compared, and at least so many."""

DRAINING = 0.7
"""Frames that come in less than this share of the time in which they were exposed come out of a buffer; and
stamps that do not even span this share of the time in which their frames came are no times."""

MOST = 3.0
"""After so much time frames are taken as they are [s]."""


class Settling:
    """Watches frames until a buffer, if there is one, has been emptied.

    With time stamps a buffer shows in frames that come faster than they were exposed; without them in frames
    that come faster than others did.
    """

    def __init__(self) -> None:
        self._frames: deque[tuple[float, float | None]] = deque()
        self._first: float | None = None
        self._slowest = 0.0
        self.is_settled = False
        """whether frames are new ones by now"""
        self.gave_up = False
        """whether they are taken without having settled"""

    def add(self, arrival: float, stamp: float | None) -> bool:
        """Take in a frame's arrival and stamp [s], and return whether it may be used."""
        if self.is_settled:
            return True
        frames = self._frames
        frames.append((arrival, stamp))
        while len(frames) > FRAMES and frames[1][0] <= arrival - WINDOW:
            frames.popleft()
        self._first = arrival if self._first is None else self._first
        came = arrival - frames[0][0]
        if len(frames) >= FRAMES and came >= WINDOW:
            period = came / (len(frames) - 1)
            self._slowest = max(self._slowest, period)
            exposed = self._exposed()
            drains = period < DRAINING * self._slowest if exposed is None else came < DRAINING * exposed
            self.is_settled = not drains
        if not self.is_settled and arrival - self._first >= MOST:
            self.is_settled = self.gave_up = True
        return self.is_settled

    @property
    def stamps_are_times(self) -> bool:
        """Whether the last frames all have stamps, that went on as their arrivals did."""
        exposed, came = self._exposed(), self._frames[-1][0] - self._frames[0][0]
        return exposed is not None and came >= DRAINING * exposed and exposed >= DRAINING * came

    def _exposed(self) -> float | None:
        """Return in how much time the last frames were exposed [s]; None without usable stamps."""
        known = [stamp for _, stamp in self._frames if stamp is not None]
        if len(known) < len(self._frames) or any(after <= before for before, after in pairwise(known)):
            return None
        return known[-1] - known[0]
