"""Convex meshes: the gap to a hull, kept off, seen past, proven; and their files."""

import itertools
import struct

import numpy as np
import pytest
from quad_cubes import quad_cubes
from scipy.optimize import minimize_scalar
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation
from solids import (
    FINE,
    POINTS,
    asked,
    detour,
    displaced,
    hull_distance,
    margins_of,
    sight_distance,
    true_clearance,
)

from omniservo.errors import InputError
from omniservo.planning import Box, Mesh, Plan, PlanningProblem, certify, plan_path, widened_evenly
from omniservo.planning.constraints.hull_gap import hull_gap
from omniservo.planning.obstacles.hull_shape import convex_hull
from omniservo.verification import verify_plan

CUBE = np.array(list(itertools.product((0.0, 1.0), repeat=3)))
TURN = Rotation.from_quat([0.1, 0.7, -0.1, 0.7])
STONE = np.random.default_rng(8).normal(size=(40, 3))
STONE = STONE / np.linalg.norm(STONE, axis=1, keepdims=True) * [0.06, 0.02, 0.025] + [0.0, -0.05, 0.1]
ACROSS = np.array([[0.0, 0.5, -0.25], [0.1, -0.1, 0.025], [0.0, 0.04, -0.02]])
MESHES = {"stone": Mesh(STONE), "moving stone": Mesh(STONE, motion=ACROSS)}


def gap(vertices, t, h):
    *normal, value, part = hull_gap(convex_hull("vertices", vertices), tuple(t), tuple(h))
    return np.array(normal), value, part


def test_the_gap_is_the_distance_and_pushes_out():
    rng = np.random.default_rng(0)
    meets = 0
    for k in range(200):
        vertices = rng.normal(size=(rng.integers(4, 30), 3)) * rng.uniform(0.05, 1.0, 3)
        if k % 4 == 0:
            vertices = CUBE * rng.uniform(0.1, 1.0, 3)
        t, h = rng.normal(size=(2, 3))
        h = t if k % 7 == 0 else h
        normal, value, part = gap(vertices, t, h)
        assert abs(np.linalg.norm(normal) - 1.0) < 1e-12
        truth = hull_distance(vertices, t, h)
        if value <= 0.0:
            meets += 1
            assert truth < 1e-7
            freed = gap(vertices, *(np.array([t, h]) - 1.000001 * value * normal))[1]
            assert abs(freed) < 1e-5
            continue
        assert abs(value - truth) < 1e-9
        for step in 1e-6 * np.eye(3):
            slope = (gap(vertices, t + step, h)[1] - gap(vertices, t - step, h)[1]) / 2e-6
            if t is not h:
                assert abs(slope - (1.0 - part) * normal @ step * 1e6) < 1e-3
    assert 20 < meets < 180


def test_the_depth_is_the_shortest_way_out():
    """Of a cube: to a face for a point, across for a line through it."""
    rng = np.random.default_rng(1)
    for _ in range(50):
        x = rng.uniform(0.0, 1.0, 3)
        assert abs(gap(CUBE, x, x)[1] + min(x.min(), (1.0 - x).min())) < 1e-9
        through = np.array([x * [1, 1, 0] + [0, 0, -1.0], x * [1, 1, 0] + [0, 0, 2.0]])
        assert abs(gap(CUBE, *through)[1] + min(x[:2].min(), (1.0 - x[:2]).min())) < 1e-9
    corner = gap(CUBE, [-0.5, 0.6, 0.5], [0.6, -0.5, 0.5])
    assert abs(corner[1] + 0.05 * np.sqrt(2.0)) < 1e-9
    assert np.allclose(corner[0], [-np.sqrt(0.5), -np.sqrt(0.5), 0.0])


