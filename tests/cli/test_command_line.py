import io
import json
import os
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image
from tests.cli.calling import call

from omniservo.cli.main import main
from omniservo.cli.output import Output


def problem(**changes):
    """A small problem in the form that the interface promises."""
    camera = {
        "model": "unified",
        "fx": 300.0,
        "fy": 300.0,
        "cx": 320.0,
        "cy": 240.0,
        "skew": 0.0,
        "xi": 1.2,
        "distortion": [0, 0, 0, 0],
        "width": 640,
        "height": 480,
        "max_angle": 1.5,
        "dead_zone": None,
    }
    return {
        "format": "omniservo.problem/1",
        "camera": camera,
        "points": [[x, y, 0.6 + 0.2 * x * y] for x in (-0.1, 0, 0.1) for y in (-0.1, 0, 0.1)],
        "goal": {"translation": [0.2, 0, 0.1], "quaternion": [0, 0, 0, 1]},
        "obstacles": [{"type": "sphere", "center": [0.1, 0.005, 0.05], "radius": 0.02}],
        "clearance": 0.03,
        **changes,
    }


def written(path, document):
    path.write_text(json.dumps(document))
    return path


def test_a_plan_is_written_verified_and_reported_as_json(capsys, tmp_path):
    source, plan = written(tmp_path / "problem.json", problem()), tmp_path / "plan.json"
    code, out, err = call(capsys, "plan", source, "--out", plan, "--json")
    assert (code, err) == (0, "")
    assert json.loads(out)["status"] == "certified"
    assert json.loads(plan.read_text())["format"] == "omniservo.plan/1"
    code, out, err = call(capsys, "verify", plan, "--json")
    assert (code, err) == (0, "")
    assert json.loads(out)["status"] == "certified"


def test_a_plan_in_the_place_of_a_problem_is_refused_by_its_format(capsys, tmp_path):
    source = written(tmp_path / "plan.json", {"format": "omniservo.plan/1", "problem": problem()})
    code, _, err = call(capsys, "plan", source)
    assert code == 2
    assert "plan.json: format: 'omniservo.plan/1' given; legal: 'omniservo.problem/1'" in err


def test_a_problem_in_the_place_of_a_plan_is_refused_by_its_name(capsys, tmp_path):
    source = written(tmp_path / "problem.json", problem())
    code, _, err = call(capsys, "verify", source)
    assert code == 2
    assert err == f'omniservo: {source}: not a plan: "format" must be "omniservo.plan/1"\n'


def test_a_false_plan_is_refuted_with_exit_code_1_and_a_reason(capsys, tmp_path):
    source, plan = written(tmp_path / "problem.json", problem()), tmp_path / "plan.json"
    call(capsys, "plan", source, "--out", plan, "--quiet")
    document = json.loads(plan.read_text())
    document["problem"]["obstacles"][0]["radius"] = 0.15
    written(plan, document)
    code, _, err = call(capsys, "verify", plan)
    assert code == 1
    assert err.startswith("omniservo: refuted: ")


def test_the_image_of_a_plan_that_was_refused_replaces_none_that_nobody_named(capsys, tmp_path):
    obstacle = {"type": "sphere", "center": [0.2, 0.0, 0.1], "radius": 0.02}
    source = written(tmp_path / "problem.json", problem(obstacles=[obstacle]))
    (tmp_path / "plan.png").write_text("mine")
    code, _, err = call(capsys, "plan", source, "--out", tmp_path / "plan.json", "--quiet")
    assert code == 1
    assert err.startswith("omniservo: infeasible: ")
    assert (tmp_path / "plan.png").read_text() == "mine"
    assert (tmp_path / "plan.json").is_file()


def test_a_plan_of_more_margin_within_a_time_budget(capsys, tmp_path):
    source = written(tmp_path / "problem.json", problem())
    plans = []
    for more in ((), ("--quality", "margin", "--time-budget", "60")):
        code, out, err = call(capsys, "plan", source, "--json", *more)
        assert (code, err) == (0, "")
        constraints = json.loads(out)["certificate"]["constraints"]
        plans.append(next(c["margin"] for c in constraints if c["name"].startswith("clearance")))
    assert plans[1] > plans[0] + 0.01


def test_an_impossible_problem_is_exit_code_1_and_says_why(capsys, tmp_path):
    obstacle = {"type": "sphere", "center": [0.2, 0, 0.1], "radius": 0.01}
    code, out, err = call(
        capsys, "plan", written(tmp_path / "problem.json", problem(obstacles=[obstacle])), "--quiet"
    )
    assert (code, out) == (1, "")
    assert "infeasible" in err
    assert "obstacle 0" in err


