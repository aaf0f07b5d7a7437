"""The live page under a real mouse in headless Chromium: delays, memory, and the images in the docs.

    python -m benchmarks.live_page                     delays, and Python's part of an update
    python -m benchmarks.live_page --minutes 4         and memory over so long a drag
    python -m benchmarks.live_page --images docs/images      the screenshots of docs/live-page.md

A delay is from the browser's own mouse event to the moment at which the frame with the new path is drawn to
its last pixel: the scene is read back. Each move waits until everything that the one before led to is shown.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from benchmarks.page_mouse import PageMouse, browser, missing
from PIL import Image

from omniservo.planning import Degrees, Sphere
from omniservo.viewer import open_viewed, serve_page
from omniservo.viewer.situation import Situation

_PATIENCE = 300.0

_QUIET = 600.0
"""[ms] after an update, in which arm, view and curves follow it"""

_WATCH = """() => {
  window.seen = {moves: [], signs: [], frames: 0};
  const gl = document.querySelector('canvas[data-engine]').getContext('webgl2'), pixel = new Uint8Array(4);
  addEventListener('pointermove', event => window.seen.moves.push(event.timeStamp), true);
  new MutationObserver(() => {
    const sign = document.querySelector('[data-update]');
    if (!sign || window.seen.signs.at(-1)?.number === +sign.dataset.update) return;
    const shown = {number: +sign.dataset.update, stage: sign.dataset.stage, sign: performance.now()};
    window.seen.signs.push(shown);
    const afterFrame = new MessageChannel();
    afterFrame.port1.onmessage = () => {
      gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
      shown.drawn = performance.now();
    };
    afterFrame.port2.postMessage(0);
  }).observe(document.body, {subtree: true, childList: true, attributes: true, characterData: true});
}"""
"""Notes when the mouse moved, when the sign of each update was there, and when its path was drawn: both are
in one message, which is taken at the beginning of a frame, and reading a pixel waits for all of the frame."""


_DRAWN = """() => new Promise(done => {
  let left = 45;
  const next = () => left-- ? requestAnimationFrame(next) : done();
  next();
})"""
"""Resolves after so many frames: what fades in is there."""


def main() -> None:
    """Measure, or draw."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--task", default="whole-arm-1")
    parser.add_argument("--steps", type=int, default=40, help="mouse moves of a measurement")
    parser.add_argument("--minutes", type=float, default=0.0)
    parser.add_argument("--images", type=Path)
    given = parser.parse_args()
    if missing():
        sys.exit(missing())
    if given.images is not None:
        _draw(given.images)
        return
    print(f"page ready after the command: {_until_ready(given.task):.1f} s")
    with serve_page(open_viewed(given.task), port=8350) as live, browser() as opened:
        live.settled.wait(_PATIENCE)
        mouse = PageMouse(opened, live, (900, 560), _PATIENCE)
        mouse.window.evaluate(_WATCH)
        for stage, whole in (("camera", False), ("arm", True)):
            live.whole_arm = whole
            live.replan()
            mouse.shows_newest()
            mouse.window.wait_for_timeout(_QUIET)
            _measure(live, mouse, stage, given.steps)
        if given.minutes:
            _watch_memory(live, mouse, given.minutes)
        print(f"errors on the page: {len(mouse.errors)}")


