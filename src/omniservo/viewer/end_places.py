"""Start and goal as numbers: what their handles do, by keyboard."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.geometry.arrays import FloatArray
from omniservo.viewer.page import Page
from omniservo.viewer.situation import Situation

_DIGITS = 4
"""behind the point, that are shown"""


class EndPlaces:
    """Places [m] and rotation vectors [deg] of start and goal in the world.

    Args:
        gui: viser's.
        page: whose situation is changed.
    """

    def __init__(self, gui: Any, page: Page) -> None:
        self._page = page
        self._fields: dict[tuple[str, str], Any] = {}
        with gui.add_folder("Start and goal, in the world"):
            for end in ("start", "goal"):
                for unit, step in (("m", 0.001), ("deg", 0.5)):
                    field = gui.add_vector3(f"{end} [{unit}]", (0.0, 0.0, 0.0), step=step)
                    field.on_update(page.guarded(partial(self._set, end=end)))
                    self._fields[end, unit] = field
        page.listeners.append(self.follow)
        self.follow(page.situation)

    def follow(self, situation: Situation) -> None:
        """Show where both are."""
        for end in ("start", "goal"):
            for unit, numbers in _numbers(situation, end).items():
                field, shown = self._fields[end, unit], np.round(numbers, _DIGITS)
                if not np.array_equal(field.value, shown):
                    field.value = tuple(shown.tolist())

    def _set(self, event: Any, *, end: str) -> None:
        if event.client is None:  # what `follow` has set
            return
        typed = {unit: np.array(self._fields[end, unit].value) for unit in ("m", "deg")}

        def change(situation: Situation) -> Situation:
            numbers = {
                unit: np.where(typed[unit] == np.round(now, _DIGITS), now, typed[unit])
                for unit, now in _numbers(situation, end).items()
            }
            turn = Rotation.from_rotvec(numbers["deg"], degrees=True)
            pose = RigidTransform.from_components(numbers["m"], turn)
            return situation.moved(start=pose) if end == "start" else situation.moved(goal=pose)

        self._page.edit(change)


def _numbers(situation: Situation, end: str) -> dict[str, FloatArray]:
    """Return place and rotation vector of the start or the goal, by their units."""
    pose = situation.world_T_initial if end == "start" else situation.world_T_goal
    return {"m": pose.translation, "deg": pose.rotation.as_rotvec(degrees=True)}
