"""The list of obstacles: added, changed by numbers, deleted."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from omniservo.planning.obstacles.obstacle import KINDS, Obstacle
from omniservo.viewer.file_tab import written
from omniservo.viewer.new_obstacle import new_obstacle, obstacles_of_file
from omniservo.viewer.page import Page
from omniservo.viewer.situation import Situation

_NONE = "none"

_UNCHANGED = 1e-9


class ObstacleTab:
    """Lists the obstacles of the page's situation, and shows the numbers of one of them.

    Args:
        gui: viser's, within the tab.
        page: whose situation is changed.
    """

    def __init__(self, gui: Any, page: Page) -> None:
        self._gui, self._page = gui, page
        self._kind = gui.add_dropdown("kind", tuple(KINDS))
        self._on(gui.add_button("Add").on_click, self._add)
        upload = gui.add_upload_button("Add from file", hint="mesh, point cloud, problem; in m")
        upload.on_upload(page.in_background(self._load))
        self._chosen = gui.add_dropdown("obstacle", (_NONE,))
        self._on(self._chosen.on_update, self._choose)
        self._folder = gui.add_folder("in the initial camera frame [m]")
        self._fields: dict[str, Any] = {}
        self._numbers: tuple[int, str] | None = None
        """the obstacle whose fields are shown, and its kind"""
        self._on(gui.add_button("Delete", color="red").on_click, self._delete)
        page.listeners.append(self.follow)
        self.follow(page.situation)

    def follow(self, situation: Situation) -> None:
        """List what there is now, and show its numbers."""
        before, obstacles = self._index, situation.problem.obstacles
        names = tuple(f"{i}: {kind_of(o)}" for i, o in enumerate(obstacles)) or (_NONE,)
        if tuple(self._chosen.options) != names:
            self._chosen.options = names
            self._chosen.value = names[min(before or 0, len(names) - 1)]
        self._show_numbers(situation)

    def _choose(self, event: Any) -> None:
        if event.client is not None:  # not what `follow` has set, by the thread that plans
            self._show_numbers(self._page.situation)

    @property
    def _index(self) -> int | None:
        value = str(self._chosen.value)
        return None if value == _NONE else int(value.split(":")[0])

    def _show_numbers(self, situation: Situation) -> None:
        """Show what can be set of the chosen obstacle: new fields for another one, else new values."""
        i, obstacles = self._index, situation.problem.obstacles
        chosen = None if i is None or i >= len(obstacles) else obstacles[i]
        numbers = None if i is None or chosen is None else (i, kind_of(chosen))
        if numbers != self._numbers:
            for field in self._fields.values():
                field.remove()
            self._fields, self._numbers = {}, numbers
            if numbers is not None and chosen is not None:
                with self._folder:
                    self._fields = dict(self._new_fields(numbers[0], chosen))
        elif chosen is not None:
            for attribute, field in self._fields.items():
                value = _shown(getattr(chosen, attribute))
                if np.abs(np.subtract(field.value, value)).max() > _UNCHANGED:
                    field.value = value

    def _new_fields(self, i: int, obstacle: Obstacle) -> Iterator[tuple[str, Any]]:
        """Yield attribute and field of every number; what is turned is turned by its handle."""
        named = {
            **{attribute: name for name, attribute in obstacle.FIELDS.items()},
            "clearance": "own clearance",
        }
        for attribute, name in named.items():
            value = _shown(getattr(obstacle, attribute))
            hint = "−1: the problem's" if attribute == "clearance" else None
            if np.shape(value) == (3,):
                field = self._gui.add_vector3(name, value, step=0.001)
            elif np.ndim(value) == 0:
                field = self._gui.add_number(name, value, step=0.001, hint=hint)
            else:
                continue  # quaternions, and the points of meshes and clouds
            place = i, kind_of(obstacle), attribute
            self._on(field.on_update, lambda event, place=place: self._set(place, event))
            yield attribute, field

    def _set(self, place: tuple[int, str, str], event: Any) -> None:
        if event.client is None:  # what `follow` has set
            return
        i, kind, attribute = place
        value = event.target.value
        if attribute == "normal":
            value = np.array(value) / max(float(np.linalg.norm(value)), 1e-12)
        if attribute == "clearance" and value < 0.0:
            value = None

        def change(situation: Situation) -> Situation:
            obstacles = situation.problem.obstacles
            if i >= len(obstacles) or kind_of(obstacles[i]) != kind:
                return situation  # it was deleted before its fields were
            obstacle = obstacles[i]
            return situation.with_obstacle(i, replace(obstacle, **{attribute: value}))

        self._page.edit(change)

    def _add(self, event: Any) -> None:
        kind = str(self._kind.value)
        self._put(lambda situation: (new_obstacle(kind, situation),))

    def _load(self, event: Any) -> None:
        with written(event.target.value) as path:
            found = obstacles_of_file(path)
        self._put(lambda situation: found)

    def _put(self, made: Any) -> None:
        def change(situation: Situation) -> Situation:
            for obstacle in made(situation):
                situation = situation.with_added(obstacle)
            return situation

        self._page.edit(change)

    def _delete(self, event: Any) -> None:
        i = self._index
        if i is not None:
            self._page.edit(lambda situation: situation.without(i))

    def _on(self, register: Any, work: Any) -> None:
        register(self._page.guarded(work))


def _shown(value: Any) -> Any:
    """Return a value as its field shows it: no own clearance as −1."""
    if value is None:
        return -1.0
    return float(value) if np.ndim(value) == 0 else tuple(np.asarray(value).tolist())


def kind_of(obstacle: Obstacle) -> str:
    """Return what a file calls its kind."""
    return next(name for name, kind in KINDS.items() if type(obstacle) is kind)