def _until_ready(task: str) -> float:
    begin = time.perf_counter()
    command = [sys.executable, "-m", "omniservo.cli.main", "view", task, "--no-browser", "--port", "8351"]
    with subprocess.Popen([*command, "--seconds", "0"], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        process.stdout.readline()
        return time.perf_counter() - begin


def _measure(live: Any, mouse: PageMouse, stage: str, steps: int) -> None:
    """Drag an obstacle to and fro, and print from when to when it took."""
    at, along = mouse.begin_drag(live.nodes.handles[0], 2)
    mouse.window.evaluate("() => { window.seen.moves = []; window.seen.signs = []; }")
    for times in (live.timings.plans, live.timings.publishing):
        times.clear()
    before = _seconds_of(mouse)
    for k in range(1, steps + 1):
        number = live.answer.number
        mouse.window.mouse.move(*(at + along * 30.0 * np.sin(2.0 * np.pi * k / 20.0)))
        live.wait_for(lambda answer, last=number: answer.number > last and live.is_settled(answer), _PATIENCE)
        mouse.shows_newest()
        mouse.window.wait_for_timeout(_QUIET)
    used = (_seconds_of(mouse) - before) / steps
    mouse.window.mouse.up()
    seen = mouse.window.evaluate("() => window.seen")
    firsts = [_first_after(move, seen["signs"], stage) for move in seen["moves"]]
    found = [(move, sign) for move, sign in zip(seen["moves"], firsts, strict=True) if sign is not None]
    plans, updates = (1e3 * np.array(times) for times in (live.timings.plans, live.timings.publishing))
    print(
        f"{stage}: {len(firsts)} moves, {len(found)} followed; from the move to the new path drawn "
        f"{_spread([sign['drawn'] - move for move, sign in found])}, to its sign "
        f"{_spread([sign['sign'] - move for move, sign in found])}; camera's plan {_spread(plans)}; Python's "
        f"part of an update {_spread(updates)}; the browser's processor time for a move {1e3 * used:.0f} ms"
    )


def _first_after(move: float, signs: list[Any], stage: str) -> Any:
    """Return the first sign of a stage after a mouse move; None: there is none."""
    return next((sign for sign in signs if sign["sign"] > move and sign["stage"] == stage), None)


def _seconds_of(mouse: PageMouse) -> float:
    """Return the processor time that all of the browser's processes have used [s]."""
    session = mouse.window.context.browser.new_browser_cdp_session()
    processes = session.send("SystemInfo.getProcessInfo")["processInfo"]
    session.detach()
    return float(sum(process["cpuTime"] for process in processes))


def _watch_memory(live: Any, mouse: PageMouse, minutes: float) -> None:
    end, before, moves = time.monotonic() + 60.0 * minutes, _memory(), 0
    at, along = mouse.begin_drag(live.nodes.handles[0], 2)
    while time.monotonic() < end:
        mouse.window.mouse.move(*(at + along * 30.0 * np.sin(0.3 * moves)))
        moves += 1
    mouse.window.mouse.up()
    print(f"{minutes:g} min of dragging, {moves} moves: {before:.1f} MB before, {_memory():.1f} MB after")


def _memory() -> float:
    """Return this process's resident memory [MB]."""
    status = Path("/proc/self/status").read_text().splitlines()
    return int(next(line for line in status if line.startswith("VmRSS")).split()[1]) / 1024.0


def _spread(milliseconds: Any) -> str:
    if not len(milliseconds):
        return "none"
    median, most = np.percentile(milliseconds, [50, 95])
    return f"{median:.1f} / {most:.1f} ms (median / 95%)"


def _draw(folder: Path) -> None:
    """Take the screenshots of the page that stand in the docs."""
    with serve_page(open_viewed("whole-arm-1"), port=8352) as live, browser() as opened:
        live.settled.wait(_PATIENCE)
        mouse = PageMouse(opened, live, patience=_PATIENCE)
        mouse.close_dialogs()
        live.playback.go_to(0.5)
        _keep(mouse, folder / "live-page-arm.png")
        at, along = mouse.begin_drag(live.nodes.handles[0], 2)
        for k in range(1, 9):
            mouse.window.mouse.move(*(at + along * 8.0 * k))
        _settled(live)
        _keep(mouse, folder / "live-page-drag.png")
        mouse.window.mouse.up()
        number = live.answer.number
        whole_arm = mouse.window.get_by_text("whole arm", exact=True)
        whole_arm.click()
        live.edit(_blocked)
        live.wait_for(lambda answer: answer.number > number and answer.verdict == "no path", _PATIENCE)
        _keep(mouse, folder / "live-page-no-path.png")
        whole_arm.click()
        live.open(open_viewed("whole-arm-1"))
        live.wait_for(lambda found: len(found.situation.handles) == 1 and not found.searching, _PATIENCE)
        live.servo()
        live.playback.go_to(0.6)
        _keep(mouse, folder / "live-page-run.png")
        mouse.window.get_by_role("tab", name="Show").click()
        mouse.window.get_by_text("dark", exact=True).click()
        _keep(mouse, folder / "live-page-dark.png")


def _blocked(situation: Situation) -> Situation:
    """Return it with a ball on the only way that is left: a straight one."""
    there = 0.5 * situation.problem.initial_T_goal.translation
    straight = situation.with_problem(degrees=Degrees(1, 1), occlusion=False)
    return straight.with_added(Sphere(there, 0.02))


def _settled(live: Any, after: int = 0) -> None:
    live.wait_for(lambda answer: answer.number > after and live.is_settled(answer), _PATIENCE)


def _keep(mouse: PageMouse, path: Path) -> None:
    mouse.window.wait_for_timeout(2000)
    mouse.window.evaluate(_DRAWN)
    mouse.window.screenshot(path=path, timeout=1e3 * _PATIENCE)
    image = Image.open(path).convert("RGB").quantize(128, dither=Image.Dither.NONE)
    image.save(path, optimize=True)
    print(f"{path}: {path.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