@pytest.mark.parametrize(
    ("t", "h", "distance"),
    [
        ([0.5, 0.5, 1.0], [0.5, 0.5, 3.0], 0.0),
        ([0.0, 0.0, 0.0], [-1.0, -1.0, -1.0], 0.0),
        ([-1.0, 0.5, 2.0], [2.0, 0.5, 2.0], 1.0),
        ([-1.0, -1.0, 0.0], [-1.0, -1.0, 1.0], np.sqrt(2.0)),
        ([-1.0, 0.5, 1.0 + 1e-9], [2.0, 0.5, 1.0 + 1e-9], 1e-9),
        ([0.5, 0.5, 2.0], [0.5, 0.5, 2.0], 1.0),
        ([2.0, 2.0, 2.0], [3.0, 3.0, 2.0], np.sqrt(3.0)),
    ],
)
def test_touching_and_parallel_segments(t, h, distance):
    assert abs(gap(CUBE, t, h)[1] - distance) < 1e-11
    far = np.array([1e3, -2e3, 5e2])
    assert abs(gap(CUBE + far, t + far, h + far)[1] - distance) < 1e-8


def test_a_box_as_a_mesh_is_the_box():
    box = Box([0.01, -0.05, 0.1], [0.05, 0.012, 0.02], TURN.as_quat())
    corners = TURN.apply((2.0 * CUBE - 1.0) * box.half_extents) + box.center
    path = plan_path(asked(box, occlusion=True)).path
    for bent in (path, detour([0.0, 0.12, 0.0]), detour([0.0, 0.0, 0.0])):
        verdicts, lines = [], []
        for obstacle in (box, Mesh(corners)):
            verdict, certificate = certify(asked(obstacle, occlusion=True), bent)
            verdicts.append(verdict)
            lines.append(margins_of(certificate))
        assert verdicts[0] == verdicts[1]
        assert lines[0].keys() == lines[1].keys()
        for name, margin in lines[0].items():
            assert abs(lines[1][name] - margin) < 1e-9, name


@pytest.mark.parametrize("name", MESHES)
def test_a_mesh_in_the_way_is_avoided_and_its_margin_is_true(name):
    mesh = MESHES[name]
    assert true_clearance(mesh, detour([0.0, 0.0, 0.0])) < 0.01
    problem = asked(mesh, points=POINTS[:2], occlusion=True)
    plan = plan_path(problem)
    assert plan.status == "certified", plan.reason
    assert verify_plan(plan).status == "certified"
    found = margins_of(plan.certificate)
    seen = true_clearance(mesh, plan.path) - problem.clearance
    assert 0.0 <= found["clearance obstacle 0"] <= seen < found["clearance obstacle 0"] + 1e-3
    w = FINE[::50]
    seen = min(
        sight_distance(mesh, t - m, h - m)
        for t, m in zip(plan.path.positions(w), displaced(mesh, w), strict=True)
        for h in problem.points
    )
    assert 0.0 <= found["occlusion obstacle 0"] < seen + 1e-9 < found["occlusion obstacle 0"] + 1e-3
    assert {(s.constraint, s.point) for s in plan.certificate.separators} == {
        ("clearance obstacle 0", None),
        ("occlusion obstacle 0", 0),
        ("occlusion obstacle 0", 1),
    }
    for separator in plan.certificate.separators:
        for start, end, *normal in separator.pieces:
            w = np.linspace(start, end, 5)
            reach = (mesh.vertices @ normal).max() + (problem.clearance if separator.point is None else 0.0)
            far = [] if separator.point is None else [problem.points[separator.point]]
            for x in (plan.path.positions(w), *far):
                assert ((x - displaced(mesh, w)) @ normal).min() >= reach


@pytest.mark.parametrize("name", MESHES)
def test_a_violation_between_samples_is_never_certified(name):
    mesh, path = MESHES[name], detour([0.0, 0.12, 0.12])
    truth = true_clearance(mesh, path)
    assert truth > 1e-3
    for beyond in (1e-3, 1e-6, 1e-9):
        problem = asked(mesh, clearance=truth + beyond)
        verdict, certificate = certify(problem, path)
        assert verdict != "certified"
        plan = Plan(problem, "certified", path, certificate, 0.0, "certified")
        assert verify_plan(plan).status == "refuted"
    for below in (1e-3, 1e-6, 1e-8):
        assert certify(asked(mesh, clearance=truth - below), path)[0] == "certified"


