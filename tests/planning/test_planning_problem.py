"""Problems and their files: round trips, defaults, and one clear message for everything wrong."""

import copy
import json
import math
import pickle
from contextlib import nullcontext
from dataclasses import replace

import cv2
import mujoco
import numpy as np
import pytest
import scipy
import yaml
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.camera_files import load_camera
from omniservo.cameras import preset
from omniservo.cameras.models import Pinhole
from omniservo.errors import InputError
from omniservo.planning import (
    Box,
    Capsule,
    Cloud,
    Cylinder,
    Degrees,
    Ellipsoid,
    HalfSpace,
    Mesh,
    PlanningProblem,
    Sphere,
    Workspace,
    plan_path,
)
from omniservo.planning.search.search import search


def fields() -> dict:
    return {
        "format": "omniservo.problem/1",
        "camera": preset("fe185").to_dict(),
        "points": [[0.0, 0.0, 0.5], [0.1, 0.0, 0.5]],
        "goal": {"translation": [0.1, 0.0, 0.1], "quaternion": [0.0, 0.0, 0.0, 1.0]},
    }


def test_defaults_are_those_of_the_file_format():
    problem = PlanningProblem.from_dict(fields())
    assert problem.obstacles == ()
    assert (problem.clearance, problem.least_distance, problem.visibility_margin) == (0.0, 1e-3, 0.0)
    assert problem.occlusion is False
    assert problem.workspace is None
    assert problem.degrees == Degrees(2, 2)


def test_arrays_of_a_problem_are_read_as_they_are_but_by_two_calls_of_an_older_scipy_that_take_a_copy():
    """What docs/formats.md says of them; where SciPy 1.18 is the least, that sentence can go."""
    problem = PlanningProblem.from_dict(fields())
    points, place, turn = problem.points, problem.goal_translation, Rotation.from_rotvec([0.1, 0.2, 0.3])
    assert not points.flags.writeable
    pixels, _ = cv2.projectPoints(points, np.zeros(3), place, np.eye(3), None)
    assert pixels.shape == (2, 1, 2)
    mujoco.mju_rotVecQuat(np.zeros(3), place, problem.goal_quaternion)
    RigidTransform.from_components(place, Rotation.from_quat(problem.goal_quaternion)).apply(points)
    older = tuple(map(int, scipy.__version__.split(".")[:2])) < (1, 18)  # as there is for Python 3.11
    for call in (turn.apply, Rotation.from_rotvec):
        with pytest.raises(ValueError, match="read-only") if older else nullcontext():
            call(points)
        call(np.array(points))


OBSTACLES = (
    Sphere([0.0, -0.1, 0.2], 0.01),
    Box([0.4, 0.0, 0.1], [0.01, 0.02, 0.03], motion=[[0.1, 0.0], [0.0, 0.0], [0.0, 0.0]]),
    Capsule([0.4, 0.0, 0.1], [0.4, 0.0, 0.2], 0.01),
    Cylinder([0.4, 0.0, 0.1], [0.4, 0.0, 0.2], 0.01),
    Ellipsoid([0.4, 0.0, 0.1], [0.01, 0.02, 0.03]),
    HalfSpace([1.0, 0.0, 0.0], -1.0),
    Mesh([[0.4, 0.0, 0.0], [0.5, 0.0, 0.0], [0.4, 0.1, 0.0], [0.4, 0.0, 0.1]]),
    Cloud([[0.4, 0.0, 0.1], [0.5, 0.0, 0.1]], 0.01),
)


def arrays_in(value):
    """All arrays of a problem and of what it is made of."""
    if isinstance(value, np.ndarray):
        return [value]
    own = type(value).__module__.startswith("omniservo")
    parts = value if isinstance(value, tuple) else vars(value).values() if own else ()
    return [array for part in parts for array in arrays_in(part)]


@pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy, lambda held: pickle.loads(pickle.dumps(held))])  # noqa: S301
def test_nothing_of_a_copied_problem_can_be_changed_behind_the_back_of_its_proof(copied):
    problem = PlanningProblem.from_dict(fields())
    workspace = Workspace(
        min=[-1.0, -1.0, -1.0], max=[1.0, 1.0, 1.0], half_spaces=(HalfSpace([0, 0, 1], -1),)
    )
    camera = Pinhole(300.0, 300.0, 319.5, 239.5, 640, 480)
    for value in (
        replace(problem, obstacles=OBSTACLES, workspace=workspace, initial_velocity=np.zeros(6)),
        camera,
    ):
        assert value is camera or len(value.goal_quaternion) + len(value.goal_translation) == 7
        found = arrays_in(copied(value))
        assert len(found) == len(arrays_in(value)) > 0
        assert not any(array.flags.writeable for array in found)


