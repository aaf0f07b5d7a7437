import asyncio
import io
import json
import threading
from types import SimpleNamespace

import numpy as np
import pytest
import viser
from PIL import Image
from scipy.spatial.transform import RigidTransform, Rotation
from tests.runs.changed_task import shipped, written
from tests.viewer.conftest import PATIENCE, settled
from websockets.exceptions import ConnectionClosedError
from websockets.sync.client import connect

from omniservo.cameras import preset
from omniservo.errors import InputError, OmniservoError
from omniservo.planning import Capsule, PlanningProblem, Sphere, plan_path
from omniservo.planning.obstacles.obstacle import KINDS
from omniservo.verification import verify_plan
from omniservo.viewer.along_path import curves_of
from omniservo.viewer.answer import Answer
from omniservo.viewer.image_tab import ImageTab
from omniservo.viewer.new_obstacle import new_obstacle
from omniservo.viewer.obstacle_tab import ObstacleTab
from omniservo.viewer.open_viewed import UPRIGHT, Viewed, open_viewed
from omniservo.viewer.repeating import Repeating
from omniservo.viewer.serve_page import serve_page
from omniservo.viewer.situation import Situation
from omniservo.viewer.status import status_html

POINTS = [[x, y, 0.5] for x in (-0.1, 0.0, 0.1) for y in (-0.1, 0.0, 0.1)]
TURN = RigidTransform.from_components([0.02, 0.0, 0.01], Rotation.from_rotvec([0.0, 0.0, 0.1]))


def test_the_first_answer_is_certified_for_the_whole_arm_by_the_planner(page):
    answer = settled(page)
    assert answer.verdict == "certified"
    assert answer.arm_plan.certified
    assert 'data-verdict="certified"' in page.shown.status.content


def test_a_plan_that_is_said_just_as_waiting_for_it_ends_is_not_called_searched_for_again(page, monkeypatch):
    settled(page)
    monkeypatch.setattr(page._said, "wait", lambda seconds: False)
    page._watch()
    assert 'data-verdict="certified"' in page.shown.status.content
    page._said.clear()
    page._watch()
    assert 'data-verdict="searching"' in page.shown.status.content
    page.replan()


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_an_obstacle_of_every_kind_can_be_added_and_deleted(page, kind):
    number = page.answer.number
    page.edit(lambda situation: situation.with_added(new_obstacle(kind, situation)))
    answer = settled(page, number)
    assert [type(o) for o in answer.situation.problem.obstacles][1:] == [KINDS[kind]]
    assert answer.verdict == "certified"
    page.edit(lambda situation: situation.without(1))
    assert len(settled(page, answer.number).situation.problem.obstacles) == 1


def test_a_number_typed_for_an_obstacle_that_was_deleted_changes_nothing(page, monkeypatch):
    fields = page.server.gui._gui_input_handle_from_uuid.values()
    (field,) = (f for f in fields if getattr(f, "label", "") == "half_extents")
    (typed,) = field._impl.update_cb
    number, refused = page.answer.number, []
    monkeypatch.setattr(page, "_refused", refused.append)
    event = SimpleNamespace(client=1, target=SimpleNamespace(value=(0.1, 0.1, 0.1)))
    changes = {
        (): lambda situation: situation.without(0),
        (Sphere,): lambda situation: situation.with_added(new_obstacle("sphere", situation)),
    }
    for kinds, change in changes.items():
        page.edit(change)
        asyncio.run(typed(event))
        page.replan()  # what was refused has no answer
        answer = settled(page, number)
        assert tuple(map(type, answer.situation.problem.obstacles)) == kinds
        number = answer.number
    assert refused == []


def test_a_moved_handle_is_planned_for_and_the_plan_passes_the_independent_check(page):
    before = page.answer
    handle = page.nodes.handles[0]
    handle.position = np.add(handle.position, [0.0, 0.0, 0.05])
    page.replan()
    answer = settled(page, before.number)
    moved = answer.situation.handles[0].translation - before.situation.handles[0].translation
    assert np.allclose(moved, [0.0, 0.0, 0.05], atol=1e-9)
    assert answer.verdict == "certified"
    verify_plan(answer.plan)