def test_a_point_hidden_between_samples_is_never_certified():
    path, h = detour([0.0, 0.07, -0.02]), np.array([[0.0, 0.15, 0.5]])
    stone = Mesh(STONE)

    def seen(w):
        return sight_distance(stone, path.positions(w), h[0])

    nearest = min(FINE[::50], key=seen)
    near = max(nearest - 0.02, 0.0), min(nearest + 0.02, 1.0)
    truth = minimize_scalar(seen, bounds=near, method="bounded", options={"xatol": 1e-10}).fun
    assert truth > 1e-3
    w_away = path.positions(minimize_scalar(seen, bounds=near, method="bounded").x)
    toward = np.array(gap(STONE, w_away, h[0])[0])
    for moved, expected in ((truth + 1e-5, False), (truth - 1e-5, True)):
        nearer = Mesh(STONE + moved * toward)
        verdict, _ = certify(asked(nearer, points=h, clearance=0.0, occlusion=True), path)
        assert (verdict == "certified") == expected


def test_only_corners_of_the_hull_are_kept_and_read_back_unchanged():
    inside = np.random.default_rng(3).uniform(0.01, 0.99, (500, 3))
    mesh = Mesh(np.concatenate([CUBE[:4], inside, CUBE[4:], [[0.5, 0.5, 0.0]]]) + 0.5)
    assert np.array_equal(mesh.vertices, CUBE + 0.5)
    assert len(mesh.hull.faces) == 6
    assert len(mesh.hull.edges) == 12
    problem = asked(mesh, MESHES["moving stone"])
    again = PlanningProblem.from_dict(problem.to_dict())
    assert again.to_dict() == problem.to_dict()
    with pytest.raises(ValueError, match="read-only"):
        mesh.vertices[0] = 1.0


@pytest.mark.parametrize("vertices", [STONE, CUBE * [1.0, 0.2, 0.01], None], ids=["stone", "plate", "ball"])
def test_a_mesh_made_larger_holds_all_within_so_far(vertices):
    mesh = Mesh(ball(1000) if vertices is None else vertices)
    larger = mesh.grown(0.02)
    normals = np.random.default_rng(0).normal(size=(2000, 3))
    normals = np.vstack([normals, mesh.hull.faces[:, :3], larger.hull.faces[:, :3]])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    reach = [(m.vertices @ normals.T).max(axis=0) for m in (mesh, larger)]
    assert (reach[1] - reach[0]).min() > 0.02 * (1.0 - 1e-9)


def test_lines_of_sight_past_a_mesh_keep_what_a_camera_off_its_path_needs():
    mesh = Mesh(0.06 * (CUBE - 0.5) + [0.0, 0.1, 0.3])
    points = np.array([[0.0, 0.08, 0.6], [0.0, 0.02, 0.6]])
    problem = asked(mesh, points=points, goal=(0.0, 0.0, 0.05), occlusion=True, clearance=0.0)
    path = plan_path(problem).path
    seen = min(sight_distance(mesh, path.positions(w), h) for w in FINE[::200] for h in problem.points)
    for off, verdict in ((0.5 * seen, "certified"), (1.001 * seen, "refuted")):
        assert certify(widened_evenly(problem, off, 0.0), path)[0] == verdict


def ball(count):
    k = np.arange(count) + 0.5
    height, angle = 1.0 - 2.0 * k / count, np.pi * (1.0 + np.sqrt(5.0)) * k
    ring = np.sqrt(1.0 - height**2)
    return np.column_stack([ring * np.cos(angle), ring * np.sin(angle), height])


