"""What a person meets who uses the command for the first time."""

import json
import os
import re
import signal
import subprocess
import sys

import pytest
from tests.cli.calling import call
from tests.cli.terminal import shown_on_terminal
from tests.cli.test_command_line import problem, written

from omniservo.cli.compiled_record import CompiledRecord
from omniservo.cli.progress import DOING
from omniservo.reporting.run_summary import run_summary

COMMAND = [sys.executable, "-m", "omniservo.cli.main"]
HEAVY = ("numba", "scipy", "mujoco", "matplotlib", "cv2")


def imports_of(*arguments, folder):
    """The heavy packages that a command loads, its exit code and its standard error."""
    script = (
        "import sys; from omniservo.cli.main import main\n"
        "try: main(sys.argv[1:])\n"
        f"finally: print([name for name in {HEAVY} if name in sys.modules])"
    )
    ended = subprocess.run(
        [sys.executable, "-c", script, *arguments], cwd=folder, capture_output=True, text=True, check=False
    )
    return ended.stdout.splitlines()[-1], ended.returncode, ended.stderr


WRONG_CALLS = [
    (["examples"], 0, ""),
    (["run", "paper-example-1", "--out", "there"], 2, "there: exists; --force replaces it\n"),
    (["run", "no-such-task"], 2, "neither a file nor one of the shipped tasks"),
    (["teach", "no-such-task", "--out", "goal.json"], 2, "neither a file nor one of the shipped tasks"),
    (["teach", "paper-example-1", "--out", "there"], 2, "there: exists; --force replaces it\n"),
    (["plan", "problem.json", "--out", "there"], 2, "there: exists; --force replaces it\n"),
    (["plan", "missing.json"], 2, "missing.json: no such file\n"),
    (["run", "paper-example-1", "--goal", "missing.json"], 2, "missing.json: no such file\n"),
    (["estimate"], 2, "give a TASK alone"),
    (["estimate", "one.png", "--camera", "fe185"], 2, "one.png: a single image; estimate: give a TASK alone"),
]