def test_no_path_is_said_with_what_stands_against_it_at_its_place(page):
    number = page.answer.number
    page.edit(lambda situation: situation.with_problem(clearance=0.2))
    answer = settled(page, number)
    assert answer.verdict == "no path"
    assert "clearance obstacle 0" in answer.worst.words
    assert answer.worst.violated
    start, nearest = answer.worst.line
    assert np.allclose(start, answer.situation.world_T_initial.translation)
    gap = answer.situation.problem.obstacles[0].distance(np.zeros((1, 3)))[0]
    assert np.linalg.norm(start - nearest) == pytest.approx(gap, abs=1e-5)
    assert "NO PATH" in page.shown.status.content


def test_an_edit_that_is_not_legal_is_refused_in_words_and_the_page_lives_on(page):
    number = page.answer.number
    page.edit(lambda situation: situation.with_problem(clearance=-1.0))
    with page._changed:
        assert page._changed.wait_for(lambda: "REFUSED" in page.shown.status.content, PATIENCE)
    assert "clearance: -1 given" in page.shown.status.content
    page.edit(lambda situation: situation.with_problem(clearance=0.002))
    assert settled(page, number).situation.problem.clearance == 0.002


def test_what_is_asked_for_after_a_refused_edit_is_done(page):
    number, busy, go_on = page.answer.number, threading.Event(), threading.Event()

    def hold(situation):
        busy.set()
        assert go_on.wait(PATIENCE)

    page.listeners.append(hold)
    try:
        page.replan()
        assert busy.wait(PATIENCE)  # both edits come while the planner is at work
        page.edit(lambda situation: situation.with_problem(clearance=-1.0))
        page.edit(lambda situation: situation.with_problem(clearance=0.002))
    finally:
        page.listeners.remove(hold)
        go_on.set()
    holds = page.wait_for(lambda answer: answer.situation.problem.clearance == 0.002, PATIENCE)
    assert holds.number > number


def test_the_numbers_of_an_obstacle_are_shown_by_one_thread(page, monkeypatch):
    (tab,) = (
        found for each in page.listeners if isinstance(found := getattr(each, "__self__", None), ObstacleTab)
    )
    show, threads = tab._show_numbers, []

    def noted(situation):
        threads.append(threading.current_thread().name)
        show(situation)

    monkeypatch.setattr(tab, "_show_numbers", noted)
    number = page.answer.number
    page.edit(lambda situation: situation.without(0))
    settled(page, number)
    asyncio.run_coroutine_threadsafe(asyncio.sleep(0.0), page.server.get_event_loop()).result(PATIENCE)
    assert set(threads) == {"planner"}


def test_a_page_that_is_closed_leaves_no_one_waiting_for_its_replay(tmp_path):
    problem = PlanningProblem(preset("fe185"), POINTS, RigidTransform.from_translation([0.05, 0.0, 0.05]))
    busy, go_on, said = threading.Event(), threading.Event(), []

    def hold(situation):
        busy.set()
        assert go_on.wait(PATIENCE)

    def ask():
        try:
            page.replay()
        except InputError as error:
            said.append(str(error))

    asking = threading.Thread(target=ask, daemon=True)
    with serve_page(Viewed("still", Situation(problem, UPRIGHT)), port=8340) as page:
        assert page.settled.wait(PATIENCE)
        page.listeners.append(hold)
        page.replan()
        assert busy.wait(PATIENCE)
        asking.start()
        threading.Thread(target=lambda: (page._closed.wait(PATIENCE), go_on.set()), daemon=True).start()
    asking.join(PATIENCE)
    assert said == ["the page is closed"]


@pytest.mark.parametrize(
    "goal",
    [RigidTransform.identity(), RigidTransform.from_rotation(Rotation.from_rotvec([0.0, 0.0, 0.1]))],
    ids=["no motion", "a turn alone"],
)
def test_a_camera_that_stays_in_its_place_is_planned_for_and_shown(goal):
    viewed = Viewed("still", Situation(PlanningProblem(preset("fe185"), POINTS, goal), UPRIGHT))
    with serve_page(viewed, port=8350) as page:
        assert page.settled.wait(PATIENCE)
        assert page.answer.verdict == "certified"
        assert "CERTIFIED" in page.shown.status.content


def test_nothing_is_moved_while_another_task_takes_the_place_of_what_is_shown(page, monkeypatch):
    answer, reset, failed, movers = settled(page), page.server.scene.reset, [], []

    def move():
        try:
            page.playback._move()
        except Exception as error:
            failed.append(error)

    def reset_while_moved():
        reset()
        movers.append(threading.Thread(target=move))
        movers[0].start()
        movers[0].join(0.2)  # it waits until the new scene is there

    monkeypatch.setattr(page.server.scene, "reset", reset_while_moved)
    page.open(Viewed("no arm", Situation(PlanningProblem(preset("fe185"), POINTS, TURN), UPRIGHT)))
    settled(page, answer.number)
    movers[0].join(PATIENCE)
    assert not failed


