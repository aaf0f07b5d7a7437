"""A real mouse on the live page: headless Chromium, driven through Playwright."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

CHROMIUM = "/usr/bin/chromium"

_FLAGS = [
    "--disable-gpu", "--enable-unsafe-swiftshader", "--no-sandbox", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
]  # fmt: skip
"""A machine without a GPU: the page is put together by the processor, the scene drawn by SwiftShader."""

_ALONG = 0.75
"""of a handle's arrow, where it is gripped"""


def missing() -> str:
    """Return why there is no browser to drive; empty where there is one."""
    try:
        import playwright.sync_api  # noqa: F401
        import viser  # noqa: F401
    except ImportError as error:
        return f"{error.name} is not installed"
    return "" if Path(CHROMIUM).exists() else f"{CHROMIUM} is not installed"


@contextmanager
def browser() -> Iterator[Any]:
    """Run a headless Chromium without a GPU."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        opened = playwright.chromium.launch(executable_path=CHROMIUM, args=_FLAGS)
        try:
            yield opened
        finally:
            opened.close()


class PageMouse:
    """One window of the live page.

    Args:
        opened: the browser.
        live: the page's `omniservo.viewer.page.Page`, in this process.
        size: of the window [px].
        patience: for everything that the browser does [s].
    """

    def __init__(
        self, opened: Any, live: Any, size: tuple[int, int] = (1280, 720), patience: float = 120.0
    ) -> None:
        self.live, self._patience = live, patience
        self.window = opened.new_page(viewport={"width": size[0], "height": size[1]})
        self.window.set_default_timeout(1e3 * patience)
        self.errors: list[str] = []
        self.window.on("pageerror", lambda error: self.errors.append(str(error)))
        self.window.goto(f"http://127.0.0.1:{live.server.get_port()}/")
        self.window.wait_for_selector("[data-verdict]")
        self.window.wait_for_selector("canvas")
        end = time.monotonic() + patience
        while not self._camera() and time.monotonic() < end:
            self.window.wait_for_timeout(50)

    def close_dialogs(self) -> None:
        """Close what the browser's lack of a GPU makes viser say."""
        for button in self.window.locator(".mantine-Notification-closeButton").all():
            button.click(force=True)

    def verdict(self) -> str:
        """Return what the sign on the page says."""
        return str(self.window.locator("[data-verdict]").first.get_attribute("data-verdict"))

    def update(self) -> int:
        """Return the number of the newest update that the page shows."""
        return int(self.window.locator("[data-verdict]").first.get_attribute("data-update") or -1)

    def shows_newest(self) -> bool:
        """Wait until the window shows the final answer to all that was done; return whether it does."""
        end = time.monotonic() + self._patience
        while time.monotonic() < end:
            newest = self.live.answer
            if newest is not None and self.live.is_settled(newest) and self.update() == newest.number:
                return True
            self.window.wait_for_timeout(20)
        return False

    def place(self, position: np.ndarray) -> tuple[float, float]:
        """Return where a point of the world (3,) [m] is in the window [px]."""
        camera = self._camera()
        turn = Rotation.from_quat(np.asarray(camera.wxyz), scalar_first=True)
        x, y, z = turn.inv().apply(np.asarray(position) - camera.position)
        canvas = self.window.locator("canvas").first.bounding_box()
        focal = 0.5 * canvas["height"] / np.tan(0.5 * camera.fov)
        return (
            float(canvas["x"] + 0.5 * canvas["width"] + focal * x / z),
            float(canvas["y"] + 0.5 * canvas["height"] + focal * y / z),
        )

    def grip(self, handle: Any, axis: int = 0) -> tuple[tuple[float, float], tuple[float, float]]:
        """Return where one of a handle's arrows is gripped, and its direction in the window, both [px]."""
        turn = Rotation.from_quat(np.asarray(handle.wxyz), scalar_first=True)
        tip = np.asarray(handle.position) + turn.apply(handle.scale * np.eye(3)[axis])
        here, there = (np.array(self.place(p)) for p in (handle.position, tip))
        at, along = here + _ALONG * (there - here), there - here
        return (float(at[0]), float(at[1])), (float(along[0]), float(along[1]))

    def begin_drag(self, handle: Any, axis: int = 0) -> tuple[np.ndarray, np.ndarray]:
        """Take a handle by one of its arrows; return where, and the arrow's unit direction [px]."""
        at, along = (np.array(pair) for pair in self.grip(handle, axis))
        self.window.mouse.move(*at)
        self.window.wait_for_timeout(150)
        self.window.mouse.down()
        return at, along / np.linalg.norm(along)

    def drag(self, handle: Any, pixels: float, *, axis: int = 0, steps: int = 8) -> None:
        """Drag a handle along one of its arrows by so many pixels."""
        at, along = self.begin_drag(handle, axis)
        for k in range(1, steps + 1):
            self.window.mouse.move(*(at + along * pixels * k / steps))
        self.window.mouse.up()

    def _camera(self) -> Any:
        clients = list(self.live.server.get_clients().values())
        return clients[-1].camera if clients and clients[-1].camera.update_timestamp else None