@pytest.mark.slow
def test_lists_and_wrong_calls_load_nothing_heavy(tmp_path):
    """One after the other in one process: none of them loads anything."""
    (tmp_path / "there").mkdir()
    script = (
        "import sys; from omniservo.cli.main import main\n"
        f"for arguments in {[arguments for arguments, *_ in WRONG_CALLS]}:\n"
        "    code = 0\n"
        "    try: main(arguments)\n"
        "    except SystemExit as end: code = end.code or 0\n"
        f"    heavy = [name for name in {HEAVY} if name in sys.modules]\n"
        "    print('ended', code, *heavy, file=sys.stderr)\n"
    )
    ended = subprocess.run(
        [sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    said = re.split(r"(?m)^(ended .*)\n", ended.stderr)
    assert len(said) == 2 * len(WRONG_CALLS) + 1
    for k, (arguments, code, says) in enumerate(WRONG_CALLS):
        assert said[2 * k + 1] == f"ended {code}", arguments
        assert says in said[2 * k], arguments


def test_a_warm_up_that_has_nothing_to_do_loads_nothing_heavy(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    record = CompiledRecord()
    record.path.parent.mkdir(parents=True)
    (record.path.parent / "some.kernel").write_bytes(b"compiled")
    assert record.save()
    heavy, ended, err = imports_of("warm-up", folder=tmp_path)
    assert (heavy, ended, err) == ("[]", 0, "")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("sent", "code", "how"), [(signal.SIGINT, 130, "interrupted"), (signal.SIGTERM, 143, "terminated")]
)
def test_a_run_that_is_ended_says_at_what_and_leaves_nothing_behind(tmp_path, sent, code, how):
    process = subprocess.Popen(
        [*COMMAND, "run", "paper-example-1", "--out", "out"],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    for line in process.stderr:
        if "teaching the goal" in line:
            break
    assert [path.name.startswith(".out.") for path in tmp_path.iterdir()] == [True]
    process.send_signal(sent)
    _, err = process.communicate()
    assert process.returncode == code
    assert err.splitlines()[-1].startswith(f"omniservo: {how} while ")
    assert err.endswith("; nothing was written\n")
    assert "Traceback" not in err
    assert not list(tmp_path.iterdir())


def test_an_interruption_names_what_was_written_before(capsys, tmp_path, monkeypatch):
    from omniservo.cli.output import Output

    def interrupt(self, values):
        raise KeyboardInterrupt

    monkeypatch.setattr(Output, "result", interrupt)
    out = tmp_path / "plan.json"
    code, _, err = call(capsys, "plan", written(tmp_path / "problem.json", problem()), "--out", out)
    assert (code, DOING.stage) == (130, "")
    assert err.splitlines()[-1] == f"omniservo: interrupted; written before: {out}"


def test_an_interrupted_study_names_no_folder_that_is_not_there(capsys, tmp_path, monkeypatch):
    def interrupt(*given, **options):
        raise KeyboardInterrupt

    monkeypatch.setattr("omniservo.studies.run_study", interrupt)
    code, _, err = call(capsys, "study", "quick", "--out", tmp_path / "study")
    assert (code, err.splitlines()[-1]) == (130, "omniservo: interrupted while loading; nothing was written")


@pytest.mark.slow
def test_a_plan_tells_its_time_from_that_of_loading_code(tmp_path):
    written(tmp_path / "problem.json", problem())
    ended = subprocess.run(
        [*COMMAND, "plan", "problem.json"], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    first, *constraints = ended.stdout.splitlines()
    words = first.split()
    assert words[:2] == ["certified", "in"]
    assert "ms, of which" in first
    assert first.endswith("ms loading or compiling code (method certified)")
    assert float(words[6]) <= float(words[2])
    assert [line for line in constraints if line.split()[0] == "rotation"]
    assert not [line for line in constraints if " 1 at w" in line]


@pytest.mark.slow
def test_a_plan_is_written_also_where_nobody_reads_what_is_said(tmp_path):
    written(tmp_path / "problem.json", problem())
    ours, theirs = os.pipe()
    os.close(ours)
    ended = subprocess.run(
        [*COMMAND, "plan", "problem.json", "--out", "p.json"],
        cwd=tmp_path,
        stdout=theirs,
        stderr=subprocess.PIPE,
        check=False,
    )
    os.close(theirs)
    assert (tmp_path / "p.json").is_file()
    assert ended.returncode == 141  # not 1, which is the answer no
    assert b"Traceback" not in ended.stderr


@pytest.mark.slow
def test_a_plan_comes_to_the_same_where_standard_error_is_closed(tmp_path):
    written(tmp_path / "problem.json", problem())
    ended = subprocess.run(
        ["sh", "-c", 'exec "$@" 2>&-', "sh", *COMMAND, "plan", "problem.json"],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        check=False,
    )
    assert ended.returncode == 0
    assert ended.stdout.startswith(b"certified in")


@pytest.mark.slow
def test_a_command_that_compiles_says_so_while_it_does_and_whether_it_is_kept(tmp_path):
    script = (
        "import numpy as np\n"
        "from omniservo.cameras.models.block_kernels import read_pixels\n"
        "from omniservo.cli.output import Output\n"
        "with Output(as_json=False, quiet=False).working('planning'):\n"
        "    read_pixels(np.zeros(13), np.zeros((1, 2)), np.zeros(1), np.zeros(1))\n"
    )
    first, second, unkept = (
        subprocess.run(
            [sys.executable, "-c", script],
            env=os.environ | {"XDG_CACHE_HOME": str(cache)},
            capture_output=True,
            text=True,
            check=True,
        ).stderr
        for cache in (tmp_path, tmp_path, os.devnull)
    )
    begun, done = first.splitlines()
    assert begun.endswith("compiling, once: this stage's code (planning)")
    assert re.search(r"compiling took \d+ s; what is compiled is kept for the next time$", done)
    assert second == ""
    assert "it is not kept, as /dev/null/omniservo/" in unkept.splitlines()[-1]


def test_a_terminal_shows_one_line_that_changes():
    script = (
        "from omniservo.cli.output import Output\n"
        "with Output(as_json=False, quiet=False).working('starting') as progress:\n"
        "    progress('planning', 0.5)\n"
        "    progress('writing', 0.9)\n"
    )
    shown = shown_on_terminal([sys.executable, "-c", script], subprocess.DEVNULL)
    assert "about" in shown
    assert shown.endswith("\x1b[2K")  # the line is taken away again


METRICS = {
    "method": "certified",
    "status": "converged",
    "reason": "",
    "contacts": [],
    "plan_status": "certified",
    "clearance_asked_m": 0.055,
    "clearance_planned_m": 0.0650027,
    "clearance_executed_m": 0.0649824,
    "arm_clearance_executed_m": 0.0092195,
    "visibility_planned_px": 100.533,
    "visibility_executed_px": 100.513,
    "final_error_px": 0.0162652,
    "final_translation_error_m": 4.05876e-05,
    "final_rotation_error_rad": 0.000248256,
    "servo_seconds": 4.3,
    "estimation_seconds": 0.0005,
    "estimation_code_seconds": 0.0,
    "planning_seconds": 0.0063,
    "planning_code_seconds": 0.0,
    "link_clearance_asked_m": None,
}


def test_what_is_certified_is_rounded_down_and_what_is_measured_is_not():
    text = "\n".join(run_summary(METRICS | {"visibility_planned_px": 100.6, "visibility_executed_px": 100.7}))
    assert "≥ 100 px certified, 101 px executed" in text
    planned = METRICS | {"visibility_planned_px": 100.6, "plan_status": "undecided"}
    assert "101 px planned" in "\n".join(run_summary(planned))


def test_a_run_ends_in_five_lines_in_mm():
    lines = list(run_summary(METRICS))
    assert len(lines) == 5
    assert lines[0] == "converged: 0.0406 mm, 0.0142°, 0.0163 px off the taught view; nothing was touched"
    assert lines[1].endswith("65.00 mm certified, 64.98 mm executed (55.00 mm required)")
    assert not [line for line in lines if "None" in line or "[]" in line or "loading" in line]
    touched = {**METRICS, "status": "contact", "contacts": [["link_6", "obstacle 0"]], "plan_status": None}
    touched |= {"planning_seconds": None, "clearance_planned_m": None, "visibility_planned_px": None}
    lines = list(run_summary(touched))
    assert lines[0] == "touched: link_6 and obstacle 0"
    assert not [line for line in lines if "None" in line or "certified" in line]
    json.dumps(lines)


def test_the_nearest_thing_of_a_run_is_a_table_where_there_is_no_obstacle():
    alone = {"arm_clearance_executed_m": None, "link_clearance_executed_m": 0.083}
    (line,) = [line for line in run_summary(METRICS | alone) if "any link" in line]
    assert line == "any link to anything  83.00 mm executed"
    assert not [
        line
        for line in run_summary(METRICS | {**alone, "link_clearance_executed_m": None})
        if "any link" in line
    ]


def test_a_run_says_of_what_loading_code_was_a_part_and_no_demand_that_nobody_made():
    slow = {"planning_seconds": 0.8, "planning_code_seconds": 0.79, "estimation_seconds": 0.2}
    lines = list(run_summary(METRICS | slow | {"estimation_code_seconds": 0.11, "clearance_asked_m": 0.0}))
    assert lines[1].endswith("64.98 mm executed")
    words = "motion and structure 200 ms, planning 800 ms (900 ms of both was loading or compiling code);"
    assert words in lines[-1]


@pytest.mark.parametrize(
    ("file", "words"),
    [
        ("recording.mcap", "the recording in it, {folder}/recording.mcap"),
        ("study.json", "one of the study's rows, {folder}:ROW"),
        ("metrics.json", "a recording, which omniservo export {folder} makes of the run"),
        ("letter.txt", "a recording (.mcap), or STUDY:ROW"),
    ],
)
def test_of_a_folder_it_is_said_what_is_replayed(capsys, tmp_path, file, words):
    (tmp_path / file).touch()
    code, out, err = call(capsys, "run", "--replay", tmp_path)
    assert (code, out) == (2, "")
    assert err == f"omniservo: --replay: {tmp_path}: a folder; legal: {words.format(folder=tmp_path)}\n"
