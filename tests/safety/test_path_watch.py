"""A camera that the joints have beside its path is stopped; one that lags or leads on it is not."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.cameras import preset
from omniservo.errors import InputError
from omniservo.planning import PlanningProblem, plan_path
from omniservo.safety import OffPath, SafetyOptions
from omniservo.safety.path_watch import PathWatch
from omniservo.tracking import PathTracker

ROOM = 0.01
BASE_T_START = RigidTransform.from_components([0.4, -0.2, 0.7], Rotation.from_rotvec([0.3, -1.2, 0.5]))


@pytest.fixture(scope="module")
def tracker():
    points = np.array([0.0, 0.0, 0.6]) + np.random.default_rng(0).uniform(-0.1, 0.1, (8, 3))
    goal = RigidTransform.from_components([0.12, -0.05, 0.1], Rotation.from_rotvec([0.1, 0.3, -0.2]))
    problem = PlanningProblem(preset("fe185"), points, goal)
    return PathTracker(plan_path(problem), preset("fe185"))


def row(pose):
    return np.concatenate([pose.rotation.as_quat(), pose.translation])


def watched(tracker, initial_T_camera):
    """A watch over a robot whose joints, in a base frame of its own, have the camera there after 1 s."""
    places = {0.0: BASE_T_START, 1.0: BASE_T_START * initial_T_camera}
    return PathWatch(tracker, lambda time: row(places[time]), ROOM)


@pytest.mark.parametrize("w", [0.0, 0.2, 0.9, 1.0])
def test_every_place_of_the_path_is_on_it_whenever_the_camera_is_there(tracker, w):
    watched(tracker, tracker.legs[0].path(w)).check(1.0)


@pytest.mark.parametrize(("beside", "stops"), [(0.9, False), (1.1, True), (9.0, True)])
@pytest.mark.parametrize("w", [0.4, 1.0])
def test_a_camera_farther_from_the_path_than_the_room_is_stopped_by_name(tracker, beside, stops, w):
    path = tracker.legs[0].path
    along = path(w, order=1)[:3] if w < 1.0 else np.array([0.0, 0.0, 1.0])
    here = path(w)
    aside = np.cross(here.rotation.apply(along), [1.0, 0.0, 0.0])
    if w == 1.0:  # beyond the end
        aside = np.array(here.translation)
    off = RigidTransform.from_translation(beside * ROOM * aside / np.linalg.norm(aside)) * here
    watch = watched(tracker, off)
    if not stops:
        watch.check(1.0)
        return
    with pytest.raises(OffPath, match=r"mm off its path; the path keeps 10 mm free") as stop:
        watch.check(1.0)
    assert stop.value.reason == "off_path"


def test_the_room_is_stated_as_a_length():
    with pytest.raises(InputError, match="path_room"):
        SafetyOptions(path_room=-0.01)
    with pytest.raises(InputError, match="path_room"):
        SafetyOptions(path_room=float("nan"))