BAD = {
    "three": (CUBE[:3], "vertices: 3 given; legal: at least 4"),
    "flat": (CUBE[CUBE[:, 2] == 0.0], "vertices: all within 1e-09 m of one plane; a solid is needed"),
    "nearly flat": (CUBE * [1, 1, 1e-12], "vertices: all within 1e-09 m of one plane"),
    "one point": (np.ones((9, 3)), "vertices: all within 0 m of one plane"),
    "on a line": (np.outer(np.arange(9), [1, 2, 3]), "vertices: all within"),
    "NaN": (CUBE * [1, np.nan, 1], r"vertices: nan at index \(0, 1\)"),
    "far": (CUBE * 1e7, "vertices: 1e\\+07 given; legal: -1e6 to 1e6"),
    "two numbers": (CUBE[:, :2], r"vertices: shape \(8, 2\) given"),
    "many corners": (ball(1001), "vertices: a hull of 1001 corners given; legal: at most 1000"),
}


@pytest.mark.parametrize("name", BAD)
def test_wrong_vertices_are_named(name):
    vertices, says = BAD[name]
    fields = asked().to_dict() | {"obstacles": [{"type": "mesh", "vertices": np.asarray(vertices).tolist()}]}
    with pytest.raises(InputError, match=r"obstacles\[0\]\." + says):
        PlanningProblem.from_dict(fields)


def triangles(vertices):
    """Triangles (f, 3, 3) of the hull."""
    return np.asarray(vertices, dtype=float)[ConvexHull(vertices).simplices]


def binary_stl(faces):
    rows = b"".join(struct.pack("<12fH", 0, 0, 0, *np.ravel(face), 0) for face in faces)
    return b"written by a test".ljust(80) + struct.pack("<I", len(faces)) + rows


def text_stl(faces):
    rows = ["facet normal 0 0 0\nouter loop\n" for _ in faces]
    for i, face in enumerate(faces):
        rows[i] += "".join(f"vertex {x!r} {y!r} {z!r}\n" for x, y, z in face.tolist()) + "endloop\nendfacet\n"
    return ("solid part\n" + "".join(rows) + "endsolid part\n").encode()


def obj(faces):
    corners = "".join(f"v {x!r} {y!r} {z!r}\n" for x, y, z in np.reshape(faces, (-1, 3)).tolist())
    indices = "".join(f"f {3 * k + 1} {3 * k + 2} {3 * k + 3}\n" for k in range(len(faces)))
    return ("mtllib /etc/passwd\n" + corners + "usemtl gold\n" + indices).encode()


WRITERS = {"a.stl": binary_stl, "b.stl": text_stl, "c.obj": obj}


def load(folder, name, content, **fields):
    (folder / name).write_bytes(content)
    document = asked().to_dict() | {"obstacles": [{"type": "mesh", "file": name} | fields]}
    return PlanningProblem.from_dict(document, folder=folder)


@pytest.mark.parametrize("corner", ["{0}", "{0}/1", "{0}//1", "{0}/1/1", "{1}"])
def test_faces_of_four_corners_are_read_however_an_obj_names_them(tmp_path, corner):
    places = ([0.0, 0.0, 0.0], [3.0, 0.0, 0.0])
    meshes = load(tmp_path, "quads.obj", quad_cubes(*places, corner=corner).encode()).obstacles
    for mesh, place in zip(meshes, places, strict=True):
        assert sorted(mesh.vertices.tolist()) == sorted(np.add(CUBE, place).tolist())


def test_an_obj_may_begin_with_a_mark_and_break_lines_that_end_in_carriage_returns(tmp_path):
    text = obj(triangles(CUBE)).decode().replace("f ", "f \\\n").replace("\n", "\r\n")
    (mesh,) = load(tmp_path, "windows.obj", text.encode("utf-8-sig")).obstacles
    assert sorted(mesh.vertices.tolist()) == sorted(CUBE.tolist())


@pytest.mark.parametrize("name", WRITERS)
def test_a_file_is_read_placed_and_embedded(tmp_path, name):
    place = {"scale": 0.001, "quaternion": TURN.as_quat().tolist(), "translation": [0.1, 0.2, 0.3]}
    problem = load(tmp_path, name, WRITERS[name](triangles(100.0 * CUBE)), clearance=0.02, **place)
    (mesh,) = problem.obstacles
    assert mesh.clearance == 0.02
    expected = np.add(TURN.apply(0.1 * CUBE), [0.1, 0.2, 0.3])
    assert np.allclose(sorted(mesh.vertices.tolist()), sorted(expected.tolist()), atol=1e-12)
    assert problem.to_dict()["obstacles"][0].keys() == {"type", "vertices", "clearance"}


