"""Files: loaded into the page, and handed out by it. Nothing is written on the server's own disk."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from omniservo.camera_files.named_camera import named_model
from omniservo.cameras import PRESETS
from omniservo.errors import InputError
from omniservo.tasks.save_task import task_text
from omniservo.viewer.edited_task import edited_task
from omniservo.viewer.open_viewed import open_viewed
from omniservo.viewer.page import Page
from omniservo.viewer.situation import Situation

_STATED, _OTHER = "as stated", "another"
"""beside the presets' names: a camera from a file, or with another ξ"""

_LARGEST = 64 * 2**20
"""[bytes] of a file that is taken"""


class FileTab:
    """Buttons that load and save.

    Args:
        gui: viser's, within the tab.
        page: what is loaded into, and saved of.
    """

    def __init__(self, gui: Any, page: Page) -> None:
        self._page = page
        load = gui.add_upload_button("Open task, plan or problem", hint="YAML or JSON")
        load.on_upload(page.in_background(self._open))
        self._preset = gui.add_dropdown("camera", (_STATED, _OTHER, *PRESETS))
        self._preset.on_update(page.in_background(self._take_preset))
        camera = gui.add_upload_button("Camera from file", hint="a calibration file of any supported format")
        camera.on_upload(page.in_background(self._take_camera))
        for label, name, make in (
            ("Save task", "task.yaml", self._task),
            ("Save problem", "problem.json", self._problem),
            ("Save plan", "plan.json", self._plan),
            ("Save replay", "replay.html", page.replay),
        ):
            button = gui.add_button(label)
            button.on_click(page.in_background(partial(self._hand_out, name=name, make=make)))
        page.listeners.append(self.follow)

    def follow(self, situation: Situation) -> None:
        """Show which camera counts now."""
        known = {_STATED: self._page.stated_camera, **PRESETS}
        name = next((name for name, camera in known.items() if camera == situation.camera), _OTHER)
        if self._preset.value != name:
            self._preset.value = name

    def _open(self, event: Any) -> None:
        with written(event.target.value) as path:
            viewed = open_viewed(path)
        self._page.open(viewed)

    def _take_camera(self, event: Any) -> None:
        with written(event.target.value) as path:
            camera = named_model(path)
        self._page.edit(lambda situation: situation.with_problem(camera=camera))

    def _take_preset(self, event: Any) -> None:
        if event.client is None:  # what `follow` has set
            return
        name = str(event.target.value)
        camera = self._page.stated_camera if name == _STATED else PRESETS.get(name)
        self._page.edit(lambda now: now if camera is None else now.with_problem(camera=camera))

    def _task(self) -> str:
        return task_text(edited_task(self._page.situation))

    def _problem(self) -> str:
        return json.dumps(self._page.situation.problem.to_dict(), indent=1) + "\n"

    def _plan(self) -> str:
        answer = self._page.answer
        if answer is None:
            raise InputError("there is no plan yet")
        return json.dumps(answer.plan.to_dict(), indent=1) + "\n"

    def _hand_out(self, event: Any, *, name: str, make: Any) -> None:
        event.client.send_file_download(f"{self._page.name}-{name}", make().encode(), save_immediately=True)


@contextmanager
def written(file: Any) -> Iterator[Path]:
    """Yield an uploaded file on the disk, as readers want it; messages name it as the user does."""
    if len(file.content) > _LARGEST:
        raise InputError(f"{file.name}: {len(file.content)} bytes given; legal: at most {_LARGEST}")
    with tempfile.TemporaryDirectory(prefix="omniservo-") as folder:
        path = Path(folder) / Path(file.name).name
        path.write_bytes(file.content)
        try:
            yield path
        except InputError as error:
            said = str(error).replace(f"{folder}/", "")
            raise InputError(said if path.name in said else f"{path.name}: {said}") from None
