"""JSON schemas accept what is shipped and written, and refuse what the readers refuse for its structure."""

import ast
import json
import re
from pathlib import Path

import jsonschema
import pytest
import yaml
from tests.cli.calling import call
from tests.schemas.documents import LENSES, READERS, damaged, full_documents, shipped_documents

from omniservo.errors import InputError
from omniservo.runs.robot_records import save_check
from omniservo.schemas import FORMATS, json_schema, short_name
from omniservo.shipped_studies import study_file
from omniservo.studies.load_study import load_study, study_of_fields
from omniservo.studies.study_folder import StudyHeader, this_machine
from omniservo.tasks import load_robot
from omniservo.tasks.task_files import TaskFiles

SOURCE = Path(__file__).resolve().parents[2] / "src/omniservo"

BESIDE_OTHERS = {
    "plan": {("path", "rotation", 0), ("path", "translation", 0)},
    "estimate": {
        ("points",), ("points_covariance",), ("inliers",), ("residuals_px",), ("uncertainty", "noise", 0),
        ("uncertainty", "own"), ("uncertainty", "pixel_sigma"),
    },
    "robot_poses": {("base_T_flange", 0, "image")},
    "task": {("units",), ("units", "length")},
}  # fmt: skip
"""What must be as long as other lists, or stand where it stands in others, or makes a mount of 90 mm one of
90 m: no JSON schema can say that.
"""

AS_TEXT = {("plan", name) for name in ("name", "unit", "constraint", "method", "reason")}
"""What the reader of a plan takes as text, whatever it is."""


@pytest.fixture(scope="module")
def validators():
    return {short_name(full): jsonschema.Draft202012Validator(json_schema(full)) for full in FORMATS}


@pytest.fixture(scope="module")
def documents():
    return full_documents()


def test_every_schema_is_one(validators):
    for validator in validators.values():
        validator.check_schema(validator.schema)


def test_every_format_in_the_source_has_a_schema():
    texts = [path.read_text() for path in SOURCE.rglob("*.py")]
    named = {name for text in texts for name in re.findall(r'"(omniservo\.[\w-]+/\d+)"', text)}
    read_only = {"omniservo.goal/1"}  # older
    binary = {"omniservo.recording/1"}  # MCAP, no JSON
    lines = {"omniservo.study-part/2"}  # of JSON, compressed
    outputs = {full for full in FORMATS if full.endswith("-output/1")}
    assert named - read_only - binary - lines == set(FORMATS) - outputs


OF_FILES = {"plan.py", "estimate.py", "estimate_views.py", "hand_eye.py"}
"""Commands that print what a file's format describes."""


def test_every_output_of_a_command_has_a_schema_and_every_such_schema_an_output():
    named, unnamed = set(), set()
    for path in (SOURCE / "cli").glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Call) and ast.unparse(node.func) == "output.result":
                if len(node.args) == 2:
                    named.add(f"omniservo.{ast.literal_eval(node.args[1])}-output/1")
                else:
                    unnamed.add(path.name)
    assert named == {full for full in FORMATS if full.endswith("-output/1")}
    assert unnamed == OF_FILES


def test_every_shipped_file_is_valid(validators):
    for name, fields in shipped_documents():
        validators[name].validate(fields)


@pytest.mark.parametrize("camera", LENSES, ids=lambda camera: type(camera).__name__)
def test_every_camera_model_is_valid(validators, camera):
    validators["camera"].validate({"format": "omniservo.camera/1", **camera.to_dict()})


@pytest.mark.parametrize("name", READERS)
def test_schema_and_reader_refuse_the_same_damaged_documents(name, validators, documents, tmp_path):
    document = documents[name]
    READERS[name](document, tmp_path)
    validators[name].validate(document)
    let_through, only_by_schema, refused = [], [], 0
    for place, fields in damaged(document):
        valid = validators[name].is_valid(fields)
        try:
            READERS[name](fields, tmp_path)
        except InputError as error:
            refused += 1
            if valid and place[:-1] not in BESIDE_OTHERS.get(name, ()):
                let_through.append((place, str(error)))
        else:
            if not valid and (name, place[-2]) not in AS_TEXT:
                only_by_schema.append(place)
    assert let_through == []
    assert only_by_schema == []
    assert refused >= 10


@pytest.mark.parametrize(
    "change",
    [
        {"methods": ["ibvss"]}, {"methods": []}, {"cameras": []}, {"cameras": {"a": 3}}, {"scenes": 0},
        {"images": {"noise": {"uniform": [0.1]}}}, {"images": {"noise": {"even": [0, 1]}}}, {"arm": 1},
        {"images": {"nois": 1}}, {"format": "omniservo.study/2"},
    ],
)  # fmt: skip
def test_a_study_that_is_wrong_is_refused_by_schema_and_reader(validators, change):
    fields = yaml.safe_load(study_file("quick").read_text())
    study_of_fields(fields, TaskFiles("study", Path()))
    with pytest.raises(InputError):
        study_of_fields(fields | change, TaskFiles("study", Path()))
    assert not validators["study"].is_valid(fields | change)


def test_what_a_study_s_folder_says_is_valid(validators):
    header = StudyHeader(load_study("quick"), "0.1.0", (this_machine(),))
    validators["study-run"].validate(json.loads(header.to_json()))


def test_the_record_of_a_check_is_valid(validators, tmp_path):
    robot = tmp_path / "robot.yaml"
    robot.write_text(
        "{format: omniservo.robot/1, driver: rtde, arm: {model: ur5e, flange_T_camera: {}}, "
        "camera: {source: v4l2:0, calibration: fe185}}"
    )
    validators["robot-check"].validate(json.loads(save_check(robot, load_robot(robot)).read_text()))


def test_an_unknown_format_is_refused_with_the_known_ones():
    with pytest.raises(InputError, match=r"format: 'plann' given; legal: problem, .*did you mean 'plan'"):
        json_schema("plann")


def test_the_command_lists_the_formats_and_prints_one(capsys):
    code, out, _ = call(capsys, "schema")
    assert code == 0
    assert [line.split()[1] for line in out.splitlines()] == list(FORMATS)
    code, out, _ = call(capsys, "schema", "--json")
    assert {entry["format"] for entry in json.loads(out)["formats"]} == set(FORMATS)
    for arguments in (["plan"], ["omniservo.plan/1", "--json"]):
        code, out, _ = call(capsys, "schema", *arguments)
        assert (code, json.loads(out)) == (0, json_schema("plan"))
    assert call(capsys, "schema", "plan", "--quiet") == (0, "", "")
    code, out, err = call(capsys, "schema", "plann")
    assert (code, out) == (2, "")
    assert "legal: problem, " in err
