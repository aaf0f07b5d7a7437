"""Images: start and goal are taken from two, and what is shown is handed out as one."""

from __future__ import annotations

import io
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from PIL import Image

from omniservo.errors import InputError, NoSolutionError
from omniservo.geometry.arrays import ByteArray
from omniservo.runs import estimate_images
from omniservo.viewer.file_tab import written
from omniservo.viewer.open_viewed import Viewed
from omniservo.viewer.page import Page
from omniservo.viewer.status import note_html
from omniservo.viewer.uncertain_target import uncertain_target

_FEATURES = ("dots", "tags", "natural")
_TAGS = "36h11"
_START, _GOAL = "start image", "goal image"

_RENDERED = 30.0
"""[s] in which a browser draws the scene once more"""


class ImageTab:
    """Two images become the planning problem, as `omniservo estimate` takes them; buttons save what is shown.

    Args:
        gui: viser's, within the tab.
        page: whose situation is changed, and which is shown.
    """

    def __init__(self, gui: Any, page: Page) -> None:
        self._page = page
        self._images: dict[str, Any] = {}
        self._features = gui.add_dropdown("features", _FEATURES)
        self._dictionary = gui.add_text("tags", _TAGS, hint="their dictionary")
        self._moved = gui.add_number(
            "moved [m]", 0.0, min=0.0, step=0.001, hint="from start to goal; 0: as far as they are apart now"
        )
        for name in (_START, _GOAL):
            load = gui.add_upload_button(name.capitalize(), hint="seen by the page's camera; PNG, JPEG, PGM")
            load.on_upload(page.in_background(partial(self._load, name=name)))
        self._said = gui.add_html(note_html("Both images: goal and points are estimated from them."))
        for label, make in (("Save camera's view", self._view), ("Save scene", self._scene)):
            button = gui.add_button(label)
            button.on_click(page.in_background(partial(self._hand_out, make=make)))

    def _load(self, event: Any, *, name: str) -> None:
        self._take(name, event.target.value)

    def _take(self, name: str, file: Any) -> None:
        self._images[name] = file
        missing = [other for other in (_START, _GOAL) if other not in self._images]
        if missing:
            self._said.content = note_html(f"{file.name} is the {name}; the {missing[0]} is missing.")
            return
        self._said.content = note_html("estimating …")
        try:
            self._said.content = note_html(self._estimated())
        except (InputError, NoSolutionError) as error:
            self._said.content = note_html(f"refused: {error}")
            raise

    def _estimated(self) -> str:
        """Plan for what both images say; return it in words.

        Raises:
            InputError, NoSolutionError: they say nothing.
        """
        situation = self._page.situation
        moved = float(self._moved.value)
        apart = float(np.linalg.norm(situation.problem.initial_T_goal.translation))
        with written(self._images[_START]) as start, written(self._images[_GOAL]) as goal:
            kind = str(self._features.value)
            dictionary = str(self._dictionary.value) if kind == "tags" else None
            found = estimate_images(
                situation.camera, start, goal, features=kind, dictionary=dictionary,  # type: ignore[arg-type]
                displacement=moved if moved > 0.0 else apart,
            )  # fmt: skip
        estimate = found.estimate
        if estimate.status != "ok" or estimate.initial_T_goal is None:
            raise NoSolutionError(f"estimate: {estimate.status}: {estimate.message}")
        points = estimate.points[estimate.inliers]
        changed = situation.with_problem(points=points, initial_T_goal=estimate.initial_T_goal)
        changed = replace(changed, uncertain=uncertain_target(estimate, changed.problem))
        self._page.open(Viewed(self._page.name, changed))
        away = 1e3 * float(np.linalg.norm(estimate.initial_T_goal.translation))
        turned = np.degrees(estimate.initial_T_goal.rotation.magnitude())
        return (
            f"{len(points)} points, rms {estimate.rms_px:.2f} px; "
            f"the goal is {away:.1f} mm and {turned:.1f}° away."
        )

    def _view(self, event: Any) -> tuple[str, ByteArray]:
        answer = self._page.answer
        if answer is None:
            raise InputError("there is no plan yet")
        return "view", self._page.playback.seen(answer)

    def _scene(self, event: Any) -> tuple[str, ByteArray]:
        camera = event.client.camera
        shown = event.client.get_render(
            camera.image_height, camera.image_width, transport_format="jpeg", timeout=_RENDERED
        )
        return "scene", np.asarray(shown[..., :3], dtype=np.uint8)

    def _hand_out(self, event: Any, *, make: Any) -> None:
        name, image = make(event)
        content = io.BytesIO()
        Image.fromarray(image).save(content, format="PNG")
        event.client.send_file_download(
            f"{self._page.name}-{name}.png", content.getvalue(), save_immediately=True
        )
