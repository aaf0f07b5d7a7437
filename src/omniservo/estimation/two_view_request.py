"""What a caller wants of two views beside the motion."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from omniservo.errors import InputError
from omniservo.estimation.robust.members import MOTION_PARAMETERS
from omniservo.estimation.uncertainty.two_view_uncertainty import Lens, ScaleLength
from omniservo.geometry.arrays import BoolArray, FloatArray, IntArray

FEW_TO_RAISE = 3 * MOTION_PARAMETERS
"""Of fewer matches noise is not raised: the residuals do not tell a wrong match from noise."""


class TwoViewRequest(NamedTuple):
    """How the answer is to be scaled, and what else is uncertain."""

    kind: int
    """s_R of the joint refinement"""
    between: tuple[int, int] | None
    """matches whose distance is known; None: the camera centres'"""
    metres: float | None
    """that distance; None where none is known"""
    scale_sigma: float
    """its standard deviation over itself"""
    lens: Lens
    squares: IntArray
    """(m, 4) matches that are the corners of a square"""
    windows: FloatArray | None
    """(n,) standard deviation of the window that each match was measured in [px]; None: all err alone"""

    noise: FloatArray | None
    """(n, 2) stated σ of the pixels alone, in either image [px]; None: the residuals tell it"""

    raised: float = 1.0
    """by which factor matches' whole noise was raised, since they would not agree"""
    is_last: bool = False
    """The matches' noise is not to be changed again."""

    def rejected(self, members: BoolArray) -> int | None:
        """Return a match that the scale refers to and that is no member."""
        return next((i for i in self.between or () if not members[i]), None)

    def at(self, places: IntArray) -> TwoViewRequest:
        """Return the request with matches ``places`` (n,) in place of all n.

        Raises:
            InputError: the scale refers to two points that are one there.
        """
        squares = np.unique(places[self.squares], axis=0)
        if self.between is None:
            return self._replace(squares=squares)
        one, other = int(places[self.between[0]]), int(places[self.between[1]])
        if one == other:
            raise InputError(
                f"scale: points {self.between[0]} and {self.between[1]} have the same pixels; two different"
                " points are needed"
            )
        return self._replace(between=(one, other), squares=squares)

    def where(self, rows: BoolArray) -> TwoViewRequest:
        """Return the request for the chosen matches alone; squares of which one is not chosen are none."""
        place = np.cumsum(rows) - 1
        return self._replace(
            between=None
            if self.between is None
            else (int(place[self.between[0]]), int(place[self.between[1]])),
            squares=place[self.squares[rows[self.squares].all(axis=1)]],
            windows=self.windows_of(rows),
            noise=None if self.noise is None else self.noise[rows],
        )

    def may_raise(self, robust: bool) -> bool:
        """Tell whether the stated noise may be raised: once, and where the camera is a real one."""
        return robust and self.noise is not None and self.lens.error is not None and not self.is_last

    def may_forget(self, robust: bool) -> bool:
        """Tell whether stated noise may be taken as unknown: where an exact camera sees several squares."""
        several = 4 * len(self.squares) >= FEW_TO_RAISE
        return robust and several and self.noise is not None and self.lens.error is None

    def noisier(self, factor: float) -> TwoViewRequest:
        """Return the request with the pixels' stated noise so many times as large."""
        return self._replace(
            noise=None if self.noise is None else factor * self.noise, raised=factor, is_last=True
        )

    @property
    def own_px(self) -> float:
        """σ [px] of most pixels alone, where it is stated."""
        return 0.0 if self.noise is None else float(np.median(self.noise))

    def windows_of(self, members: BoolArray) -> FloatArray | None:
        """Return the members' windows (m,) [px]; None: they err alone."""
        return None if self.windows is None else self.windows[members]

    def length(self, members: BoolArray) -> ScaleLength:
        """Return what fixes the scale, among the members."""
        if self.between is None:
            return ScaleLength(None, self.metres or 1.0)
        places = int(members[: self.between[0]].sum()), int(members[: self.between[1]].sum())
        return ScaleLength(places, self.metres or 1.0)
