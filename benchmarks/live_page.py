"""The live page under a real mouse in headless Chromium: delays, memory, and the images in the docs.

    python -m benchmarks.live_page                     delays, and Python's part of an update
    python -m benchmarks.live_page --minutes 4         and memory over so long a drag
    python -m benchmarks.live_page --images docs/images      the screenshots of docs/live-page.md

A delay is from the browser's own mouse event to the change of the sign on the page with the new plan's
number; the line of the path is in the same message.
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

_WATCH = """() => {
  window.seen = {moves: [], signs: []};
  addEventListener('pointermove', e => window.seen.moves.push(performance.now()), true);
  new MutationObserver(() => {
    const sign = document.querySelector('[data-update]');
    if (!sign) return;
    const last = window.seen.signs.at(-1), data = sign.dataset;
    const now = [+data.update, data.stage, performance.now()];
    if (!last || last[0] !== now[0]) window.seen.signs.push(now);
  }).observe(document.body, {subtree: true, childList: true, attributes: true, characterData: true});
}"""


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
            mouse.window.wait_for_timeout(500)
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
    mouse.window.evaluate("() => { window.seen.moves = []; window.seen.signs = []; }")
    for times in (live.timings.plans, live.timings.publishing):
        times.clear()
    at, along = mouse.begin_drag(live.nodes.handles[0], 2)
    for k in range(steps):
        mouse.window.mouse.move(*(at + along * 30.0 * np.sin(2.0 * np.pi * k / 20.0)))
        mouse.window.wait_for_timeout(250)
    mouse.window.mouse.up()
    mouse.window.wait_for_timeout(500)
    seen = mouse.window.evaluate("() => window.seen")
    found = [_delay(move, seen["signs"], stage) for move in seen["moves"][1:]]
    delays = [delay for delay in found if delay is not None]
    plans, updates = (1e3 * np.array(times) for times in (live.timings.plans, live.timings.publishing))
    print(
        f"{stage}: {len(found)} moves, {len(delays)} followed; move to new plan on the page "
        f"{_spread(delays)}; camera's plan {_spread(plans)}; Python's part of an update {_spread(updates)}"
    )


def _delay(move: float, signs: list[Any], stage: str) -> float | None:
    """Return the time from a mouse move to the plan for where it led [ms]; None: there is none.

    With the arm every place has two numbers, the camera's plan and the arm's: what follows the last number
    before the move at once may be the arm's plan for the place before.
    """
    last = max((number for number, _, t in signs if t <= move), default=0)
    least = last + (2 if stage == "arm" else 1)
    return next((t - move for number, what, t in signs if what == stage and number >= least), None)


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
        live.shown.w.value = 0.5
        live.show_at()
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
        live.shown.w.value = 0.6
        live.show_at()
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