def test_what_is_as_small_as_a_grain_is_shown(page):
    problem = PlanningProblem(
        preset("fe185"), 0.01 * np.array(POINTS), RigidTransform.from_translation([5e-4, 0.0, 5e-4]),
        (Capsule([0.003, 0.0, 0.002], [0.003, 0.0, 0.0021], 5e-5),), least_distance=1e-5,
    )  # fmt: skip
    number = page.answer.number
    page.open(Viewed("endoscope", Situation(problem, UPRIGHT)))
    assert settled(page, number).verdict == "certified"


def test_one_servo_goes_on_at_a_time(page):
    with page._serving, pytest.raises(InputError, match="a servo is going on"):
        page.servo()
    page.open(Viewed("no arm", Situation(PlanningProblem(preset("fe185"), POINTS, TURN), UPRIGHT)))
    settled(page, page.answer.number)
    for _ in range(2):  # one that is refused is over
        with pytest.raises(InputError, match="there is no task"):
            page.servo()


@pytest.mark.slow
def test_a_servo_of_what_was_shown_before_is_not_shown_in_what_was_opened_since(page, tmp_path):
    """A slow camera: images take most of the time."""
    never, number, document = threading.Event(), page.answer.number, shipped("whole-arm-1")
    document["sensor"]["rate"] = 4
    page.open(open_viewed(written(tmp_path, document)))
    number = settled(page, number).number
    serving = threading.Thread(target=page.servo)
    serving.start()
    while page.playback.moment is None:
        assert serving.is_alive()
        never.wait(0.02)
    page.open(Viewed("no arm", Situation(PlanningProblem(preset("fe185"), POINTS, TURN), UPRIGHT)))
    settled(page, number)
    place = page.shown.w.value
    while serving.is_alive():
        assert page.playback.moment is None
        never.wait(0.02)
    assert page.playback.run is None
    assert page.shown.w.value == place
    assert "converged" in page.shown.job.content


def test_an_exception_in_a_callback_is_a_message(page):
    said = []
    page.shown.message, before = lambda title, text: said.append(text), page.shown.message
    try:
        page.in_background(lambda event: 1 / 0)(None)
    finally:
        page.shown.message = before
    assert said == ["ZeroDivisionError: division by zero"]


def test_curves_keep_above_what_is_certified(page):
    curves = {curve.title: curve for curve in curves_of(settled(page))}
    assert set(curves) == {
        "camera to obstacles",
        "points to image limits",
        "joints to their limits",
        "links to bodies",
    }
    for curve in curves.values():
        assert curve.certified is not None
        assert np.nanmin(curve.values) >= curve.certified - 1e-6
        assert curve.certified >= curve.required - 1e-6


def shown(page, plan, path):
    """The answer that a plan file gives."""
    path.write_text(json.dumps(plan))
    number = page.answer.number
    page.open(open_viewed(path))
    return settled(page, number)


def test_a_plan_file_is_shown_certified_only_where_it_and_the_planner_say_so(page, tmp_path):
    plan = plan_path(open_viewed("whole-arm-1").situation.problem).to_dict()
    assert shown(page, plan, tmp_path / "plan.json").verdict == "certified"
    assert shown(page, {**plan, "status": "undecided"}, tmp_path / "other.json").verdict == "no path"
    nearer = {**plan, "problem": {**plan["problem"], "clearance": 0.07}}
    answer = shown(page, nearer, tmp_path / "false.json")
    assert answer.verdict == "no path"
    assert "judged again: clearance obstacle 0" in answer.reason


def test_the_replay_is_one_file_without_outside_references(page):
    text = page.replay()
    assert "srcdoc=" in text
    assert 'data-verdict="certified"' in text
    assert "http://" not in text.split("<aside>")[1]
    assert len(text) < 5e6


def test_a_thread_that_fails_goes_on():
    failed, worked = [], []

    def work():
        worked.append(1)
        if len(worked) == 1:
            raise ValueError("first")
        repeating._ended = True
        repeating.wake()

    def report(error):
        failed.append(str(error))
        repeating.wake()

    repeating = Repeating("test", work, report)
    repeating.start()
    repeating.wake()
    repeating._thread.join(PATIENCE)
    assert (failed, len(worked)) == (["first"], 2)


