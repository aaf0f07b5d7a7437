"""What a caller wants of two views beside the motion."""

from typing import NamedTuple

from omniservo.estimation.uncertainty.two_view_uncertainty import Lens, ScaleLength
from omniservo.geometry.arrays import BoolArray, FloatArray, IntArray


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

    def rejected(self, members: BoolArray) -> int | None:
        """Return a match that the scale refers to and that is no member."""
        return next((i for i in self.between or () if not members[i]), None)

    def windows_of(self, members: BoolArray) -> FloatArray | None:
        """Return the members' windows (m,) [px]; None: they err alone."""
        return None if self.windows is None else self.windows[members]

    def length(self, members: BoolArray) -> ScaleLength:
        """Return what fixes the scale, among the members."""
        if self.between is None:
            return ScaleLength(None, self.metres or 1.0)
        places = int(members[: self.between[0]].sum()), int(members[: self.between[1]].sum())
        return ScaleLength(places, self.metres or 1.0)
