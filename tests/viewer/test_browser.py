"""Real mouse drags in a headless Chromium."""

import numpy as np
import pytest
from benchmarks.page_mouse import PageMouse, browser, missing
from tests.viewer.conftest import PATIENCE, settled

from omniservo.viewer.open_viewed import open_viewed

pytestmark = pytest.mark.skipif(bool(missing()), reason=missing() or "there is a browser")


@pytest.fixture(scope="module")
def opened():
    with browser() as found:
        yield found


def becomes(window, holds):
    """Wait until something holds, while the window goes on; return whether it does."""
    for _ in range(int(PATIENCE / 0.02)):
        if holds():
            return True
        window.wait_for_timeout(20)
    return False


@pytest.mark.slow
def test_keys_go_along_the_path_play_it_and_move_the_goal(page, opened):
    mouse = PageMouse(opened, page, (760, 430), PATIENCE)
    playback, press = page.playback, mouse.window.keyboard.press
    for key, w in (("1", 1.0), ("j", 0.98), ("0", 0.0), ("l", 0.02)):
        press(key)
        assert becomes(mouse.window, lambda wanted=w: playback.w == pytest.approx(wanted)), key
    slider = mouse.window.get_by_role("slider").first
    assert becomes(mouse.window, lambda: float(slider.get_attribute("aria-valuenow")) == pytest.approx(0.02))
    slider.focus()
    press("ArrowRight")
    assert becomes(mouse.window, lambda: playback.w == pytest.approx(0.021))  # a slider's own step
    mouse.window.locator("body").click(position={"x": 5, "y": 425})
    press("Space")
    assert becomes(mouse.window, lambda: playback.playing)
    mouse.window.get_by_role("button", name="Pause").click()
    assert becomes(mouse.window, lambda: not playback.playing)
    press("Space")  # the button has the focus: it is pressed once
    assert becomes(mouse.window, lambda: playback.playing)
    mouse.window.wait_for_timeout(300)
    assert playback.playing
    playback.play(False)
    playback.go_to(0.0)
    before, place = page.situation, np.array(page.nodes._goal.position)
    mouse.window.get_by_label("goal [m]").focus()
    for key in ("ControlOrMeta+a", *f"{place[0] + 0.01:.3f}", "Enter"):
        press(key)
    assert becomes(
        mouse.window, lambda: abs(page.situation.world_T_goal.translation[0] - place[0] - 0.01) < 1e-3
    )
    same = page.situation.world_T_goal.translation[1:] - before.world_T_goal.translation[1:]
    assert np.abs(same).max() < 1e-12  # what was not typed stays, however it is rounded
    assert becomes(mouse.window, lambda: page.nodes._goal.position[0] > place[0] + 0.005)
    mouse.window.close()


@pytest.mark.slow
def test_while_one_handle_is_dragged_the_others_show_no_arrows(page, opened):
    mouse, nodes, blank = PageMouse(opened, page, (760, 430), PATIENCE), page.nodes, opened.new_page()
    others = (nodes._start, nodes._goal)
    for end_it in (mouse.window.mouse.up, mouse.window.close):  # a window that is gone lets go of its handle
        mouse.begin_drag(nodes.handles[0], 2)
        assert becomes(mouse.window, lambda: all(h.disable_axes and h.disable_rotations for h in others))
        assert not nodes.handles[0].disable_axes
        end_it()
        assert becomes(blank, lambda: not any(h.disable_axes or h.disable_rotations for h in others))
    blank.close()


@pytest.mark.slow
def test_a_mouse_drag_moves_an_obstacle_and_the_path_follows_in_two_windows_whatever_happens(page, opened):
    small = (760, 430)
    first = PageMouse(opened, page, small, PATIENCE)
    handle = page.nodes.handles[0]
    place, number = np.array(handle.position), page.answer.number
    first.drag(handle, 40.0, axis=2, steps=4)
    settled(page, number)
    assert first.shows_newest()
    answer = page.answer
    assert np.linalg.norm(np.asarray(handle.position) - place) > 0.01
    assert np.allclose(answer.situation.handles[0].translation, handle.position, atol=1e-6)
    assert first.verdict() == answer.verdict
    second = PageMouse(opened, page, small, PATIENCE)
    assert second.shows_newest()
    assert len(page.server.get_clients()) == 2
    second.window.close()
    first.window.reload()
    first.window.wait_for_selector("[data-verdict]")
    assert first.shows_newest()
    number = page.answer.number
    page.server._websock_server.disconnect_all_clients()
    page.open(open_viewed("whole-arm-1"))
    settled(page, number)
    assert first.shows_newest()
    assert first.window.locator("canvas").count() > 0
    assert first.errors == second.errors == []
    first.window.close()


@pytest.mark.slow
def test_another_plan_is_in_sight_when_it_is_opened_and_its_start_is_where_it_is_dragged(
    page, opened, tmp_path
):
    page.situation.problem.save(tmp_path / "problem.json")
    mouse, number = PageMouse(opened, page, patience=PATIENCE), page.answer.number
    page.open(open_viewed(str(tmp_path / "problem.json")))
    settled(page, number)
    assert mouse.shows_newest()
    start, box = page.nodes._start, mouse.window.locator("canvas").first.bounding_box()
    assert np.allclose(start.position, 0.0)
    seen = np.subtract(mouse.place(np.zeros(3)), (box["x"], box["y"])) / (box["width"], box["height"])
    assert 0.2 < seen.min() < seen.max() < 0.8
    mouse.drag(start, 30.0, axis=2, steps=4)
    assert becomes(mouse.window, lambda: np.linalg.norm(start.position) > 0.005)
    mouse.window.close()


@pytest.mark.slow
def test_a_replay_has_room_for_its_scene_in_a_narrow_window(page, opened, tmp_path):
    (tmp_path / "replay.html").write_text(page.replay())
    window = opened.new_page(viewport={"width": 420, "height": 800})
    window.goto((tmp_path / "replay.html").as_uri())
    for part in ("iframe", "aside"):
        assert window.locator(part).bounding_box()["width"] == 420
    window.evaluate("document.querySelector('h1').textContent = 'x'.repeat(300)")
    assert window.evaluate("document.documentElement.scrollWidth") <= 420
    window.close()