def test_an_answer_is_settled_no_more_once_something_was_changed(page):
    before = settled(page)
    assert page.is_settled(before)
    page.replan()
    assert not page.is_settled(before)
    assert settled(page, before.number).request > before.request


def test_viewed_of_another_task_takes_its_place(page):
    number = page.answer.number
    page.open(Viewed("other", open_viewed("paper-example-1").situation))
    answer = settled(page, number)
    assert len(answer.situation.problem.obstacles) == 2
    assert len(page.nodes.handles) == 2


def test_the_sign_says_of_what_the_plan_is_certified(page):
    answer = settled(page)
    begun = Answer(1, answer.situation, answer.camera_plan, searching=True)
    assert begun.verdict == "searching"
    assert "<b>CERTIFIED</b> camera's path; of the whole arm not yet" in status_html(begun)
    longer = Answer(2, answer.situation, answer.camera_plan, answer.arm_plan, searching=True)
    assert "<b>SEARCHING</b>" in status_html(longer)
    alone = Answer(3, answer.situation, answer.camera_plan)
    assert "<b>CERTIFIED</b> camera's path" in status_html(alone)
    assert "<b>CERTIFIED</b> whole arm" in status_html(answer)


def test_another_web_page_is_refused_before_anything_is_sent(page):
    port, version = page.server.get_port(), f"viser-v{viser.__version__}"

    def first_from(origin):
        with connect(f"ws://127.0.0.1:{port}", origin=origin, subprotocols=[version]) as line:
            return line.recv(timeout=PATIENCE)

    assert first_from(f"http://127.0.0.1:{port}")
    assert first_from(None)  # no browser
    for origin in ("http://elsewhere.example", f"http://127.0.0.1:{port + 1}", "null"):
        with pytest.raises(ConnectionClosedError, match="served to itself"):
            first_from(origin)


def image_of(page, w):
    """What the camera sees at a place of the path, as a file that is uploaded."""
    answer = page.answer
    grey = page.playback._view.rendered(answer.situation.world_scene, answer.joints(w))
    content = io.BytesIO()
    Image.fromarray(grey).save(content, format="PNG")
    return SimpleNamespace(name=f"{w}.png", content=content.getvalue())


def plans_at_a_risk(page):
    """An estimate is planned for at a stated risk, until the goal is another one."""
    page.whole_arm = False
    number = page.answer.number
    page.edit(lambda situation: situation.with_risk(0.1))
    answer = settled(page, number)
    page.whole_arm = True
    found = answer.risk_plan
    assert (found.ok, found.risk, answer.verdict) == (True, 0.1, "certified")
    assert found.predicted_bound <= 0.1
    assert answer.plan is found.plan
    assert "at a risk of 10%" in page.shown.status.content
    elsewhere = RigidTransform.from_translation([0.0, 0.001, 0.0]) * answer.situation.world_T_goal
    assert answer.situation.moved(goal=elsewhere).risk == 0.0
    assert answer.situation.with_problem(clearance=0.001).risk == 0.1


@pytest.mark.slow
def test_two_images_become_the_goal_and_the_points(page):
    answer = settled(page)
    start, goal = image_of(page, 0.0), image_of(page, 1.0)
    stated = answer.situation.problem
    gui = page.server.gui
    folder = gui.add_folder("test")
    with folder:
        tab = ImageTab(gui, page)
    tab._moved.value = float(np.linalg.norm(stated.initial_T_goal.translation))
    tab._take("start image", SimpleNamespace(name="<b onclick='x'>.png", content=start.content))
    assert "&lt;b onclick=&#x27;x&#x27;&gt;.png is the start image; the goal" in tab._said.content
    assert "the goal image is missing" in tab._said.content
    tab._take("goal image", goal)
    assert f"{len(stated.points)} points" in tab._said.content
    found = settled(page, answer.number).situation.problem
    apart = found.initial_T_goal.translation - stated.initial_T_goal.translation
    assert 0.0 < np.linalg.norm(apart) < 2e-3
    assert len(found.points) == len(stated.points)
    plans_at_a_risk(page)
    with pytest.raises(OmniservoError):
        tab._take("goal image", SimpleNamespace(name="no.png", content=b"no image"))
    assert "refused" in tab._said.content
    folder.remove()
