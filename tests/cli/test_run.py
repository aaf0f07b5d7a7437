"""The whole job by command, with a slow camera: pictures take most of the time."""

import contextlib
import io
import json
import shlex
from collections import Counter
from pathlib import Path

import pytest
from tests.cli.calling import call
from tests.cli.test_command_line import written
from tests.cli.valid_output import check_output
from tests.project.agents_page import CONSOLE, FILES, TEXT, differences, shown

from omniservo.cli.main import main
from omniservo.files import read_document
from omniservo.reporting.metric_meanings import meaning_of
from omniservo.runs import look_again, planned_job
from omniservo.runs.see import see
from omniservo.shipped_tasks import task_file


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    """The folder it was called in, what it wrote on both outputs, and how often each stage was computed."""
    folder, calls = tmp_path_factory.mktemp("run"), Counter()

    def counted(work):
        def counting(*arguments):
            calls[work.__name__] += 1
            return work(*arguments)

        return counting

    document = read_document(task_file("paper-example-1"))
    document["sensor"]["rate"] = 4
    (folder / "runs" / "paper-example-1").mkdir(parents=True)
    out, err = io.StringIO(), io.StringIO()
    with pytest.MonkeyPatch.context() as patch, contextlib.ExitStack() as outputs:
        outputs.enter_context(contextlib.redirect_stdout(out))
        outputs.enter_context(contextlib.redirect_stderr(err))
        patch.chdir(folder)
        patch.setattr(planned_job, "see", counted(see))
        patch.setattr(look_again, "plan_task", counted(look_again.plan_task))
        main_ends(["run", str(written(folder / "task.yaml", document)), "--no-film"])
    return folder, out.getvalue(), err.getvalue(), calls


def main_ends(arguments):
    """Call the command; it ends well."""
    with pytest.raises(SystemExit) as end:
        main(arguments)
    assert not end.value.code


@pytest.mark.slow
def test_everything_is_computed_once_and_timed_as_it_was(ran):
    folder, _, _, calls = ran
    assert calls == {"see": 1, "plan_task": 1}
    metrics = json.loads((folder / "runs" / "paper-example-1-2" / "metrics.json").read_text())
    for stage in ("perception", "estimation", "planning"):
        assert 0.0 <= metrics[f"{stage}_code_seconds"] <= metrics[f"{stage}_seconds"]
        assert meaning_of(f"{stage}_code_seconds").unit == "s"


def test_results_go_beside_earlier_ones_and_end_in_a_few_lines(ran):
    folder, out, _, _ = ran
    lines = out.splitlines()
    assert lines[0].startswith("converged: 0.0")
    assert lines[-1] == "written: runs/paper-example-1-2/report.html"
    assert len(lines) == 6
    assert not list((folder / "runs" / "paper-example-1").iterdir())
    assert sorted(p.name for p in (folder / "runs").iterdir()) == ["paper-example-1", "paper-example-1-2"]


def test_without_a_film_there_is_no_animation(ran):
    results = Path(ran[0] / "runs" / "paper-example-1-2")
    assert not (results / "recording.gif").exists()
    assert "image/gif" not in (results / "report.html").read_text()


def test_stages_are_told_one_a_line_with_what_is_left(ran):
    stages = [line.split("] ")[1] for line in ran[2].splitlines() if "compiling" not in line]
    names = [stage.split(";")[0] for stage in stages]
    assert list(dict.fromkeys(names)) == [  # a long one is said again
        "teaching the goal",
        "looking at the target",
        "estimating motion and structure",
        "planning",
        "following the path",
        "measuring the run",
        "drawing figures",
        "writing the report",
    ]
    assert all("; about " in stage for stage in stages[4:])


def test_run_and_what_follows_from_it_give_the_json_on_the_agents_page(ran, capsys, tmp_path):
    result = ran[0] / "runs" / "paper-example-1-2"
    pages = {command.split()[0] + ("" if "--estimate" not in command else " --estimate"): (command, answer)
             for command, answer in CONSOLE.findall(TEXT)}  # fmt: skip
    metrics = json.loads((result / "metrics.json").read_text())
    printed = {"format": "omniservo.run-output/1", **metrics, "out": "result"}
    check_output(json.dumps(printed))
    assert list(differences(shown(pages["run"][1]), printed)) == []
    (tmp_path / "result").symlink_to(result)
    for name, content in FILES.findall(TEXT):
        (tmp_path / name).write_text(content)
    with contextlib.chdir(tmp_path):
        for command, answer in (pages["estimate"], pages["plan --estimate"]):
            code, out, err = call(capsys, *shlex.split(command))
            assert code == 0, err
            assert list(differences(shown(answer), json.loads(out))) == []


@pytest.mark.slow
@pytest.mark.parametrize("aside", [0, 300])
def test_a_goal_that_shows_a_part_of_the_target_is_taught_with_a_notice(tmp_path, capsys, aside):
    text = task_file("ur5e-table").read_text()
    moved = text.replace(
        "initial_T_goal: {translation: [280,", f"initial_T_goal: {{translation: [{280 + aside},"
    )
    assert (moved == text) == (aside == 0)
    (tmp_path / "task.yaml").write_text(moved)
    code, said, _ = call(capsys, "teach", tmp_path / "task.yaml", "--out", tmp_path / "goal.json")
    assert code == 0
    assert ("8 features found" in said) == ("notice: the target has 14 dots" in said) == (aside > 0)