@pytest.mark.parametrize("name", WRITERS)
def test_separate_parts_are_separate_obstacles(tmp_path, name):
    parts = np.concatenate([triangles(CUBE), triangles(STONE.astype(np.float32)), triangles(CUBE + 2.0)])
    motion = [[0.1, 0.0], [0.0, 0.0], [0.0, 0.0]]
    problem = load(tmp_path, name, WRITERS[name](parts), motion=motion)
    assert sorted(len(m.vertices) for m in problem.obstacles) == [8, 8, 40]
    assert all(np.array_equal(m.motion, motion) for m in problem.obstacles)


NOTCHED = np.array([[0, 0], [3, 0], [3, 1], [1, 1], [1, 3], [0, 3]])


def prism(outline, fan):
    """A prism over an outline that is seen from corner ``fan``."""
    n = len(outline)
    low, high = np.column_stack([outline, np.zeros(n)]), np.column_stack([outline, np.ones(n)])
    k = [(fan + i) % n for i in range(n)]
    caps = [[side[k[0]], side[k[i]], side[k[i + 1]]] for side in (low, high) for i in range(1, n - 1)]
    walls = [[low[i], low[(i + 1) % n], high[i]] for i in range(n)]
    walls += [[low[(i + 1) % n], high[(i + 1) % n], high[i]] for i in range(n)]
    return np.array(caps + walls, dtype=float)


def wrung(outline, angle):
    """A prism whose top is turned: all vertices on the hull, edges not."""
    faces = prism(outline, 0)
    turn = Rotation.from_rotvec([0.0, 0.0, angle])
    return np.where(faces[..., 2:] > 0.5, turn.apply(faces.reshape(-1, 3)).reshape(faces.shape), faces)


def dented(vertices, apex):
    """A hull whose last triangle is replaced by three that meet at an apex inside."""
    *rest, (a, b, c) = sorted(triangles(vertices), key=lambda face: face[:, 2].sum())
    return np.array([*rest, [a, b, apex], [b, c, apex], [c, a, apex]])


