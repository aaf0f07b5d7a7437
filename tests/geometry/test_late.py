"""What is late is compiled at its first call by a kernel, in this process or by what another has kept."""

import os
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

import omniservo
from omniservo.geometry import late as cells
from omniservo.geometry.compiler_watch import CompilerWatch
from omniservo.geometry.kernel import kernel, late

SOURCE = Path(omniservo.__file__).parents[1]

JUDGED = """
import sys
import omniservo
from omniservo.geometry.compiler_watch import CompilerWatch
from omniservo.planning.end_poses import violation_at_end

obstacles = {
    "ball": {"type": "sphere", "center": [0, -0.05, 0.1], "radius": 0.02},
    "wall": {"type": "half_space", "normal": [0, 0, 1], "offset": -0.3},
}
names = []
with CompilerWatch(names.append) as watch:
    for obstacle in sys.argv[1:]:
        violation_at_end(omniservo.PlanningProblem.from_dict({
            "format": "omniservo.problem/1",
            "camera": omniservo.preset("fe185").to_dict(),
            "points": [[x, y, 0.5 + abs(x)] for x in (-0.1, 0, 0.1) for y in (-0.1, 0, 0.1)],
            "goal": {"translation": [0, -0.1, 0.2], "quaternion": [0, 0, 0, 1]},
            "obstacles": [obstacles[obstacle]],
            "clearance": 0.05,
        }))
print(*names)
"""


@pytest.fixture(scope="module")
def compiled_by(tmp_path_factory):
    """What a process compiles that judges the ends of paths past a ball or a wall, after those before it."""
    cache = tmp_path_factory.mktemp("cache")

    def names(*obstacles):
        environment = os.environ | {"XDG_CACHE_HOME": str(cache), "PYTHONPATH": str(SOURCE)}
        command = [sys.executable, "-c", JUDGED, *obstacles]
        return subprocess.run(
            command, env=environment, capture_output=True, text=True, check=True
        ).stdout.split()

    return names


@pytest.mark.slow
def test_families_that_a_problem_lacks_are_not_compiled_and_later_only_what_was_lacking(compiled_by):
    first, second = set(compiled_by("ball")), set(compiled_by("wall"))
    assert "pose_margins" in first
    assert not first & {"free_side_margin", "body_margin", "cloud_margin", "mask_margin", "sight_margin"}
    assert "free_side_margin" in second
    assert not second & {"pose_margins", "body_margin", "cloud_margin", "mask_margin", "sight_margin"}
    assert compiled_by("wall", "ball") == []


@late
def _inverse(x: float, values: np.ndarray) -> tuple[int, float]:
    if x == 0.0:
        raise ZeroDivisionError("of nothing")
    values[0] += 1.0
    return 7, 1.0 / x


@kernel
def _sum_of_inverses(n: int, values: np.ndarray) -> float:
    total = 0.0
    for k in range(n):
        _, inverse = _inverse(k + values[1], values)
        total += inverse
    return total


def test_a_late_kernel_gives_what_it_gives_in_python_and_its_errors_reach_the_caller():
    values = np.array([0.0, 1.0])
    assert _sum_of_inverses(0, values) == 0.0
    assert _inverse(2.0, values) == (7, 0.5)
    assert _sum_of_inverses(4, values) == pytest.approx(1.0 + 1 / 2 + 1 / 3 + 1 / 4, rel=1e-15)
    assert values[0] == 5.0
    with pytest.raises(ZeroDivisionError, match="of nothing"):
        _sum_of_inverses(1, np.zeros(2))


@late
def _first(values: np.ndarray) -> float:
    return values[0]


@kernel
def _calls_first(values: np.ndarray) -> float:
    return _first(values)


def test_a_late_kernel_is_compiled_for_each_type_of_its_arguments():
    for kind in (np.float64, np.float32, np.int64):  # returned as the annotation says, whoever calls first
        values = np.array([3, 4], dtype=kind)
        if kind is np.int64:
            assert _first(values) == 3.0
        assert _calls_first(values) == 3.0
        assert _first(values) == 3.0


def test_what_returns_an_array_cannot_be_late():
    def ones(n: int) -> np.ndarray:
        return np.ones(n)

    with pytest.raises(TypeError, match="numbers alone"):
        late(ones)


@late
def _slow(x: float) -> float:
    return 3.0 * x


@kernel
def _calls_slow(x: float) -> float:
    return _slow(x) + 1.0


@pytest.mark.parametrize(("interrupt", "args"), [(KeyboardInterrupt, ()), (SystemExit, (143,))])
def test_an_interrupt_while_compiling_reaches_the_caller_and_the_next_call_compiles(
    monkeypatch, interrupt, args
):
    def interrupted(symbol):
        raise interrupt(*args)

    for cell in cells._cells.values():
        if cell.kernel.name == "_slow":
            cell.address.value = None
    with monkeypatch.context() as patch:
        patch.setattr(cells, "_fill_cell", interrupted)
        with pytest.raises(interrupt) as caught:
            _calls_slow(2.0)
    assert caught.value.args == args
    assert _calls_slow(2.0) == 7.0


@late
def _twice(x: float) -> float:
    return x + x


@kernel
def _calls_twice(x: float) -> float:
    return _twice(x)


def test_threads_that_call_at_once_all_get_the_answer():
    _calls_twice.compile("float64(float64)")
    begin, answers = threading.Barrier(4), []

    def call(x):
        begin.wait()
        answers.append(_calls_twice(x))

    threads = [threading.Thread(target=call, args=(float(k),)) for k in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(answers) == [0.0, 2.0, 4.0, 6.0]


@late
def _unused(x: float) -> float:
    return _twice(x) + 0.5


@kernel
def _may_use(x: float, use: bool) -> float:
    return _unused(x) if use else x


def test_fill_all_compiles_what_was_never_called():
    assert _may_use(1.0, False) == 1.0
    assert not cells._functions[__name__, "_unused"].signatures
    cells.fill_all()
    with CompilerWatch() as watch:
        assert _may_use(1.0, True) == 2.5
    assert watch.compiled == 0
