"""Clouds read from files, as a scanner writes them, and what is wrong with such files."""

import io
import json
import re
import struct
import tracemalloc

import numpy as np
import pytest

from omniservo.cameras import preset
from omniservo.errors import InputError
from omniservo.planning import Plan, PlanningProblem, plan_path
from omniservo.planning.obstacles.cloud_file import read_cloud

CLOUD = np.random.default_rng(3).normal(size=(50, 3)) * 0.02 + [0.2, 0.0, 0.1]


def saved(array):
    stream = io.BytesIO()
    np.save(stream, array)
    return stream.getvalue()


def ply(kind, count=50, properties="xyz", more="", body=None):
    lines = "".join(f"property double {name}\n" for name in properties)
    header = f"ply\nformat {kind} 1.0\ncomment a scan\nelement vertex {count}\n{lines}{more}end_header\n"
    if body is None:
        columns = np.column_stack(
            [CLOUD[:, "xyz".index(n)] if n in "xyz" else CLOUD[:, 0] for n in properties]
        )
        body = columns.astype("<f8").tobytes()
        if kind == "ascii":
            body = "".join(" ".join(map(repr, row)) + "\n" for row in columns.tolist()).encode()
    return header.encode() + body


def rows(points, end="\n"):
    return "".join(" ".join(map(repr, p)) + " 17 0.5" + end for p in points.tolist()).encode()


def problem_in(folder, name, data=None, **changes):
    """A problem file in ``folder`` whose cloud is the file ``name`` beside it."""
    if data is not None:
        (folder / name).write_bytes(data)
    document = {
        "format": "omniservo.problem/1",
        "camera": preset("fe185").to_dict(),
        "points": [[-0.1, -0.1, 0.6], [0.1, 0.1, 0.55]],
        "goal": {"translation": [0.0, -0.1, 0.2], "quaternion": [0, 0, 0, 1]},
        "obstacles": [{"type": "cloud", "file": name, "radius": 0.01} | changes],
    }
    path = folder / "problem.json"
    path.write_text(json.dumps(document))
    return path


FILES = {
    "scan.npy": saved(CLOUD),
    "columnwise.npy": saved(np.asfortranarray(CLOUD)),
    "scan.xyz": b"# x y z intensity ring\n\n" + rows(CLOUD),
    "scan.TXT": rows(CLOUD, "\r\n"),
    "ascii.ply": ply("ascii"),
    "binary.ply": ply("binary_little_endian"),
    "other order.ply": ply("binary_little_endian", properties="qzyx"),
    "with faces.ply": ply("ascii", more="element face 1\nproperty list uchar int vertex_indices\n")
    + b"3 0 1 2\n",
}


@pytest.mark.parametrize("name", FILES)
def test_a_file_gives_its_points_exactly(tmp_path, name):
    problem = PlanningProblem.load(problem_in(tmp_path, name, FILES[name]))
    assert np.array_equal(problem.obstacles[0].points, CLOUD)


def test_single_precision_is_read_as_it_is(tmp_path):
    header = b"ply\nformat binary_little_endian 1.0\nelement vertex 1\n"
    header += b"property uchar red\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
    data = header + struct.pack("<B3f", 7, 0.1, 0.2, 0.3)
    problem = PlanningProblem.load(problem_in(tmp_path, "a.ply", data))
    assert problem.obstacles[0].points.tolist() == np.float32([[0.1, 0.2, 0.3]]).astype(float).tolist()


def test_a_plan_holds_the_points_and_not_the_file(tmp_path):
    problem = PlanningProblem.load(problem_in(tmp_path, "scan.npy", FILES["scan.npy"]))
    (tmp_path / "scan.npy").unlink()
    plan = plan_path(problem)
    plan.save(tmp_path / "plan.json")
    again = Plan.load(tmp_path / "plan.json").problem.obstacles[0]
    assert np.array_equal(again.points, CLOUD)
    assert again.radius == 0.01


def npy(header, body=b""):
    text = header.ljust(117).encode() + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text + body