TRIANGLE = np.array([[1.0, 0.0], [-0.5, 0.8], [-0.5, -0.8]])
BROKEN = {
    "an L": (
        "l.stl",
        binary_stl(prism(NOTCHED, 0)),
        r"l.stl: part 0 of 1 is not convex: its triangle around \(.*\) lies 0.333 inside .* CoACD",
    ),
    "dented": (
        "d.stl",
        binary_stl(dented(CUBE, [0.5, 0.5, 0.75])),
        r"part 0 of 1 is not convex: its vertex \(0.5, 0.5, 0.75\) lies 0.25 inside its hull",
    ),
    "wrung": ("w.stl", text_stl(wrung(TRIANGLE, -0.5)), "part 0 of 1 is not convex: its triangle around"),
    "open": ("o.stl", binary_stl(triangles(CUBE)[1:]), "part 0 of 1 is not closed: 3 of its 18 edges"),
    "second part open": (
        "s.obj",
        obj(np.concatenate([triangles(CUBE), triangles(CUBE + 2.0)[1:]])),
        "part 1 of 2 is not closed",
    ),
    "no faces": ("e.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\n", "no triangles in it"),
    "empty": ("e.stl", b"", "no triangles in it|not STL"),
    "no triangles": ("n.stl", binary_stl([]), "no triangles in it"),
    "garbage": ("g.stl", bytes(range(256)) * 20, "not STL|no triangles"),
    "garbage text": ("g.obj", b"f a b c\nv x y z\n", "not OBJ|no triangles"),
    "cut text": ("t.stl", text_stl(triangles(CUBE))[:300], "not STL|no triangles"),
    "second solid cut": (
        "c.stl",
        text_stl(triangles(CUBE)) + text_stl(triangles(CUBE + 2.0))[:300],
        "not STL as far as can be read: a solid does not end",
    ),
    "corner 0": ("z.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 0 1 2\n", "not OBJ .* number 0"),
    "corner before the first": (
        "w.obj",
        b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf -5 -2 -1\n",
        "a triangle of vertex -2, counted from 0; there are 3 vertices",
    ),
    "two corners": ("y.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2\n", "not OBJ .* fewer than 3 corners"),
    "bad number": (
        "u.stl",
        text_stl(triangles(CUBE)).replace(b"1.0", b"one", 1),
        "not STL",
    ),
    "huge count": (
        "h.stl",
        binary_stl(triangles(CUBE))[:80] + struct.pack("<I", 2**32 - 1) + binary_stl(triangles(CUBE))[84:],
        "not STL|no triangles",
    ),
    "NaN": ("x.stl", binary_stl(triangles(CUBE) * [1, 1, np.nan]), "every number must be finite"),
    "index beyond": ("i.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "i.obj"),
    "sheet": ("f.stl", binary_stl(np.repeat(triangles(CUBE)[:1], 2, axis=0)), "vertices|part 0 of 1"),
    "other format": ("a.ply", b"ply\n", "'.ply' given; legal: '.stl', '.obj'"),
    "many corners": (
        "m.stl",
        binary_stl(triangles(ball(1200))),
        "a hull of 1200 corners; legal: at most",
    ),
}


@pytest.mark.parametrize("case", BROKEN)
def test_a_file_that_is_no_convex_solid_is_refused_with_the_reason(tmp_path, case):
    name, content, says = BROKEN[case]
    with pytest.raises(InputError, match=says) as caught:
        load(tmp_path, name, content)
    assert str(caught.value).startswith("problem: obstacles[0].file: ")
    assert "\n" not in str(caught.value)


def test_a_file_outside_the_folder_or_too_large_is_refused(tmp_path):
    inner = tmp_path / "inner"
    inner.mkdir()
    (tmp_path / "a.stl").write_bytes(binary_stl(triangles(CUBE)))
    (inner / "link.stl").symlink_to(tmp_path / "a.stl")
    with (inner / "large.stl").open("wb") as file:
        file.truncate(2**25)
    for name, says in [
        ("../a.stl", "inside the file's folder"),
        (str(tmp_path / "a.stl"), "inside the file's folder"),
        ("link.stl", "inside the file's folder"),
        ("large.stl", "33554432 bytes; at most 16777216"),
        ("absent.stl", "no such file"),
        (7, "file: 7 given"),
    ]:
        fields = asked().to_dict() | {"obstacles": [{"type": "mesh", "file": name}]}
        with pytest.raises(InputError, match=r"obstacles\[0\]\.file: .*" + says.removeprefix("file: ")):
            PlanningProblem.from_dict(fields, folder=inner)


def test_fields_of_a_mesh_are_checked(tmp_path):
    cube = binary_stl(triangles(CUBE))
    for fields, says in [
        ({"scale": 0.0}, "scale: 0 given; legal: > 0"),
        ({"scale": float("nan")}, "scale: nan given"),
        ({"quaternion": [0, 0, 0, 2]}, "quaternion: length 2 given"),
        ({"translation": [0, 0]}, "translation: shape"),
        ({"vertices": CUBE.tolist()}, "file: given beside vertices; legal: one of the two"),
        ({"radius": 1}, "radius: no such field"),
        ({"clearance": -1}, "clearance: -1 given"),
    ]:
        with pytest.raises(InputError, match=r"obstacles\[0\]\." + says):
            load(tmp_path, "a.stl", cube, **fields)
    with pytest.raises(InputError, match="scale: no such field"):
        PlanningProblem.from_dict(
            asked().to_dict() | {"obstacles": [{"type": "mesh", "vertices": CUBE.tolist(), "scale": 2.0}]}
        )


def test_the_papers_method_refuses_a_mesh():
    with pytest.raises(InputError, match='method: "paper" given'):
        plan_path(asked(MESHES["stone"]), method="paper")
