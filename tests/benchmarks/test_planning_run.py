"""The benchmark from end to end on three problems, and that its judges know right from wrong."""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from omniservo.planning import CameraPath, Sphere

pytest.importorskip("benchmarks.comparisons.planning", reason="benchmarks/ is not part of this copy")

from benchmarks.comparisons.planning.__main__ import main
from benchmarks.comparisons.planning.attempt import Attempt, Polyline
from benchmarks.comparisons.planning.methods import Method, ours
from benchmarks.comparisons.planning.neutral import neutral_of
from benchmarks.comparisons.planning.path_space import PathSpace
from benchmarks.comparisons.planning.runner import measured, run_set
from benchmarks.comparisons.planning.scoring import energy, score
from benchmarks.comparisons.planning.sets import problem
from benchmarks.comparisons.planning.summary import summaries


@pytest.mark.slow
def test_a_run_writes_its_page_its_rows_and_its_plot(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    main(["--count", "3", "--sets", "fisheye", "--methods", "first", "paper-compiled", "--out", "out"])
    page = Path("out/benchmark-planning.md").read_text()
    assert "ours, first path (kernel) | 3 | 3 | 3 | 100.0% | 0 |" in page
    assert "the paper's search, compiled | 3 |" in page
    assert page in capsys.readouterr().out
    with Path("runs/benchmark-planning/rows.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert {(row["index"], row["method"]) for row in rows} == {
        (index, method) for index in "012" for method in ("first", "paper-compiled")
    }
    assert all(float(row["seconds"]) > 0.0 for row in rows)
    assert {path.suffix for path in Path("out/images").iterdir()} == {".png", ".svg"}


def test_a_path_that_is_violated_between_samples_is_not_feasible() -> None:
    one = problem("fisheye", 0)
    path = next(iter(run_set_paths(one)))
    found = score(one, neutral_of(one), Attempt(True, path, 0.0))
    assert found.feasible
    assert not found.violated
    thorn = replace(one, obstacles=(*one.obstacles, Sphere(path.positions(0.5012), 0.0, 1e-4)))
    pierced = score(thorn, neutral_of(thorn), Attempt(True, path, 0.0))
    assert not pierced.feasible
    assert pierced.violated
    assert pierced.family == "clearance"


def run_set_paths(one):
    yield ours()[0].solve(one, neutral_of(one), 1.0).path


def test_a_path_that_ends_elsewhere_is_violated() -> None:
    one = problem("fisheye", 0)
    path = next(iter(run_set_paths(one)))
    short = CameraPath(path.rotation, 0.999 * path.translation)
    found = score(one, neutral_of(one), Attempt(True, short, 0.0))
    assert (found.feasible, found.violated) == (False, True)


def test_a_polyline_is_judged_by_looking() -> None:
    one = problem("perspective", 0)
    path = next(iter(run_set_paths(one)))
    poses = path(np.linspace(0.0, 1.0, 200))
    good = score(
        one, neutral_of(one), Attempt(True, Polyline(poses.rotation.as_quat(), poses.translation), 0.0)
    )
    straight = Slerp([0.0, 1.0], Rotation.concatenate([Rotation.identity(), one.initial_T_goal.rotation]))
    ends = Polyline(straight([0.0, 1.0]).as_quat(), np.array([np.zeros(3), one.goal_translation]))
    bad = score(one, neutral_of(one), Attempt(True, ends, 0.0))
    assert (good.feasible, good.violated) == (True, False)
    assert (bad.feasible, bad.violated) == (False, True)


def test_energy_is_that_of_the_path_space() -> None:
    one = problem("fisheye", 1)
    neutral = neutral_of(one)
    space = PathSpace(neutral, 2, 3)
    x = np.random.default_rng(0).normal(size=space.size)
    assert energy(neutral, space.path(x)) == pytest.approx(space.energy(x), rel=1e-9)


def test_a_method_that_raises_is_a_row_and_the_rest_goes_on() -> None:
    def fail(*_: object) -> Attempt:
        raise ArithmeticError("no")

    calls = iter([None, None])  # the two problems that warm up

    def fail_later(*given: object) -> Attempt:
        return Attempt(False, None, 0.0) if next(calls, 1) is None else fail(*given)

    methods = [Method("broken", "broken", "Python", fail_later), ours()[0]]
    rows = list(run_set("fisheye", methods, 2))
    assert [row.note for row in rows if row.method == "broken"] == ["ArithmeticError: no"] * 2
    found = {s.method.name: s for s in summaries(rows, methods)}
    assert (found["first"].success, found["broken"].success) == (1.0, 0.0)
    assert found["broken"].solvable == 2


def test_short_calls_are_repeated_and_their_median_counts() -> None:
    one = problem("paper", 0)
    seconds = iter([9.0, 1.0, 3.0, 2.0])
    method = Method("m", "m", "Python", lambda *_: Attempt(False, None, next(seconds)))
    clock = iter([0.0, 0.001, 0.0, 0.005, 0.010, 0.015, 0.025])
    attempt, calls = measured(method, one, neutral_of(one), clock=lambda: next(clock))
    assert (attempt.seconds, calls) == (2.0, 3)