BROKEN = {
    "holes.npy": (saved(np.where(CLOUD > 0.1, np.nan, CLOUD)), "points: 50 of 50 are not finite, the first"),
    "objects.npy": (saved(np.array([[{}, 1, 2]], dtype=object)), "object of shape"),
    "flat.npy": (saved(CLOUD[:, :2]), r"float64 of shape \(50, 2\) given; real numbers \(p, 3\)"),
    "complex.npy": (saved(CLOUD + 0j), "complex128 of shape"),
    "claims.npy": (
        npy("{'descr': '<f8', 'fortran_order': False, 'shape': (99000, 3), }", b"1234"),
        "4 bytes for 99000 points",
    ),
    "million.npy": (
        npy("{'descr': '<f8', 'fortran_order': False, 'shape': (10**6, 3), }".replace("10**6", "1000000")),
        "1000000 points; legal: 1 to 100000",
    ),
    "negative.npy": (npy("{'descr': '<f8', 'fortran_order': False, 'shape': (-5, 3), }"), "-5 points; legal"),
    "code.npy": (
        npy("{'descr': __import__('os').getcwd(), 'fortran_order': 0, 'shape': (1, 3)}"),
        "not an arr",
    ),
    "garbage.npy": (b"\x00" * 300, "not an array file"),
    "short.xyz": (b"1 2 3\n4 5\n", "line 2: 4 5 given; x y z are needed"),
    "words.xyz": (b"x y z\n1 2 3\n", "line 1: x y z given"),
    "empty.xyz": (b"# nothing\n", "0 points; legal: 1 to 100000"),
    "million.xyz": (b"0 0 1\n" * 1_000_000, "more than 100000 points"),
    "binary.xyz": (b"\xff\xfe\x00", "not a text file"),
    "big.ply": (ply("binary_big_endian", body=b""), "format binary_big_endian; legal: ascii, binary_little"),
    "cut.ply": (ply("binary_little_endian")[:-30], "ends after 48 of 50 vertices"),
    "cut ascii.ply": (ply("ascii", count=60), "ends after 50 of 60 vertices"),
    "million.ply": (ply("ascii", count=1_000_000), "1000000 points; legal"),
    "huge.ply": (ply("ascii", count="9" * 5000), "points; legal: 1 to 100000"),
    "no z.ply": (ply("ascii", properties="xyq"), "a vertex has no x, y and z"),
    "list.ply": (ply("ascii", more="property list uchar int z\n"), "not a property of a vertex that is read"),
    "headless.ply": (b"ply\nformat ascii 1.0\n", "not a PLY file"),
    "scan.pcd": (b"", "scan.pcd: legal: .npy, .xyz, .txt, .ply"),
    "large.xyz": (b"0 0 1\n" * 3_000_000, "18000000 bytes; at most 16777216 are read"),
    "missing.xyz": (None, "no such file"),
    "../outside.xyz": (None, r"'../outside.xyz' given; legal: a relative path inside"),
    "/etc/hostname": (None, "legal: a relative path inside"),
    "null\0.xyz": (None, "legal: a relative path inside"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_file_is_refused_by_name_in_bounded_time_and_memory(tmp_path, name):
    data, says = BROKEN[name]
    path = problem_in(tmp_path, name, data)
    tracemalloc.start()
    with pytest.raises(InputError) as caught:
        PlanningProblem.load(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert str(caught.value).startswith(f"{path}: obstacles[0].")
    assert re.search(says, str(caught.value)), str(caught.value)
    assert peak < 150e6


@pytest.mark.slow
def test_a_million_points_in_the_problem_itself_are_refused_at_once(tmp_path):
    path = problem_in(tmp_path, "scan.npy", FILES["scan.npy"])
    points = "[" + "[0,0,1]," * 999_999 + "[0,0,1]]"
    path.write_text(path.read_text().replace('"file": "scan.npy"', f'"points": {points}'))
    with pytest.raises(InputError, match=r"obstacles\[0\].points: 1000000 given; legal: 1 to 100000"):
        PlanningProblem.load(path)
    path.write_text(path.read_text() + " " * 100_000_000)
    with pytest.raises(InputError, match="bytes; at most 16777216 are read"):
        PlanningProblem.load(path)


FIELDS = {
    "both": ({"points": [[0, 0, 1]]}, "file: given beside points; legal: one of the two"),
    "number": ({"file": 3}, "file: 3 given; a path is needed"),
    "no radius": ({"radius": None}, "radius: None given; a number is needed"),
    "unknown": ({"sacle": 1}, "sacle: no such field"),
}


@pytest.mark.parametrize("name", FIELDS)
def test_a_wrong_field_beside_a_file_is_named(tmp_path, name):
    changes, says = FIELDS[name]
    path = problem_in(tmp_path, "scan.npy", FILES["scan.npy"], **changes)
    with pytest.raises(InputError, match=rf"obstacles\[0\].{says}"):
        PlanningProblem.load(path)


def test_without_a_folder_a_file_is_refused(tmp_path):
    document = json.loads(problem_in(tmp_path, "scan.npy").read_text())
    with pytest.raises(InputError, match="but no folder that it is relative to"):
        PlanningProblem.from_dict(document)


def test_an_array_whose_header_does_not_end_is_refused(tmp_path):
    file = tmp_path / "cloud.npy"
    np.save(file, np.zeros((3, 3)))
    file.write_bytes(
        file.read_bytes().replace(b"}", b" ", 1)
    )  # Python's tokenizer raises an error of its own
    with pytest.raises(InputError, match="not an array file"):
        read_cloud(file)


def test_numbers_that_cannot_be_converted_are_read_without_a_warning(tmp_path):
    file = tmp_path / "cloud.ply"
    header = "ply\nformat binary_little_endian 1.0\nelement vertex 1\n"
    header += "".join(f"property float {axis}\n" for axis in "xyz") + "end_header\n"
    file.write_bytes(header.encode() + bytes.fromhex("0100a07f") * 3)  # NaN that signals
    assert np.isnan(read_cloud(file)).all()
    np.save(tmp_path / "cloud.npy", np.full((1, 3), np.finfo(np.longdouble).max))
    assert np.isinf(read_cloud(tmp_path / "cloud.npy")).all()