def test_problems_from_files_and_from_python_are_planned_by_the_same_compiled_code():
    problem = PlanningProblem.from_dict(fields())
    found = plan_path(problem)
    compiled = list(search.signatures)
    again = plan_path(PlanningProblem(problem.camera, problem.points, problem.initial_T_goal))
    assert (again.status, found.status) == ("certified", "certified")
    assert search.signatures == compiled


def test_a_full_problem_survives_the_round_trip_exactly(tmp_path):
    full = fields() | {
        "obstacles": [
            {"type": "sphere", "center": [0.05, 0.1, 0.1], "radius": 0.01, "clearance": 0.02},
            {"type": "sphere", "center": [0.05, -0.1, 0.1], "radius": 0.0},
        ],
        "clearance": 0.055,
        "least_distance": 0.02,
        "visibility_margin": 2.5,
        "occlusion": True,
        "workspace": {"min": [-1, -1, -1], "max": [1, 1, 0.3]},
        "degrees": {"rotation": 3, "translation": 4},
    }
    problem = PlanningProblem.from_dict(full)
    problem.save(tmp_path / "problem.json")
    again = PlanningProblem.load(tmp_path / "problem.json")
    assert again.to_dict() == problem.to_dict()
    assert again.to_dict()["obstacles"] == full["obstacles"]
    assert np.array_equal(again.points, problem.points)
    assert (again.degrees.rotation, again.degrees.translation) == (3, 4)


def test_yaml_reads_the_same_as_json(tmp_path):
    (tmp_path / "p.yaml").write_text(yaml.safe_dump(fields()))
    (tmp_path / "p.json").write_text(json.dumps(fields()))
    as_yaml, as_json = PlanningProblem.load(tmp_path / "p.yaml"), PlanningProblem.load(tmp_path / "p.json")
    assert as_yaml.to_dict() == as_json.to_dict()


def test_a_goal_survives_its_fields_to_the_last_digit():
    for rotation in Rotation.random(200, rng=3):
        goal = RigidTransform.from_components([0.1, 0.2, 0.3], rotation)
        problem = PlanningProblem(preset("fe185"), [[0.0, 0.0, 1.0]], goal)
        again = PlanningProblem.from_dict(problem.to_dict())
        assert again.to_dict() == problem.to_dict()
        assert again.goal_quaternion[3] >= 0.0
        np.testing.assert_allclose(
            again.goal_quaternion, again.initial_T_goal.rotation.as_quat(canonical=True)
        )


def test_a_camera_path_is_relative_to_the_file_and_embedded_when_saved(tmp_path):
    (tmp_path / "cameras").mkdir()
    own = {"format": "omniservo.camera/1", **preset("fe185").to_dict()}
    (tmp_path / "cameras" / "lens.json").write_text(json.dumps(own))
    (tmp_path / "p.json").write_text(json.dumps(fields() | {"camera": "cameras/lens.json"}))
    problem = PlanningProblem.load(tmp_path / "p.json")
    assert problem.camera == load_camera(tmp_path / "cameras" / "lens.json")
    assert problem.to_dict()["camera"]["model"] == "unified"


@pytest.mark.parametrize("path", ["../lens.json", "cameras/../../lens.json", "/etc/lens.json"])
def test_a_camera_path_that_leaves_the_folder_is_refused(tmp_path, path):
    (tmp_path / "inside" / "cameras").mkdir(parents=True)
    (tmp_path / "lens.json").write_text(json.dumps(preset("fe185").to_dict()))
    (tmp_path / "inside" / "p.json").write_text(json.dumps(fields() | {"camera": path}))
    with pytest.raises(InputError, match=r"camera: .*inside the file's folder"):
        PlanningProblem.load(tmp_path / "inside" / "p.json")


def test_a_link_that_leaves_the_folder_is_refused(tmp_path):
    (tmp_path / "inside").mkdir()
    (tmp_path / "lens.json").write_text(json.dumps(preset("fe185").to_dict()))
    (tmp_path / "inside" / "lens.json").symlink_to(tmp_path / "lens.json")
    (tmp_path / "inside" / "p.json").write_text(json.dumps(fields() | {"camera": "lens.json"}))
    with pytest.raises(InputError, match="inside the file's folder"):
        PlanningProblem.load(tmp_path / "inside" / "p.json")


