"""What is no file, or one that would not end, is refused at once by everything that reads files."""

import contextlib
import json
import logging
import os
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from omniservo.calibration.hand_eye import load_hand_eye
from omniservo.camera_files import load_camera
from omniservo.camera_files.mask_image import load_mask
from omniservo.errors import InputError
from omniservo.estimation import TwoViewEstimate
from omniservo.files import MOST_YAML_VALUES, parse_document, read_document, read_text
from omniservo.files.image_files import read_grey_image, read_image
from omniservo.files.mesh_files import read_triangles
from omniservo.files.ros_packages import RosPackages
from omniservo.planning import Plan, PlanningProblem
from omniservo.planning.obstacles.cloud_file import read_cloud
from omniservo.robots import TrackingTube, load_arm
from omniservo.shipped_tasks import task_file
from omniservo.targets import Target
from omniservo.tasks import TaughtGoal, load_task

READERS = {
    "document": read_document,
    "camera": load_camera,
    "mask": lambda path: load_mask(path, (640, 480)),
    "estimate": TwoViewEstimate.load,
    "picture": read_image,
    "grey picture": read_grey_image,
    "plan": Plan.load,
    "problem": PlanningProblem.load,
    "arm": load_arm,
    "tube": TrackingTube.load,
    "target": Target.load,
    "goal": TaughtGoal.load,
    "task": load_task,
    "cloud": read_cloud,
    "mesh": read_triangles,
}
ENDINGS = {"arm": ".urdf", "cloud": ".ply", "mesh": ".stl"}


def no_files(folder: Path, ending: str) -> list[Path]:
    """Return a folder, a pipe, links to devices, into nothing and to themselves, and a name with a zero."""
    (folder / f"folder{ending}").mkdir()
    os.mkfifo(folder / f"pipe{ending}")
    links = {"zero": "/dev/zero", "tty": "/dev/tty", "nothing": "absent", f"loop{ending}": f"loop{ending}"}
    for name, there in links.items():
        (folder / f"{name.removesuffix(ending)}{ending}").symlink_to(there)
    return [*sorted(folder.iterdir()), folder / f"a\0b{ending}", folder / f"{'long' * 100}{ending}"]


@pytest.mark.parametrize("reader", READERS)
def test_what_is_no_file_is_refused_in_one_line_by_every_reader(reader, tmp_path):
    for path in no_files(tmp_path, ENDINGS.get(reader, ".json")):
        with pytest.raises(InputError) as refusal:
            READERS[reader](path)
        assert "\n" not in str(refusal.value)


@pytest.mark.parametrize("reader", READERS)
def test_a_huge_file_is_refused_by_every_reader_before_it_is_read(reader, tmp_path):
    path = tmp_path / f"huge{ENDINGS.get(reader, '.json')}"
    with path.open("wb") as stream:
        stream.truncate(2**30)  # of holes: it takes no room
    with pytest.raises(InputError, match="at most .* are read"):
        READERS[reader](path)


def test_a_file_that_says_it_is_empty_is_read_no_further_than_allowed():
    said = Path("/proc/self/environ")
    if not said.is_file() or len(said.read_bytes()) <= 8:
        pytest.skip("this system has no files that hold more than they say")
    with pytest.raises(InputError, match="at most"):
        read_text(said, max_bytes=8)


@pytest.mark.slow
def test_yaml_of_many_values_is_refused_after_so_many_and_json_may_have_more():
    values = "1, " * (MOST_YAML_VALUES + 1)
    with pytest.raises(InputError, match="^file: more than 30000 values of YAML; JSON may have more"):
        parse_document(f"a: [{values}]", "file")
    assert len(parse_document(f"[{values[:-2]}]", "file")) == MOST_YAML_VALUES + 1


def test_yaml_numbers_are_decimal_and_none_takes_long():
    assert parse_document("a: [1:30, 0x10, 010, 1_000]", "file") == {"a": ["1:30", "0x10", 10.0, "1_000"]}
    sixties = "1" + ":11" * 300_000  # as a number to the base 60: half a minute
    assert parse_document(f"a: {sixties}", "file") == {"a": sixties}
    almost = "1" * 300_000 + "x"  # hours, where a number's digits can be parted in two ways
    assert parse_document(f"a: {almost}", "file") == {"a": almost}


