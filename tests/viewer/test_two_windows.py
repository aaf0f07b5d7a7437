"""What is opened, dragged and recorded at the same time."""

import asyncio
import threading
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation
from tests.viewer.conftest import PATIENCE, settled

from omniservo.cameras import PRESETS, preset
from omniservo.planning import Box, PlanningProblem, Sphere
from omniservo.viewer.new_obstacle import new_obstacle
from omniservo.viewer.open_viewed import UPRIGHT, Viewed, open_viewed
from omniservo.viewer.situation import Situation

POINTS = [[x, y, 0.5] for x in (-0.1, 0.0, 0.1) for y in (-0.1, 0.0, 0.1)]
AHEAD = RigidTransform.from_translation([0.0, 0.0, 0.05])
DOWN = RigidTransform.from_components([0.0, 0.0, 1.0], Rotation.from_rotvec([np.pi, 0.0, 0.0]))


def element(page, label):
    """The page's element of this name."""
    (found,) = (
        each
        for each in page.server.gui._gui_input_handle_from_uuid.values()
        if getattr(each, "label", "") == label
    )
    return found


def problem(pose=UPRIGHT):
    return Viewed("no arm", Situation(PlanningProblem(preset("fe185"), POINTS, AHEAD), pose))


def opened(page, viewed):
    number = page.answer.number
    page.open(viewed)
    return settled(page, number)


def edited(page, change):
    number = page.answer.number
    page.edit(change)
    return settled(page, number)


def test_whoever_reads_while_an_obstacle_is_deleted_finds_each_where_it_is(page, monkeypatch):
    before = edited(page, lambda now: now.with_added(new_obstacle("sphere", now))).situation
    places = dict(zip(map(type, before.problem.obstacles), before.handles, strict=True))
    put, found, readers = page.nodes._put_handles, [], []

    def read():
        try:
            found.append(page.situation)
        except Exception as error:
            found.append(error)

    def put_and_read(situation):
        readers.append(threading.Thread(target=read))
        readers[0].start()
        readers[0].join(0.2)  # it waits until base and handles are those of one situation
        put(situation)

    monkeypatch.setattr(page.nodes, "_put_handles", put_and_read)
    edited(page, lambda now: now.without(0))
    readers[0].join(PATIENCE)
    assert [type(obstacle) for obstacle in found[0].problem.obstacles] == [Sphere]
    assert np.allclose(found[0].handles[0].as_matrix(), places[Sphere].as_matrix())
    assert not np.allclose(places[Sphere].as_matrix(), places[Box].as_matrix())


def test_a_drag_that_ends_after_something_else_was_opened_changes_nothing(page):
    nodes, number = page.nodes, opened(page, problem()).number
    for phase in ("start", "end"):
        asyncio.run(nodes._on_drag(SimpleNamespace(phase=phase, target=nodes._goal)))
    assert settled(page, number).verdict == "certified"
    assert not page.nodes._goal.disable_axes


def test_handles_that_are_hidden_stay_hidden_in_what_is_opened(page):
    box = element(page, "handles")
    box.value = False
    try:
        opened(page, problem())
        assert page.nodes._start.disable_axes
    finally:
        box.value = True
    opened(page, problem())
    assert not page.nodes._start.disable_axes


@pytest.mark.slow
def test_the_camera_that_is_named_is_the_one_that_counts(page):
    drop, stated = element(page, "camera"), page.situation.camera
    (choose,) = drop._impl.update_cb

    def chosen(name):
        number = page.answer.number
        drop.value = name
        choose(SimpleNamespace(client=1, target=drop))
        return settled(page, number).situation.camera

    assert chosen("perspective") == PRESETS["perspective"] != stated
    assert chosen("another") == PRESETS["perspective"]
    assert drop.value == "perspective"
    assert chosen("as stated") == stated
    chosen("perspective")
    opened(page, open_viewed("whole-arm-1"))
    assert drop.value == "as stated"
    edited(page, lambda now: now.with_problem(camera=PRESETS["hyper-catadioptric"]))
    assert drop.value == "hyper-catadioptric"


@pytest.mark.slow
def test_what_is_played_waits_for_a_replay_and_goes_on(page, monkeypatch):
    playback, show, held = page.playback, page.nodes.show_camera, []

    def noted(pose):
        if threading.current_thread().name == "planner":
            held.append(playback.moving.locked())
        show(pose)

    monkeypatch.setattr(page.nodes, "show_camera", noted)
    playback.play(True)
    try:
        page.replay()
        assert playback.playing
    finally:
        playback.play(False)
        playback.go_to(0.0)
    assert held
    assert all(held)


def test_a_camera_that_looks_straight_down_is_shown_from_the_side(page):
    opened(page, problem(DOWN))
    view = page.server.initial_camera
    aside = np.subtract(view.position, view.look_at)
    assert np.linalg.norm(aside[:2]) > 0.5 * np.linalg.norm(aside)
