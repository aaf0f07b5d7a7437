"""The page's panels: what is shown beside the scene, and what can be set."""

from __future__ import annotations

from typing import Any

import numpy as np

from omniservo.viewer.end_places import EndPlaces
from omniservo.viewer.file_tab import FileTab
from omniservo.viewer.image_tab import ImageTab
from omniservo.viewer.limit_tab import LimitTab
from omniservo.viewer.obstacle_tab import ObstacleTab
from omniservo.viewer.page import Page, Shown
from omniservo.viewer.status import PLANNING

_LEFT, _RIGHT = 318, 330
"""widths of the panels [px]: at 1280 × 720 px the scene keeps half of the page"""


_STEP = 0.02
"""of w that a key goes"""

_MESSAGE = 20.0
"""[s] for which a message stays"""


def add_panels(server: Any, page: Page) -> Shown:
    """Add both panels: the camera's view with the curves to the left; verdict and settings to the right."""
    gui = server.gui
    _set_theme(gui, dark=False)
    gui.set_panel_label("omniservo")
    side = gui.add_panel()
    with side.add_tab("Camera"):
        view = gui.add_image(np.zeros((8, 12, 3), dtype=np.uint8), format="jpeg", jpeg_quality=85)
        plots = gui.add_html("")
    side.dock_left()
    side.set_width(_LEFT)
    gui.main_panel.dock_right()
    gui.main_panel.set_width(_RIGHT)
    status = gui.add_html(PLANNING)
    w = gui.add_slider(
        "w", 0.0, 1.0, 0.001, 0.0, hint="place on the path; of a run that is played, share of its time"
    )
    w.on_update(page.guarded(lambda event: page.playback.show() if event.client is not None else None))
    play = gui.add_button("Play")
    play.on_click(page.guarded(lambda event: _toggle(page, play)))
    _add_keys(gui, page, play)
    job = gui.add_html("")
    tabs = gui.add_tab_group()
    with tabs.add_tab("Show"):
        _add_choices(gui, page)
    with tabs.add_tab("Obstacles"):
        ObstacleTab(gui, page)
    with tabs.add_tab("Limits"):
        LimitTab(gui, page)
    with tabs.add_tab("Images"):
        ImageTab(gui, page)
    with tabs.add_tab("Files"):
        FileTab(gui, page)

    def message(title: str, text: str) -> None:
        for client in server.get_clients().values():
            client.add_notification(title, text, color="red", auto_close_seconds=_MESSAGE)

    return Shown(status, plots, view, w, job, message)


def _add_choices(gui: Any, page: Page) -> None:
    arm = gui.add_checkbox("whole arm", True, hint="plan for joints and links, too")
    arm.on_update(page.guarded(lambda event: _set_arm(page, bool(arm.value))))
    handles = gui.add_checkbox("handles", True, hint="arrows that start, goal and obstacles are dragged by")
    handles.on_update(page.guarded(lambda event: page.nodes.show_handles(visible=bool(handles.value))))
    page.listeners.append(lambda situation: page.nodes.show_handles(visible=bool(handles.value)))
    run = gui.add_checkbox(
        "play the run", True, hint="what was executed, beside the plan; where there is a run"
    )
    run.on_update(page.guarded(lambda event: _set_run(page, bool(run.value))))
    dark = gui.add_checkbox("dark", False)
    dark.on_update(page.guarded(lambda event: _set_theme(gui, dark=bool(dark.value))))
    servo = gui.add_button("Servo", hint="the whole job in the simulator, as it is here, watched")
    servo.on_click(page.in_background(lambda event: page.servo()))
    EndPlaces(gui, page)


def _add_keys(gui: Any, page: Page, play: Any) -> None:
    """Let keys do what button and slider do; in a field for numbers or text they type.

    Arrows, Home and End belong to a slider that has the focus, and arrows turn the scene.
    """
    playback = page.playback
    keys = {
        "Play or pause": ("space", lambda event: _toggle(page, play)),
        "Forwards": ("L", lambda event: playback.go_to(playback.w + _STEP)),
        "Backwards": ("J", lambda event: playback.go_to(playback.w - _STEP)),
        "To the start": ("0", lambda event: playback.go_to(0.0)),
        "To the goal": ("1", lambda event: playback.go_to(1.0)),
    }
    for label, (key, work) in keys.items():
        gui.add_command(label, hotkey=key).on_trigger(page.guarded(work))


def _toggle(page: Page, button: Any) -> None:
    page.playback.play(not page.playback.playing)
    button.label = "Pause" if page.playback.playing else "Play"


def _set_arm(page: Page, wanted: bool) -> None:
    page.whole_arm = wanted
    page.replan()


def _set_run(page: Page, wanted: bool) -> None:
    page.playback.run_shown = wanted
    page.playback.show()


def _set_theme(gui: Any, *, dark: bool) -> None:
    gui.configure_theme(show_share_button=False, show_logo=False, control_width="large", dark_mode=dark)