@pytest.mark.parametrize(
    "arguments",
    [
        ("plan", "{dir}/missing.json"),
        ("plan", "{dir}/broken.json"),
        ("verify", "{dir}/broken.json"),
        ("verify", "{dir}/problem.json"),
        ("run", "no-such-task"),
        ("run", "paper-example-1", "--out", "{dir}"),
        ("run", "paper-example-1", "--out", "a\0b"),
        ("run", "paper-example-1", "--seed", str(2**63), "--out", "{dir}/new"),
        ("run", "paper-example-1", "--camera", "{dir}/broken.json", "--out", "{dir}/new"),
        ("teach", "paper-example-1", "--out", "{dir}/problem.json"),
        ("estimate",),
        ("estimate", "--camera", "fe185", "--initial", "{dir}/problem.json", "--goal", "{dir}/problem.json"),
        ("camera", "show", "{dir}/broken.json"),
        ("camera", "convert", "{dir}/broken.json", "{dir}/new.yaml", "--to", "own"),
        ("plan", "{dir}/problem.json", "--method", "magic"),
        ("plan", "{dir}/problem.json", "--time-budget", "0"),
        ("plan", "{dir}/problem.json", "--time-budget", "nan"),
        ("plan", "{dir}/problem.json", "--time-budget", "inf"),
        ("plan", "{dir}/problem.json", "--quality", "speed"),
        ("plan", "{dir}/problem.json", "--time-budget", "soon"),
        ("plan", "{dir}/problem.json", "--no-such-option"),
        ("plan", "{dir}/problem.json", "{dir}/broken.json"),
        ("plan", "{dir}/problem.json", "--out"),
        ("sim", "serve", "ur5e-table", "--loss", "2"),
        ("camera", "show"),
        ("no-such-command",),
    ],
)
def test_wrong_input_is_one_message_and_exit_code_2_and_leaves_nothing(capsys, tmp_path, arguments):
    written(tmp_path / "problem.json", problem())
    (tmp_path / "broken.json").write_text('{"format": ')
    before = sorted(p.name for p in tmp_path.iterdir())
    code, out, err = call(capsys, *(a.format(dir=tmp_path) for a in arguments))
    assert code == 2
    assert out == ""
    assert err.splitlines()[-1].startswith("omniservo: ")
    assert "Traceback" not in err
    assert sorted(p.name for p in tmp_path.iterdir()) == before


def test_examples_lists_the_shipped_tasks(capsys):
    code, out, _ = call(capsys, "examples", "--json")
    assert code == 0
    assert [t["name"] for t in json.loads(out)["tasks"]] == [
        "catadioptric-ring",
        "moving-panel",
        "panda-table",
        "paper-example-1",
        "paper-example-2",
        "perspective-wall",
        "tag-board",
        "textured-object",
        "ur5e-table",
        "whole-arm-1",
        "whole-arm-2",
    ]


def test_a_camera_is_shown_converted_and_read_back(capsys, tmp_path):
    own, mei = tmp_path / "camera.yaml", tmp_path / "mei.yaml"
    camera = problem()["camera"]
    written(tmp_path / "camera.json", {"format": "omniservo.camera/1", **camera, "max_angle": None})
    assert call(capsys, "camera", "convert", tmp_path / "camera.json", mei, "--to", "mei")[0] == 0
    assert call(capsys, "camera", "convert", mei, own, "--to", "own", "--quiet")[:2] == (0, "")
    code, out, _ = call(capsys, "camera", "show", own, "--json")
    assert code == 0
    assert json.loads(out)["fx"] == 300.0


def test_a_camera_is_shown_with_its_mask(capsys, tmp_path):
    mask = [[[0.0, 0.0], [50.0, 0.0], [0.0, 50.0]]]
    masked = {"format": "omniservo.camera/1", **problem()["camera"], "mask": mask}
    code, out, _ = call(capsys, "camera", "show", written(tmp_path / "camera.json", masked))
    assert code == 0
    assert "mask           [[[0, 0], [50, 0], [0, 50]]]" in out


FISHEYE = """%YAML:1.0
---
K: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 300., 0., 319.5, 0., 300., 239.5, 0., 0., 1. ]
D: !!opencv-matrix
   rows: 4
   cols: 1
   dt: d
   data: [ 0.01, -0.02, 0.003, 0. ]
"""


