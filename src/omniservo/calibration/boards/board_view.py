"""What was found of a board in one image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from omniservo.calibration.boards.board import Board
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import FloatArray, IntArray, owned


@with_field_docs
@dataclass(frozen=True)
class BoardView:
    """The points of a board that one image shows, or the reason why there are none."""

    pixels: FloatArray
    """(k, 2) [px]"""
    object_points: FloatArray
    """(k, 3) [m] the same points in the board's frame"""
    ids: IntArray
    """(k,) their rows in ``board.points``, ascending"""
    reason: str = ""
    """why nothing was found; empty where points were found"""
    mirrored: bool | None = None
    """whether the image shows the board's mirror image; None where the board cannot tell because it
    is its own mirror image (checkerboards, circle grids). A mirror image needs one negative focal length"""
    turnable: bool = False
    """whether the board looks the same turned, so that its first point is a choice made for this view"""

    def __post_init__(self) -> None:
        for name in ("pixels", "object_points"):
            object.__setattr__(self, name, owned(getattr(self, name)))
        ids = np.array(self.ids, dtype=np.int64)
        ids.setflags(write=False)
        object.__setattr__(self, "ids", ids)

    def __len__(self) -> int:
        return len(self.pixels)

    @property
    def found(self) -> bool:
        """Whether there are points."""
        return not self.reason

    @classmethod
    def of(
        cls,
        board: Board,
        ids: IntArray,
        pixels: FloatArray,
        *,
        mirrored: bool | None = None,
        turnable: bool = False,
    ) -> BoardView:
        """Return the view of points ``ids`` (k,) of the board, −1 for none, at ``pixels`` (k, 2)."""
        rows = np.flatnonzero(ids >= 0)
        rows = rows[np.argsort(ids[rows], kind="stable")]
        chosen = ids[rows]
        return cls(pixels[rows], board.points[chosen], chosen, mirrored=mirrored, turnable=turnable)

    @classmethod
    def nothing(cls, reason: str) -> BoardView:
        """Return a view without points."""
        return cls(np.zeros((0, 2)), np.zeros((0, 3)), np.zeros(0, dtype=np.int64), reason)
