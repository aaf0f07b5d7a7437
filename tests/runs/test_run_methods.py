"""Methods of a run by name and from files: side by side, refused by name, stopped by name."""

import json

import pytest
from tests.cli.calling import call
from tests.runs.changed_task import PlainCell

from omniservo.errors import InputError, InvalidData, NoSolutionError
from omniservo.run_methods import COMPARED, METHODS, run_method, run_methods
from omniservo.runs import run_into, run_task
from omniservo.servoing.own_method import OwnMethod
from omniservo.tasks import load_task

OWN = '''
import numpy as np

class AtOnce:
    """Fails at the first image."""
    def __init__(self, gain): ...
    def step(self, seen):
        raise ZeroDivisionError("no depth")

class OnTheWay:
    """Fails away from the goal."""
    def __init__(self, gain):
        self.gain = gain
    def step(self, seen):
        return 0.0 / 0.0 if np.linalg.norm(seen.goal_T_camera.translation) > 1e-6 else np.zeros(6)

class Lying:
    """Would give no twist that can be sent."""
    def __init__(self, gain): ...
    def step(self, seen):
        return np.full(6, np.nan if np.linalg.norm(seen.goal_T_camera.translation) > 1e-6 else 0.0)

class Leaving:
    """Ends the whole process."""
    def __init__(self, gain): ...
    def step(self, seen):
        raise SystemExit(3)

class NotMade:
    def __init__(self, gain):
        raise KeyError("weights")
    def step(self, seen): ...

class WithoutStep:
    def __init__(self, gain): ...

def without_gain():
    return None
'''


@pytest.fixture(scope="module")
def task():
    """The paper's first example with few images."""
    found = load_task("paper-example-1")
    return found.model_copy(update={"sensor": found.sensor.model_copy(update={"rate": 4.0})})


@pytest.fixture
def own(tmp_path):
    file = tmp_path / "own.py"
    file.write_text(OWN)
    return file


@pytest.mark.slow
def test_one_that_is_refused_stands_beside_one_that_ran(task, own, tmp_path):
    folder = tmp_path / "out"
    folder.mkdir()
    found = run_into(folder, task, PlainCell, method=[f"{own}:AtOnce", "pbvs"], filmed=False)
    assert list(found) == ["own.AtOnce", "pbvs"]
    refused, pbvs = found.values()
    assert refused["status"] == "refused"
    assert "no twist at the goal image: invalid_data" in refused["reason"]
    assert "own.py:8: ZeroDivisionError: no depth; nothing was commanded" in refused["reason"]
    assert (pbvs["status"], pbvs["plan_status"]) == ("contact", None)  # straight on, into the box
    assert json.loads((folder / "metrics.json").read_text())["method"] == "pbvs"
    assert not (folder / "own.AtOnce").exists()
    report = (folder / "report.html").read_text()
    for words in ("Refused", "own.AtOnce", "Position-based, straight in space", "ZeroDivisionError"):
        assert words in report


@pytest.mark.parametrize(
    ("name", "words"),
    [("OnTheWay", "own.py:15: ZeroDivisionError"), ("Lying", "gives the twist [nan")],
)
def test_what_fails_on_the_way_is_a_named_stop_and_nothing_of_it_is_sent(task, own, name, words):
    metrics = run_task(task, PlainCell, method=f"{own}:{name}", filmed=False).metrics
    assert (metrics["status"], metrics["method"]) == ("stopped", f"own.{name}")
    assert words in metrics["reason"]
    assert metrics["frames"] == 0


def test_where_all_refuse_the_first_refusal_is_raised(task, own, tmp_path):
    with pytest.raises(NoSolutionError, match="own.AtOnce: no twist at the goal image"):
        run_into(tmp_path, task, PlainCell, method=f"{own}:AtOnce", filmed=False)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("WithoutStep", "has no step"),
        ("NotMade", "own.py:31: KeyError: 'weights'"),
        ("without_gain", r"legal: CLASS\(gain\)"),
        ("Missing", "has no class 'Missing'"),
    ],
)
def test_what_is_no_method_is_named(task, own, name, message):
    with pytest.raises(InputError, match=message):
        run_task(task, PlainCell, method=f"{own}:{name}", filmed=False)


def test_a_method_that_would_end_the_process_is_a_named_stop(own):
    with pytest.raises(InvalidData, match="own.py:27: SystemExit: 3"):
        OwnMethod(f"{own}:Leaving", 1.0).step(None)


@pytest.mark.slow
def test_only_a_method_that_replans_is_led_round_a_panel_that_was_moved():
    moving = load_task("moving-panel")
    moving = moving.model_copy(
        update={
            "sensor": moving.sensor.model_copy(update={"rate": 6.0}),
            "moves": (moving.moves[0].model_copy(update={"time": 0.4}),),
            "servo": moving.servo.model_copy(update={"time_limit": 1.2}),
        }
    )
    result = run_task(moving, PlainCell, method="certified-once", filmed=False)
    assert result.plan.status == "certified"
    assert result.log.rows[-1].time > 1.0
    assert len(result.way.legs) == 1
    assert "changes_on_the_way" not in result.metrics
    assert not METHODS["paper"].replans


def test_methods_by_name():
    assert [method.name for method in run_methods(["compare"])] == list(COMPARED)
    assert [m.name for m in run_methods(["pbvs", "compare", "ibvs"])] == [
        "pbvs",
        "certified",
        "paper",
        "ibvs",
    ]
    own = run_method("a/b/mine.py:Best")
    assert (own.name, own.source, own.plans) == ("mine.Best", "a/b/mine.py:Best", None)
    for wrong, words in (
        ("pbsv", "did you mean 'pbvs'"),
        ("mine.py", "FILE.py:CLASS"),
        ("x.py:a b", "legal: certified"),
    ):
        with pytest.raises(InputError, match=words):
            run_method(wrong)
    with pytest.raises(InputError, match="none given"):
        run_methods([])


def test_compare_is_named_as_legal_where_it_is_taken():
    with pytest.raises(InputError, match=r"legal: .*, switched, or FILE.py:CLASS$"):
        run_method("compare")
    with pytest.raises(InputError, match=r"switched, compare, or .*did you mean 'compare'"):
        run_methods(["conpare"])


@pytest.mark.parametrize(
    ("wrong", "words"),
    [("pbsv", "did you mean 'pbvs'"), ("mine.py", "FILE.py:CLASS"), ("x.py:a b", "legal: certified")],
)
def test_a_wrong_name_is_refused_with_the_legal_ones(wrong, words):
    with pytest.raises(InputError, match=words):
        run_method(wrong)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--method", "sphericle"], "did you mean 'spherical'"),
        (["--method", "nowhere.py:Mine"], "nowhere.py"),
        (["--on", "robot.yaml", "--method", "pbvs"], "pbvs given; a real arm follows certified plans alone"),
        (["--on", "robot.yaml", "--method", "certified", "--method", "ibvs"], "certified, ibvs given"),
    ],
)
def test_a_wrong_method_is_refused_at_once_by_the_command(capsys, arguments, words):
    code, out, err = call(capsys, "run", "paper-example-1", *arguments)
    assert (code, out) == (2, "")
    assert words in err
    assert err.count("\n") == 1
