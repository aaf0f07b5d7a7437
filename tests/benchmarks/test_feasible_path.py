"""The search that says, without this project's planner, whether a study's scene has a solution."""

from dataclasses import replace

import numpy as np
import pytest

from omniservo.planning import Sphere
from omniservo.studies.load_study import study_of_json
from omniservo.studies.study_scene import draw_scene

pytest.importorskip("ompl", reason="ompl, of requirements-bench.lock, is not installed")

from benchmarks import feasible_path

STUDY = """{"format": "omniservo.study/1", "name": "near", "scenes": 9, "units": {"angle": "deg"},
  "cameras": ["fe185"], "methods": ["pbvs"], "arms": ARMS,
  "start": {"rotation": 30, "distance_ratio": 1.2}}"""


def scene_with(arms):
    study = study_of_json(STUDY.replace("ARMS", f'"{arms}"'))
    return draw_scene(study, 0, study.cameras["fe185"])


@pytest.fixture(scope="module")
def scene():
    return scene_with("none")


@pytest.mark.parametrize("arms", ["none", "ur5e"])
def test_a_free_scene_has_a_path_and_the_search_finds_one(arms):
    assert feasible_path.has_path(scene_with(arms), 20.0)


@pytest.mark.parametrize(("gap", "found"), [(0.0, False), (0.15, True)])
def test_a_thin_wall_between_start_and_goal_lets_a_path_through_its_gap_alone(scene, gap, found):
    space, legal, ends = feasible_path._of_poses(scene)
    goal = ends[1][:3]
    across = goal / np.linalg.norm(goal)

    def walled(place):
        along = place[:3] @ across
        beside = np.linalg.norm(place[:3] - along * across)
        return legal(place) and (abs(along - 0.5 * np.linalg.norm(goal)) > 0.004 or beside < gap)

    assert all(map(walled, ends))
    assert feasible_path._searched(space, walled, ends, 20.0 if found else 1.0) is found


def test_a_place_counts_that_sees_all_points_and_is_clear_of_every_ball(scene):
    def behind(gap):
        return replace(scene, obstacles=(Sphere([0.0, 0.0, -0.02 - gap], 0.02),))

    here, turned = np.eye(3), np.diag([1.0, -1.0, -1.0])
    between = replace(scene, obstacles=(Sphere(0.5 * scene.points[0], 0.01),))
    assert feasible_path.sees_all(scene, here, np.zeros(3))
    assert not feasible_path.sees_all(scene, turned, np.zeros(3))
    assert not feasible_path.sees_all(between, here, np.zeros(3))
    assert feasible_path.sees_all(behind(1.01 * scene.clearance), here, np.zeros(3))
    assert not feasible_path.sees_all(behind(0.99 * scene.clearance), here, np.zeros(3))