@pytest.mark.slow
def test_what_a_file_leaves_open_is_asked_for_and_a_conversion_says_its_residual(capsys, tmp_path):
    source, out = tmp_path / "fisheye.yml", tmp_path / "mei.yaml"
    source.write_text(FISHEYE)
    convert = ("camera", "convert", source, out, "--to", "mei")
    assert "does not say the image size; say it: --size" in call(capsys, *convert)[2]
    for wrong in ("640", "640x", "axb", "640x480x3", "-640x480", "99999999x480"):
        assert "--size" in call(capsys, *convert, "--size", wrong)[2]
    assert "say it: --model pinhole or --model fisheye" in call(capsys, *convert, "--size", "640x480")[2]
    said = ("--size", "640x480", "--model", "fisheye")
    code, _, err = call(capsys, *convert, *said, "--largest-px", "1e-6")
    assert code == 2
    assert "px away; legal: <= 1e-06 px (--largest-px allows more)" in err
    assert not out.exists()
    code, printed, _ = call(capsys, *convert, *said)
    assert code == 0
    assert "residual: at most " in printed
    code, printed, _ = call(capsys, *convert, *said, "--json", "--force")
    result = json.loads(printed)
    assert 0.0 < result["largest_px"] < 0.2
    assert (code, result["model"], result["to"]) == (0, "unified", "mei")
    code, printed, _ = call(capsys, "camera", "show", source, *said)
    assert code == 0
    assert "model          kannala_brandt" in printed
    assert "as unified     at most 0.0" in printed


def test_a_mask_image_becomes_polygons_of_our_own_format_only(capsys, tmp_path):
    v, u = np.mgrid[:432, :659]
    image = np.where((u > 500) & (v > 300), 0, 255).astype(np.uint8)
    Image.fromarray(image).save(tmp_path / "mask.png")
    convert = ("camera", "convert", "fe185", tmp_path / "out.json", "--mask", tmp_path / "mask.png", "--to")
    assert "legal: --to own" in call(capsys, *convert, "kalibr")[2]
    code, out, _ = call(capsys, *convert, "own", "--json")
    assert (code, json.loads(out)["mask_polygons"], json.loads(out)["mask_lost_pixels"]) == (0, 1, 0)
    assert len(json.loads((tmp_path / "out.json").read_text())["mask"][0]) == 4
    again = (
        "camera",
        "convert",
        tmp_path / "out.json",
        tmp_path / "two.json",
        "--mask",
        tmp_path / "mask.png",
    )
    assert "the camera has a mask" in call(capsys, *again, "--to", "own")[2]


def test_a_camera_that_no_unified_one_comes_near_is_shown_all_the_same(capsys, shared_data):
    file = "ocamcalib/premnirmal_Homing-in-Scale-Space__calib_results.txt"
    code, out, _ = call(capsys, "camera", "show", shared_data / "calibrations" / file, "--json")
    assert code == 0
    assert json.loads(out)["unified"]["largest_px"] > 1.0
    code, out, _ = call(capsys, "camera", "show", shared_data / "calibrations" / file)
    assert "as unified     at most " in out


def test_what_is_said_stands_as_it_is(capsys):
    """Neither markup nor names of emoji are looked for in paths."""
    path = "/data/cam:a:1/[b]plan[/b].json"
    Output().line(path)
    assert capsys.readouterr().out == f"{path}\n"


def test_what_the_terminals_encoding_does_not_have_is_spelled_out(monkeypatch):
    written = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(written, encoding="latin-1"))
    with pytest.raises(SystemExit, match="0"):
        main(["schema", "problem"])
    sys.stdout.flush()
    assert b"\\u03be" in written.getvalue()  # ξ


@pytest.mark.parametrize(
    "command", [("run", "paper-example-1"), ("run", "--replay", "quick:0")], ids=["run", "a row"]
)
def test_a_folder_of_other_things_is_refused_before_anything_is_done_in_it(command, tmp_path, capsys):
    (tmp_path / "task.yaml").write_text("mine")
    code, _, err = call(capsys, *command, "--out", tmp_path, "--force")
    assert code == 2
    assert f"{tmp_path}: holds other files, and no" in err
    assert [p.read_text() for p in tmp_path.iterdir()] == ["mine"]


@pytest.mark.slow
def test_a_backend_that_matplotlib_does_not_have_stops_no_drawing(tmp_path):
    command = [sys.executable, "-m", "omniservo", "camera", "show", "fe185", "--quiet", "--out", tmp_path]
    named = os.environ | {"MPLBACKEND": "Qt4Agg"}
    ended = subprocess.run(command, env=named, capture_output=True, check=False)
    assert (ended.returncode, ended.stderr) == (0, b"")
