"""What a hand sets is what the situation has, and what counts is what the controls show."""

import asyncio
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform
from tests.viewer.test_two_windows import edited, element

from omniservo.cameras import UnifiedCamera
from omniservo.planning import Box, PlanningProblem, Sphere, plan_path
from omniservo.viewer.camera_view import drawn_obstacles, with_trajectories
from omniservo.viewer.edited_task import edited_task
from omniservo.viewer.new_obstacle import new_obstacle
from omniservo.viewer.obstacle_tab import ObstacleTab
from omniservo.viewer.open_viewed import viewed_task
from omniservo.viewer.uncertain_target import UncertainTarget

LENS = UnifiedCamera(400.0, 400.0, 319.5, 239.5, 0.0, 640, 480)


@pytest.fixture
def changed(served, monkeypatch):
    """Whoever sets a value of an element gets the situation that it makes of another."""
    changes = []
    monkeypatch.setattr(served, "edit", changes.append)

    def situation_of(label, value, situation=served.situation):
        (callback,) = element(served, label)._impl.update_cb
        asyncio.run(callback(SimpleNamespace(client=1, target=SimpleNamespace(value=value))))
        return changes.pop()(situation)

    return situation_of


@pytest.mark.parametrize(
    ("label", "value", "field", "made"),
    [
        ("clearance [mm]", 12.5, "clearance", 0.0125),
        ("visibility [px]", 7.5, "visibility_margin", 7.5),
        ("no occlusion", False, "occlusion", False),
    ],
)
def test_a_limit_that_is_set_is_that_of_the_problem(changed, label, value, field, made):
    assert getattr(changed(label, value).problem, field) == pytest.approx(made)


def test_degrees_xi_and_risk_that_are_set_are_those_of_the_situation(served, changed):
    degrees = served.situation.problem.degrees
    turned, moved = changed("degree rot.", 2).problem.degrees, changed("degree transl.", 5).problem.degrees
    assert (turned.rotation, turned.translation) == (2, degrees.translation)
    assert (moved.rotation, moved.translation) == (degrees.rotation, 5)
    assert changed("ξ", 0.7).problem.camera.xi == 0.7
    estimated = replace(served.situation, uncertain=UncertainTarget(None, np.zeros(0, dtype=np.int64)))
    assert changed("risk [%]", 5.0, estimated).risk == pytest.approx(0.05)


def test_a_limit_beyond_its_slider_is_shown(page):
    page.whole_arm = False
    try:
        edited(page, lambda now: now.with_problem(clearance=0.4, visibility_margin=200.0))
    finally:
        page.whole_arm = True
    for label, value in (("clearance [mm]", 400.0), ("visibility [px]", 200.0)):
        slider = element(page, label)
        assert slider.value == pytest.approx(value)
        assert slider.max >= slider.value


def test_numbers_of_an_obstacle_are_taken_as_they_are_meant(served, changed):
    assert changed("own clearance", 0.02).problem.obstacles[0].clearance == 0.02
    assert changed("own clearance", -1.0).problem.obstacles[0].clearance is None
    (tab,) = (t for each in served.listeners if isinstance(t := getattr(each, "__self__", None), ObstacleTab))
    wall, made = served.situation.with_added(new_obstacle("half_space", served.situation)), []
    tab._page = SimpleNamespace(edit=made.append)
    try:
        event = SimpleNamespace(client=1, target=SimpleNamespace(value=(0.0, 3.0, 4.0)))
        tab._set((1, "half_space", "normal"), event)
    finally:
        tab._page = served
    assert np.allclose(made[0](wall).problem.obstacles[1].normal, [0.0, 0.6, 0.8])


def test_a_saved_task_has_the_limits_that_were_set(served):
    situation = served.situation.with_problem(clearance=0.011, visibility_margin=7.5, occlusion=False)
    again = viewed_task(edited_task(situation)).situation.problem
    assert again.clearance == pytest.approx(0.011)
    assert (again.visibility_margin, again.occlusion) == (7.5, False)


def test_what_lies_within_the_margin_of_the_image_s_edge_is_tinted():
    points = [[x, y, 0.5] for x in (-0.05, 0.05) for y in (-0.05, 0.05)]
    goal = RigidTransform.from_translation([0.01, 0.0, 0.0])
    plan = plan_path(PlanningProblem(LENS, points, goal, visibility_margin=60.0))
    shown = with_trajectories(np.full((480, 640), 200, dtype=np.uint8), plan, 0.0)
    scale = shown.shape[1] / 640
    for u, tinted in ((30, True), (50, True), (70, False), (320, False), (575, False), (590, True)):
        red, green, _ = shown[round(scale * 100), round(scale * u)].astype(int)
        assert (red > green + 20) == tinted, u


def test_what_is_nearer_hides_what_is_behind_it():
    ball, plate = Sphere([0.0, 0.0, 0.6], 0.05), Box([0.0, 0.0, 0.4], [0.1, 0.1, 0.001])
    goal, shades = RigidTransform.from_translation([0.01, 0.0, 0.0]), {}
    for name, obstacles in (("ball", (ball,)), ("both", (ball, plate)), ("turned", (plate, ball))):
        problem = PlanningProblem(LENS, [[0.0, 0.0, 1.0]], goal, obstacles)
        drawn = drawn_obstacles(problem, RigidTransform.identity())
        shades[name] = np.ptp(drawn[200:280, 280:360].astype(int))
    assert shades["ball"] > 20
    assert shades["both"] == shades["turned"] == 0  # the plate's face alone


def test_a_number_that_is_typed_leaves_those_beside_it_as_they_are_however_they_are_rounded(served, changed):
    place, field = served.situation.world_T_goal, element(served, "goal [m]")
    before = field.value
    try:
        field.value = (0.45, *before[1:])
        moved = changed("goal [m]", None).world_T_goal
    finally:
        field.value = before
    assert moved.translation[0] == pytest.approx(0.45, abs=1e-12)
    assert np.abs(moved.translation[1:] - place.translation[1:]).max() < 1e-12
    assert (moved.rotation.inv() * place.rotation).magnitude() < 1e-12
