"""What the path must keep, and through which camera: sliders."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, TypeAlias

from omniservo.planning import Degrees
from omniservo.viewer.page import Page
from omniservo.viewer.situation import Situation, with_xi

Change: TypeAlias = Callable[[Situation, Any], Situation]
"""From a situation and a slider's value to the situation with it"""

_MOST_CLEARANCE, _MOST_MARGIN = 0.15, 60.0

_MOST_XI = 2.5

_MOST_RISK = 20.0
"""[%]"""

_HIGHEST = 8
"""degree"""


class LimitTab:
    """Sliders for the problem's numbers.

    Args:
        gui: viser's, within the tab.
        page: whose situation is changed.
    """

    def __init__(self, gui: Any, page: Page) -> None:
        self._page = page
        problem = page.situation.problem
        most = 1e3 * max(_MOST_CLEARANCE, 2.0 * problem.clearance)
        self._clearance = gui.add_slider("clearance [mm]", 0.0, most, 0.5, 1e3 * problem.clearance)
        most = max(_MOST_MARGIN, 2.0 * problem.visibility_margin)
        self._margin = gui.add_slider("visibility [px]", 0.0, most, 0.5, problem.visibility_margin)
        sigma, tau = problem.degrees.rotation, problem.degrees.translation
        self._rotation = gui.add_slider("degree rot.", 1, max(_HIGHEST, sigma), 1, sigma)
        self._translation = gui.add_slider("degree transl.", 1, max(_HIGHEST, tau), 1, tau)
        xi = problem.camera.xi
        hint = "0: perspective; the middle of the image stays as large"
        self._xi = gui.add_slider("ξ", 0.0, max(_MOST_XI, xi), 0.01, xi, hint=hint)
        hint = "no obstacle between camera and any target point"
        self._occlusion = gui.add_checkbox("no occlusion", problem.occlusion, hint=hint)
        hint = "of an estimate's error; 0: it is taken as exact. For the folder of a run, or two images"
        self._risk = gui.add_slider("risk [%]", 0.0, _MOST_RISK, 0.5, 100.0 * page.situation.risk, hint=hint)
        changes: tuple[tuple[Any, Change], ...] = (
            (self._clearance, lambda s, v: s.with_problem(clearance=1e-3 * v)),
            (self._margin, lambda s, v: s.with_problem(visibility_margin=v)),
            (self._rotation, lambda s, v: s.with_problem(degrees=Degrees(v, s.problem.degrees.translation))),
            (self._translation, lambda s, v: s.with_problem(degrees=Degrees(s.problem.degrees.rotation, v))),
            (self._xi, lambda s, v: s.with_problem(camera=with_xi(s.problem.camera, v))),
            (self._occlusion, lambda s, v: s.with_problem(occlusion=v)),
            (self._risk, lambda s, v: s.with_risk(v / 100.0)),
        )
        for slider, change in changes:
            slider.on_update(page.guarded(partial(self._set, change=change)))
        page.listeners.append(self.follow)

    def follow(self, situation: Situation) -> None:
        """Show the numbers that count now."""
        problem = situation.problem
        for slider, value in (
            (self._clearance, 1e3 * problem.clearance),
            (self._margin, problem.visibility_margin),
            (self._rotation, problem.degrees.rotation),
            (self._translation, problem.degrees.translation),
            (self._xi, problem.camera.xi),
            (self._occlusion, problem.occlusion),
            (self._risk, 100.0 * situation.risk),
        ):
            if abs(slider.value - value) > 1e-9:
                if not isinstance(value, bool) and value > slider.max:
                    slider.max = value
                slider.value = value

    def _set(self, event: Any, *, change: Change) -> None:
        if event.client is not None:  # not what `follow` has set
            value = event.target.value
            self._page.edit(lambda situation: change(situation, value))