def test_a_camera_path_without_a_folder_is_refused():
    with pytest.raises(InputError, match=r"camera: .*no folder"):
        PlanningProblem.from_dict(fields() | {"camera": "lens.json"})


def sphere(**changes: object) -> dict:
    return {"obstacles": [{"type": "sphere", "center": [0, 0, 1], "radius": 0.1} | changes]}


BAD = {
    "another version": ({"format": "omniservo.problem/2"}, r"format: 'omniservo.problem/2' given; legal"),
    "unknown field": ({"obstacle": []}, r"obstacle: no such field; legal: .*obstacles"),
    "points empty": ({"points": []}, "points: empty"),
    "points not a list": ({"points": 3}, "points: 3 given; a list"),
    "points flat": ({"points": [1.0, 2.0, 3.0]}, r"points: shape \(3,\) given"),
    "points ragged": ({"points": [[0, 0, 1], [0, 1]]}, "points: "),
    "point NaN": ({"points": [[0, 0, math.nan]]}, r"points: nan at index \(0, 2\)"),
    "point far": ({"points": [[0, 0, 1e7]]}, r"points: 1e\+07 given; legal: -1e6 to 1e6"),
    "goal missing part": ({"goal": {"translation": [0, 0, 0]}}, "goal.quaternion: missing"),
    "goal unknown": (
        {"goal": {"translation": [0, 0, 0], "quaternion": [0, 0, 0, 1], "frame": 1}},
        "goal.frame: no such field",
    ),
    "goal not a mapping": ({"goal": [0, 0, 0]}, "goal"),
    "quaternion long": (
        {"goal": {"translation": [0, 0, 0], "quaternion": [0, 0, 0, 1.1]}},
        r"goal.quaternion: length 1.1 given; legal: 1 within 1e-06",
    ),
    "quaternion zero": (
        {"goal": {"translation": [0, 0, 0], "quaternion": [0, 0, 0, 0]}},
        "goal.quaternion: length 0 given",
    ),
    "quaternion short": (
        {"goal": {"translation": [0, 0, 0], "quaternion": [0, 0, 1]}},
        r"goal.quaternion: shape \(3,\) given",
    ),
    "torus": (
        {"obstacles": [{"type": "torus", "file": "a.stl"}]},
        r"obstacles\[0\].type: 'torus' given; legal: 'sphere', 'box'",
    ),
    "no type": ({"obstacles": [{"center": [0, 0, 1], "radius": 1}]}, r"obstacles\[0\].type: None given"),
    "obstacle text": ({"obstacles": ["sphere"]}, r"obstacles\[0\]"),
    "obstacles not a list": ({"obstacles": 1}, "obstacles: 1 given; a list is needed"),
    "negative radius": (sphere(radius=-1), r"obstacles\[0\].radius: -1 given; legal: >= 0"),
    "radius text": (sphere(radius="big"), r"obstacles\[0\].radius: 'big' given"),
    "radius missing": (
        {"obstacles": [{"type": "sphere", "center": [0, 0, 1]}]},
        r"obstacles\[0\].radius: missing",
    ),
    "sphere unknown": (sphere(color="red"), r"obstacles\[0\].color: no such field"),
    "sphere NaN": (sphere(center=[0, math.nan, 0]), r"obstacles\[0\].center: nan at index"),
    "negative clearance of one": (sphere(clearance=-0.1), r"obstacles\[0\].clearance: -0.1 given"),
    "negative clearance": ({"clearance": -1}, "clearance: -1 given; legal: >= 0"),
    "clearance text": ({"clearance": "5 cm"}, "clearance: '5 cm' given; a number"),
    "clearance infinite": ({"clearance": math.inf}, "clearance: inf given"),
    "least distance NaN": ({"least_distance": math.nan}, "least_distance: nan given"),
    "margin negative": ({"visibility_margin": -1}, "visibility_margin: -1 given"),
    "occlusion number": ({"occlusion": 1}, "occlusion: 1 given; legal: true or false"),
    "workspace inverted": (
        {"workspace": {"min": [0, 0, 1], "max": [1, 1, 0]}},
        "workspace: min 1, max 0 given on axis z; legal: min < max",
    ),
    "workspace part": ({"workspace": {"min": [0, 0, 0]}}, "workspace.max: missing"),
    "workspace empty": ({"workspace": {}}, "workspace: empty; legal: min and max, half_spaces"),
    "half-space not unit": (
        {"workspace": {"half_spaces": [{"normal": [0, 0, 2], "offset": 0}]}},
        r"workspace.half_spaces\[0\].normal: length 2 given; legal: 1 within",
    ),
    "half-space with a clearance": (
        {"workspace": {"half_spaces": [{"normal": [0, 0, 1], "offset": 0, "clearance": 0.1}]}},
        r"workspace.half_spaces\[0\].clearance: no such field; legal: normal, offset",
    ),
    "half-spaces many": (
        {"workspace": {"half_spaces": [{"normal": [0, 0, 1], "offset": -1}] * 1001}},
        "workspace.half_spaces: 1001 given; legal: at most 1000",
    ),
    "degree zero": ({"degrees": {"rotation": 0}}, r"degrees.rotation: 0 given; legal: >= 1 and <= 16"),
    "degree half": ({"degrees": {"translation": 2.5}}, "degrees.translation: 2.5 given; a whole number"),
    "degree huge": ({"degrees": {"rotation": 1000}}, "degrees.rotation: 1000 given"),
    "degree unknown": ({"degrees": {"sigma": 2}}, "degrees.sigma: no such field"),
    "camera number": ({"camera": 5}, "camera"),
    "camera field": (
        {"camera": preset("fe185").to_dict() | {"fz": 1.0}},
        "camera: fz: no such field",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_a_wrong_field_is_named_with_what_was_given(name):
    change, message = BAD[name]
    with pytest.raises(InputError, match=message) as caught:
        PlanningProblem.from_dict(fields() | change)
    assert str(caught.value).startswith("problem: ")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["format", "camera", "points", "goal"])
def test_a_missing_field_is_named(name):
    given = fields()
    del given[name]
    with pytest.raises(InputError, match=f"problem: {name}: missing"):
        PlanningProblem.from_dict(given)


def test_more_than_a_hundred_thousand_points_are_refused_at_once():
    with pytest.raises(InputError, match="points: 100001 given; legal: at most 100000"):
        PlanningProblem.from_dict(fields() | {"points": [[0, 0, 1]] * 100_001})


def test_messages_of_a_file_start_with_its_path(tmp_path):
    file = tmp_path / "p.json"
    file.write_text(json.dumps(fields() | {"clearance": -1}))
    with pytest.raises(InputError, match=r"p\.json: clearance: -1 given"):
        PlanningProblem.load(file)
    with pytest.raises(InputError, match="no such file"):
        PlanningProblem.load(tmp_path / "absent.json")


def test_a_quaternion_within_a_millionth_is_normalised_and_its_sign_chosen():
    near = {"translation": [0, 0, 0.1], "quaternion": [0.0, 0.0, 0.6, -0.8 - 5e-7]}
    problem = PlanningProblem.from_dict(fields() | {"goal": near})
    assert abs(np.linalg.norm(problem.goal_quaternion) - 1.0) < 1e-15
    assert problem.goal_quaternion[3] > 0.0
    assert np.allclose(problem.goal_quaternion, [0.0, 0.0, -0.6, 0.8], atol=1e-6)


def test_arrays_of_a_problem_are_read_only():
    read = PlanningProblem.from_dict(fields() | sphere())
    for problem in (read, PlanningProblem(read.camera, read.points, read.initial_T_goal, read.obstacles)):
        ends = problem.goal_translation, problem.goal_quaternion
        for array in (problem.points, problem.obstacles[0].center, *ends):
            with pytest.raises(ValueError, match="read-only"):
                array[0] = 1.0


def test_wrong_python_types_are_refused():
    goal = RigidTransform.from_components([0, 0, 0.1], Rotation.identity())
    points = [[0.0, 0.0, 1.0]]
    for arguments, message in [
        ({"camera": "fe185"}, "camera: str given"),
        ({"initial_T_goal": np.eye(4)}, "initial_T_goal"),
        ({"initial_T_goal": RigidTransform.concatenate([goal, goal])}, "one RigidTransform"),
        ({"obstacles": ([0, 0, 0],)}, r"obstacles\[0\]: list given; legal: Sphere"),
        ({"workspace": ([0, 0, 0], [1, 1, 1])}, "a Workspace or None"),
        ({"degrees": (2, 2)}, "degrees"),
    ]:
        given = {"camera": preset("fe185"), "points": points, "initial_T_goal": goal} | arguments
        with pytest.raises(InputError, match=message):
            PlanningProblem(**given)
    assert Workspace([0, 0, 0], [1, 1, 1]).max[0] == 1.0
    assert Sphere([0, 0, 1]).radius == 0.0
