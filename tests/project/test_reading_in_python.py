"""What a person sees who reads values and classes in Python: completion, help and short lines."""

import dataclasses
import importlib
import inspect
import pydoc
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

import omniservo
from omniservo.cameras import models
from omniservo.planning import Box, Cloud, Mesh, PlanningProblem
from omniservo.robots import load_arm
from omniservo.whole_arm import ArmSetting

ROOMS = (
    "omniservo", "omniservo.planning", "omniservo.safety", "omniservo.tracking", "omniservo.servoing",
    "omniservo.perception", "omniservo.robots", "omniservo.estimation", "omniservo.targets",
    "omniservo.calibration", "omniservo.calibration.hand_eye", "omniservo.calibration.boards",
    "omniservo.cameras",
)  # fmt: skip
LINE = 200


def public_dataclasses():
    found = {}
    for room in ROOMS:
        module = importlib.import_module(room)
        for name in module.__all__:
            value = getattr(module, name)
            if inspect.isclass(value) and dataclasses.is_dataclass(value):
                found[f"{room}.{name}"] = value
    return found


PUBLIC = public_dataclasses()


def test_every_public_name_can_be_completed():
    assert set(omniservo.__all__) <= set(dir(omniservo))
    assert not {"TYPE_CHECKING", "import_module"} & set(dir(omniservo))


def test_completing_names_imports_nothing():
    code = "import omniservo, sys; dir(omniservo); print('numpy' in sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "False"


@pytest.mark.parametrize("name", PUBLIC)
def test_help_has_every_public_field_with_what_stands_under_it_in_the_source(name):
    cls = PUBLIC[name]
    sections = inspect.getdoc(cls).partition("\n\n")[2]
    for field in dataclasses.fields(cls):
        if not field.name.startswith("_"):
            assert re.search(rf"^ +(\w+, )*{field.name}(, \w+)*: .", sections, re.MULTILINE), field.name


def public_callables(name):
    """Yield a public function or class, with its public methods."""
    value = getattr(omniservo, name)
    if not inspect.isclass(value):
        yield name, value
        return
    if not issubclass(value, Exception):
        yield name, value.__init__
    for method, held in vars(value).items():
        function = (
            getattr(held, "fget", None) or getattr(held, "func", None) or getattr(held, "__func__", held)
        )
        public = not method.startswith("_") and inspect.isfunction(function)
        if public and function.__module__ != "omniservo.renamed":  # names of before
            yield f"{name}.{method}", function


@pytest.mark.parametrize("name", omniservo.__all__)
def test_help_answers_for_every_public_name(name):
    value = getattr(omniservo, name)
    doc = inspect.getdoc(value)
    assert doc
    assert doc != inspect.getdoc(object)
    shown = pydoc.plain(pydoc.render_doc(value))
    assert doc.splitlines()[0] in shown
    for called, function in public_callables(name):
        assert function.__name__ == "__init__" or inspect.getdoc(function), called


@pytest.mark.parametrize("name", omniservo.__all__)
def test_every_public_name_states_all_its_types(name):
    for called, function in public_callables(name):
        signature = inspect.signature(function)
        given = [p for p in signature.parameters.values() if p.name not in ("self", "cls")]
        if signature.return_annotation is inspect.Signature.empty and function.__name__ == "__init__":
            given = [p for p in given if p.kind not in (p.VAR_POSITIONAL, p.VAR_KEYWORD)]
        else:
            assert signature.return_annotation is not inspect.Signature.empty, called
        assert all(p.annotation is not inspect.Parameter.empty for p in given), called


def test_the_package_says_that_it_is_typed():
    assert (Path(omniservo.__file__).parent / "py.typed").is_file()


def test_help_of_an_option_says_what_it_means():
    shown = pydoc.plain(pydoc.render_doc(omniservo.TrackerOptions))
    assert "gate_px: A point farther than this [px]" in shown
    assert "delay: From the exposure of an image" in shown


def test_a_class_without_a_source_keeps_its_own_words():
    made = dataclasses.make_dataclass("Made", ["width"])
    made.__doc__ = "A thing."
    from omniservo.field_docs import with_field_docs

    assert with_field_docs(made).__doc__ == "A thing."


@pytest.fixture(scope="module")
def problem():
    return PlanningProblem(
        camera=omniservo.preset("fe185"),
        points=np.array([[0.002 * i - 0.2, 0.05 * (i % 3), 1.0 + 0.002 * (i % 7)] for i in range(200)]),
        initial_T_goal=RigidTransform.from_translation([0.1, 0.0, 0.3]),
    )


def test_a_plan_reads_as_one_line_with_its_verdict_and_margins(problem):
    plan = omniservo.plan_path(problem)
    line = repr(plan)
    assert line.startswith(f"Plan({plan.status}, degrees {plan.path.degrees}, visibility ")
    assert line.endswith(" ms)")
    assert len(line) < LINE


def values(problem):
    rng = np.random.default_rng(3)
    plan = omniservo.plan_path(problem)
    camera = problem.camera
    first = camera.project(problem.points)[0]
    second = camera.project(problem.initial_T_goal.inv().apply(problem.points))[0]
    arm = load_arm("rx60")
    yield from (plan, plan.path, plan.certificate, problem, camera, arm)
    yield from (omniservo.verify_plan(plan), omniservo.PathTracker(plan, camera))
    yield omniservo.estimate_two_view(camera, first, second, scale=0.3)
    yield omniservo.estimate_pose(camera, problem.points, first)
    yield omniservo.estimate_views(camera, np.stack([first, second]))
    yield omniservo.KnownPoints(np.arange(200), problem.points)
    yield omniservo.Target(tuple(f"point {i}" for i in range(200)), problem.points)
    yield Cloud(rng.normal(size=(500, 3)), 0.01)
    yield Mesh(rng.normal(size=(50, 3)))
    yield Box(np.zeros(3), np.full(3, 0.1), np.array([0.0, 0.0, 0.0, 1.0]))
    yield models.KannalaBrandt(300.0, 300.0, 320.0, 240.0, 640, 480, k=(0.1, 0.01, 0.001, 0.0))
    yield ArmSetting(arm, RigidTransform.identity(), RigidTransform.identity())


def test_every_value_reads_as_one_short_line(problem):
    for value in values(problem):
        line = repr(value)
        assert len(line) <= LINE, line
        assert "\n" not in line
        assert "array(" not in line
        assert line.startswith(type(value).__name__)