def test_a_picture_is_read_by_formats_that_run_nothing(tmp_path):
    script = tmp_path / "picture.png"
    script.write_bytes(b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n%%EndComments\nshowpage\n")
    with pytest.raises(InputError, match="not an image; legal: PNG, JPEG"):
        read_image(script)


def test_what_is_said_of_a_broken_stl_does_not_go_to_standard_error(tmp_path, caplog):
    corners = "vertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n"
    facets = f"facet normal 0 0 0\nouter loop\n{corners}endloop\nendfacet\n" * 12
    (tmp_path / "part.stl").write_text(f"solid part\n{facets.replace('0 0 0', 'x 0', 1)}endsolid part\n")
    with contextlib.suppress(InputError):
        read_triangles(tmp_path / "part.stl")
    said = [record.name for record in caplog.records]
    assert said == ["trimesh.util"], "this file is one of those of which something is said"
    assert logging.getLogger("trimesh").handlers, "without one of its own, Python's last resort writes it"


@pytest.mark.parametrize("name", ["vertex holder", "vertex 1 2 3", "Vertex", "endsolid", "solidworks"])
def test_the_name_of_a_solid_is_no_part_of_its_shape(name, tmp_path):
    corners = "vertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n"
    facet = f"facet normal 0 0 1\nouter loop\n{corners}endloop\nendfacet\n"
    (tmp_path / "part.stl").write_text(f"solid {name}\n{facet}endsolid {name}\n" * 2)
    vertices, triangles = read_triangles(tmp_path / "part.stl")
    assert vertices.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0]] * 2
    assert triangles.tolist() == [[0, 1, 2], [3, 4, 5]]


def test_the_header_of_a_binary_stl_is_no_solid_s_name(tmp_path):
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], dtype="<f4")
    record = bytes(12) + corners.tobytes() + bytes(2)
    (tmp_path / "part.stl").write_bytes(b"solid part".ljust(80) + (1).to_bytes(4, "little") + record)
    vertices, triangles = read_triangles(tmp_path / "part.stl")
    assert vertices.tolist() == corners.tolist()
    assert triangles.tolist() == [[0, 1, 2]]


@pytest.mark.parametrize("name", ["..", ".", "", "a/b", "a\0b"])
def test_a_package_is_named_by_a_folder_s_name(name, tmp_path):
    (tmp_path / "robot").mkdir()
    (tmp_path / "part.stl").write_text("solid\nendsolid\n")
    with pytest.raises(InputError, match="legal: the name of a folder"):
        RosPackages(tmp_path / "robot/arm.urdf").find("mesh", name, "part.stl")


@pytest.mark.parametrize("reader", ["target", "hand-eye", "task"])
def test_a_quaternion_whose_square_is_no_number_is_refused_without_a_warning(reader, tmp_path):
    path, turn = tmp_path / "file.yaml", {"quaternion": [1e200, 0.0, 0.0, 1.0]}
    if reader == "target":
        tag = {"dictionary": "tag36h11", "id": 3, "edge": 0.05, **turn}
        fields, read = {"format": "omniservo.target/1", "tags": [tag]}, Target.load
    elif reader == "hand-eye":
        pose = {"translation": [0, 0, 0], **turn}
        fields = {"format": "omniservo.hand_eye/1", "flange_T_camera": pose, "covariance": np.eye(6).tolist()}
        read = load_hand_eye
    else:
        fields, read = read_document(task_file("paper-example-1")), load_task
        fields["teach"]["initial_T_goal"] = {"translation": [0, 0, 1], **turn}
    path.write_text(json.dumps(fields))
    with pytest.raises(InputError, match=r"norm 1e\+200"):
        read(path)


def test_yaml_in_braces_is_yaml_and_only_json_files_must_be_json(tmp_path):
    for name in ("a.yaml", "a.yml"):
        (tmp_path / name).write_text("{a: 1, b: [2, x]}\n")
        assert read_document(tmp_path / name) == {"a": 1, "b": [2, "x"]}
    (tmp_path / "a.json").write_text("{a: 1}")
    with pytest.raises(InputError, match="line 1: not JSON"):
        read_document(tmp_path / "a.json")
    (tmp_path / "b.yaml").write_text("{a: *b}")
    with pytest.raises(InputError, match="line 1: aliases are not read"):
        read_document(tmp_path / "b.yaml")


def test_a_second_document_in_a_file_is_named(tmp_path):
    file = tmp_path / "echo.yaml"
    file.write_text("a: 1\n---\na: 2\n")
    with pytest.raises(InputError, match="line 2: a second document begins; legal: one"):
        read_document(file)


@pytest.mark.parametrize("read", [read_image, read_grey_image])
def test_an_image_of_16_bits_takes_little_more_memory_than_its_pixels(read, tmp_path):
    values = np.zeros((1000, 1500), dtype=np.uint16)
    values[::100, 1::7] = 40 * 256
    values[-1, -1] = 65535
    Image.fromarray(values).save(tmp_path / "image.png", compress_level=1)
    tracemalloc.start()
    grey = read(tmp_path / "image.png")
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert np.array_equal(grey, values // 257)
    assert most < 8 * values.size
