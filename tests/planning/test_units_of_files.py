"""Files of meshes and clouds say their unit, and a body that is there in another is told of."""

import json

import numpy as np
import pytest

from omniservo.cameras import preset
from omniservo.cli.main import main
from omniservo.errors import InputError
from omniservo.planning import PlanningProblem, Sphere

BRICK = 0.1 * np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)]) + [0.0, 0.35, 0.1]
SIDES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
METRES = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254}


def problem(folder, obstacle, **more):
    """Return a problem file with this obstacle of a file beside it."""
    fields = {
        "format": "omniservo.problem/1",
        "camera": preset("fe185").to_dict(),
        "points": [[i, j, 0.5] for i in (-0.08, 0.08) for j in (-0.08, 0.08)],
        "goal": {"translation": [0.05, 0.0, 0.1], "quaternion": [0.0, 0.0, 0.0, 1.0]},
        "obstacles": [obstacle],
        **more,
    }
    file = folder / "problem.json"
    file.write_text(json.dumps(fields))
    return file


def write_brick(file, scale):
    """Write it as STL in a unit of which one metre holds ``scale``."""
    text = "solid brick\n"
    for a, b, c, d in SIDES:
        for corners in ((a, b, c), (a, c, d)):
            rows = "\n".join("vertex {} {} {}".format(*map(float, scale * BRICK[i])) for i in corners)
            text += f"facet normal 0 0 0\nouter loop\n{rows}\nendloop\nendfacet\n"
    file.write_text(text + "endsolid brick\n")


@pytest.mark.parametrize("stated", ["units", "scale"])
@pytest.mark.parametrize("unit", METRES)
def test_a_mesh_and_a_cloud_in_any_unit_are_where_they_are_in_metres(unit, stated, tmp_path):
    own = {"units": unit} if stated == "units" else {"scale": METRES[unit]}
    write_brick(tmp_path / "brick.stl", 1.0 / METRES[unit])
    (mesh,) = PlanningProblem.load(problem(tmp_path, {"type": "mesh", "file": "brick.stl", **own})).obstacles
    assert np.allclose(np.sort(mesh.vertices, axis=0), np.sort(BRICK, axis=0), rtol=1e-6)
    np.save(tmp_path / "scan.npy", BRICK / METRES[unit])
    scan = {"type": "cloud", "file": "scan.npy", "radius": 0.01, **own}
    (cloud,) = PlanningProblem.load(problem(tmp_path, scan)).obstacles
    assert np.allclose(cloud.points, BRICK)


@pytest.mark.parametrize("kind", ["mesh", "cloud"])
@pytest.mark.parametrize(
    ("own", "says"),
    [
        ({"units": "mm", "scale": 0.001}, "units, scale: both given; legal: one of the two"),
        ({"units": "furlong"}, "units: 'furlong' given; legal: m, cm, mm, in"),
        ({"units": 3}, "units: 3 given"),
        ({"scale": 0.0}, "scale: 0 given; legal: > 0"),
        ({"scale": "mm"}, "scale: 'mm' given; a number is needed"),
    ],
)
def test_a_unit_that_says_nothing_is_refused(kind, own, says, tmp_path):
    write_brick(tmp_path / "brick.stl", 1.0)
    np.save(tmp_path / "scan.npy", BRICK)
    named = {"mesh": {"file": "brick.stl"}, "cloud": {"file": "scan.npy", "radius": 0.0}}[kind]
    with pytest.raises(InputError, match=r"obstacles\[0\].*" + says):
        PlanningProblem.load(problem(tmp_path, {"type": kind, **named, **own}))


def test_a_mesh_in_millimetres_read_as_metres_is_told_of_by_the_command(tmp_path, capsys):
    write_brick(tmp_path / "brick.stl", 1000.0)
    file = problem(tmp_path, {"type": "mesh", "file": "brick.stl"})
    words = ("brick.stl is 200 m large, 249.9 m from the target", "state units: mm")
    with pytest.raises(SystemExit) as end:
        main(["plan", str(file)])
    told = " ".join(capsys.readouterr().out.split())
    assert end.value.code == 0, "legal, and far from everything"
    assert all(word in told for word in words), told
    with pytest.raises(SystemExit):
        main(["plan", str(file), "--json"])
    (notice,) = json.loads(capsys.readouterr().out)["notices"]
    assert all(word in notice for word in words)
    stated = problem(tmp_path, {"type": "mesh", "file": "brick.stl", "units": "mm"})
    assert PlanningProblem.load(stated).notices == ()


def test_bodies_are_told_of_by_size_and_by_distance_and_by_nothing_else(tmp_path):
    base = PlanningProblem.load(problem(tmp_path, {"type": "sphere", "center": [0, 0.5, 0], "radius": 0.1}))
    assert base.notices == ()
    moving = np.array([[-3.0, 0.0], [0.0, 0.0], [0.0, 0.0]])  # it comes from afar
    for obstacle, count in (
        (Sphere((3.0, 0.0, 0.0), 0.1), 1),
        (Sphere((3.0, 0.0, 0.0), 0.1, motion=moving), 0),
        (Sphere((-20.0, 0.0, 0.0), 19.0), 1),
    ):
        told = PlanningProblem(base.camera, base.points, base.initial_T_goal, (obstacle,)).notices
        assert len(told) == count, told


def test_a_target_and_a_goal_in_millimetres_are_told_of(tmp_path):
    ball = {"type": "sphere", "center": [0, 0.5, 0], "radius": 0.1}
    far = PlanningProblem.load(problem(tmp_path, ball, points=[[80.0, -80.0, 500.0], [0.0, 0.0, 0.4]]))
    assert far.notices == ("the target has coordinates of 500 m; are all lengths in m?",)
    away = {"translation": [0.0, -101.0, 0.1], "quaternion": [0.0, 0.0, 0.0, 1.0]}
    told = PlanningProblem.load(problem(tmp_path, ball, goal=away)).notices
    assert told == ("the goal has coordinates of 101 m; are all lengths in m?",)


def test_a_body_may_be_turned_by_a_rotation_vector_or_not_at_all(tmp_path):
    box = {"type": "box", "center": [0.0, 0.5, 0.1], "half_extents": [0.1, 0.2, 0.3]}
    vector, turned = [0.1, -0.2, 0.3], [0.04975124, -0.09950249, 0.14925373, 0.98257]
    plain, by_vector, by_quaternion = (
        PlanningProblem.load(problem(tmp_path, {**box, **rotation})).obstacles[0].quaternion
        for rotation in (
            {},
            {"rotation_vector": vector},
            {"quaternion": list(turned / np.linalg.norm(turned))},
        )
    )
    assert plain.tolist() == [0.0, 0.0, 0.0, 1.0]
    assert np.allclose(by_vector, by_quaternion, atol=1e-3)
    goal = {"translation": [0.0, 0.0, 0.1], "rotation_vector": vector}
    asked = PlanningProblem.load(problem(tmp_path, box, goal=goal))
    assert np.allclose(asked.initial_T_goal.rotation.as_rotvec(), vector)
    both = {**box, "rotation_vector": vector, "quaternion": [0, 0, 0, 1]}
    with pytest.raises(InputError, match=r"obstacles\[0\].quaternion, rotation_vector: both given"):
        PlanningProblem.load(problem(tmp_path, both))
    with pytest.raises(InputError, match=r"goal\.rotation_vector: 1e\+300 given; legal: -1e6 to 1e6"):
        PlanningProblem.load(problem(tmp_path, box, goal={**goal, "rotation_vector": [1e300, 0, 0]}))
