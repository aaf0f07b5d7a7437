import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation
from tests.tasks.test_load_task import MINIMAL, written

from omniservo.tasks import Task, load_task, shipped_tasks
from omniservo.tasks.save_task import save_task

ASKEW = RigidTransform.from_components([0.1, -0.2, 0.05], Rotation.from_rotvec([0.3, -0.5, 0.7]))


def holds(box, places):
    """By what the planner is given: half-spaces, whose free side is where the normal points."""
    sides = box.workspace.half_spaces
    return np.all([places @ side.normal > side.offset for side in sides], axis=0)


def with_planning(tmp_path, planning):
    return load_task(written(tmp_path, {**MINIMAL, "planning": planning}))


def assert_same_when_loaded(task, tmp_path):
    path = tmp_path / "saved.yaml"
    save_task(task, path)
    again = load_task(path)
    for name in Task.model_fields:
        assert getattr(again, name) == getattr(task, name), name
    return again


@pytest.mark.parametrize("name", shipped_tasks())
def test_a_saved_task_is_the_same_to_the_last_bit(name, tmp_path):
    assert_same_when_loaded(load_task(name), tmp_path)


def test_a_workspace_holds_the_same_places_stated_in_another_frame(tmp_path):
    fields = {"min": [-300, -200, -100], "max": [300, 200, 400], "rotation_vector": [10, 0, 20]}
    box = with_planning(tmp_path, {"workspace": fields | {"translation": [50, 0, 0]}}).planning.workspace
    places = np.random.default_rng(0).uniform(-0.5, 0.5, (200, 3))
    inside = holds(box, places)
    assert 20 < inside.sum() < 180
    np.testing.assert_array_equal(holds(box.transformed(ASKEW), ASKEW.apply(places)), inside)


def test_a_workspace_that_stands_askew_is_saved_as_it_stands_and_not_its_hull(tmp_path):
    task = with_planning(tmp_path, {"workspace": {"min": [-300, -200, -100], "max": [300, 200, 400]}})
    box = task.planning.workspace
    planning = task.planning.model_copy(update={"workspace": box.transformed(ASKEW).transformed(ASKEW)})
    again = assert_same_when_loaded(task.model_copy(update={"planning": planning}), tmp_path)
    corners = (ASKEW * ASKEW).apply([box.min, box.max])
    sides = again.planning.workspace.workspace.half_spaces
    for corner in corners:
        room = np.array([side.normal @ corner - side.offset for side in sides])
        assert np.sort(np.abs(room))[:3] == pytest.approx([0.0] * 3, abs=1e-12)


def test_a_large_cloud_is_saved_so_that_it_can_be_read(tmp_path):
    points = np.random.default_rng(0).uniform(0.5, 0.9, (11_000, 3))
    np.save(tmp_path / "cloud.npy", points)
    task = with_planning(tmp_path, {"obstacles": [{"type": "cloud", "file": "cloud.npy", "units": "m"}]})
    save_task(task, tmp_path / "saved.yaml")
    (again,) = load_task(tmp_path / "saved.yaml").planning.obstacles
    assert again.points == task.planning.obstacles[0].points
