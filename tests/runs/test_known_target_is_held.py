"""On the way a structure is refined that two images gave, and not one that is known."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation
from tests.tracking.kinematic_loop import Loop, bent_path, plan_of

from omniservo.run_methods import run_method
from omniservo.runs.controller_of import controller_of
from omniservo.tasks import load_task

TAG = 0.08 * np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])
IN_SIGHT = RigidTransform.from_components([0.0, -0.05, 0.45], Rotation.from_rotvec([0.4, -0.3, 0.1]))
PATH = bent_path((0.06, -0.12, 0.1), bend=(0.08, 0.05, 0.0))


def apart(points):
    return np.linalg.norm(points[:, None] - points[None], axis=2)


@pytest.mark.parametrize(("name", "is_held"), [("tag-board", True), ("paper-example-1", False)])
def test_a_target_of_known_size_keeps_its_shape_on_the_way(name, is_held):
    task, rng = load_task(name), np.random.default_rng(1)
    corners = IN_SIGHT.apply(TAG)
    first, last = (Loop(task.camera, corners, PATH(w), 0.2, rng=rng).look() for w in (0.0, 1.0))
    tracker = controller_of(
        task,
        run_method("certified"),
        plan_of(corners, PATH),
        SimpleNamespace(law=None),
        estimate=None,
        followed=np.arange(4),
        matched=SimpleNamespace(initial=first, goal=last),
    )
    loop = Loop(task.camera, corners, noise=0.2, period=1.0 / 30.0, rng=rng)
    loop.run(tracker, PATH, 4.0)
    off = np.abs(apart(tracker.points) - apart(TAG)).max()
    assert (off < 1e-9) == is_held
