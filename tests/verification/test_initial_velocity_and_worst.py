"""The velocity that the path must start with, and the line that the plan calls its worst."""

import copy

import numpy as np
import pytest
from sampled_plans import path, plan, problem, true_margins

from omniservo.planning import CameraPath
from omniservo.verification import verify_plan

DETOUR, TWIST = (0.06, 0.0, 0.0), (0.03, -0.02, 0.01, 0.05)


@pytest.fixture(scope="module")
def certified():
    asked = problem()
    way = path(asked, DETOUR, TWIST)
    way["rotation"] = (2.5 * np.array(way["rotation"])).tolist()  # its length does not matter
    document = plan(asked, way)
    asked["initial_velocity"] = CameraPath(way["rotation"], way["translation"])(0.0, 1).tolist()
    answer = verify_plan(document)
    assert answer.status == "certified", answer.reasons
    return document


@pytest.fixture
def honest(certified):
    """A certified plan, free to be changed."""
    return copy.deepcopy(certified)


@pytest.mark.parametrize("k", range(6))
def test_each_component_of_the_velocity_is_judged(honest, k):
    for by in (0.9e-9, -0.9e-9, 1.1e-9, -1e-3):
        status = "certified" if abs(by) < 1e-9 else "refuted"
        changed = copy.deepcopy(honest)
        changed["problem"]["initial_velocity"][k] += by
        answer = verify_plan(changed)
        assert answer.status == status, answer.reasons
        if status == "refuted":
            assert ("linear" if k < 3 else "angular") in answer.reasons[0]


def test_a_path_that_starts_with_another_velocity_is_refuted(honest):
    changed = copy.deepcopy(honest)
    changed["path"] = path(honest["problem"], (0.06, 0.0, 1e-6), TWIST)
    assert any("linear velocity" in r for r in verify_plan(changed).reasons)
    changed["path"] = path(honest["problem"], DETOUR, (0.03, -0.02, 0.01 + 1e-6, 0.05))
    assert any("angular velocity" in r for r in verify_plan(changed).reasons)
    honest["problem"]["initial_velocity"] = [0.0] * 6
    assert verify_plan(honest).status == "refuted"


@pytest.mark.parametrize("velocity", [[0.0] * 5, 0.0, [0.0] * 5 + [float("inf")], ["0"] * 6])
def test_a_malformed_velocity_is_refuted(honest, velocity):
    honest["problem"]["initial_velocity"] = velocity
    answer = verify_plan(honest)
    assert answer.status == "refuted"
    assert "problem.initial_velocity" in answer.reasons[0]


def test_the_worst_line_must_stand_among_the_lines_word_for_word(honest):
    worst = honest["certificate"]["worst"]
    for change in (
        {"name": "clearance obstacle 9"},
        {"name": worst["name"] + " "},
        {"margin": worst["margin"] * (1 + 1e-12)},
        {"margin": worst["margin"] - 1e-12},
        {"unit": "px"},
    ):
        changed = copy.deepcopy(honest)
        changed["certificate"]["worst"].update(change)
        answer = verify_plan(changed)
        assert answer.status == "refuted"
        assert "certificate.worst" in answer.reasons[0]


def test_no_line_of_its_unit_may_have_less_left_than_the_worst(honest):
    lines = honest["certificate"]["constraints"]
    lengths = sorted((line for line in lines if line["unit"] == "m"), key=lambda line: line["margin"])
    pixels = sorted((line for line in lines if line["unit"] == "px"), key=lambda line: line["margin"])
    for line in lengths[1:] + pixels[1:]:
        honest["certificate"]["worst"] = dict(line)
        assert "smaller margin" in verify_plan(honest).reasons[0]
    for line in (lengths[0], pixels[0]):
        honest["certificate"]["worst"] = dict(line)
        assert verify_plan(honest).status == "certified"


@pytest.mark.parametrize("worst", [3, [], True, {"name": 3}, {"name": "rotation", "unit": "1"}])
def test_a_malformed_worst_is_refuted(honest, worst):
    honest["certificate"]["worst"] = worst
    assert verify_plan(honest).status == "refuted"
    honest["certificate"]["worst"] = dict(honest["certificate"]["constraints"][0], w=1.5)
    assert "w" in verify_plan(honest).reasons[0]


def test_a_plan_may_name_its_worst_line_or_none(honest):
    for worst in (None, honest["certificate"]["worst"]["name"]):
        honest["certificate"]["worst"] = worst
        assert verify_plan(honest).status == "certified"
    honest["certificate"]["worst"] = "beauty"
    assert verify_plan(honest).status == "refuted"
    del honest["certificate"]["worst"]
    assert verify_plan(honest).status == "certified"


def test_reference_of_the_velocity_is_the_paths_own_difference_quotient(honest):
    way = honest["path"]
    w = np.array([0.0, 1e-7])
    t = np.array([np.polyval(row, w) for row in way["translation"]])
    assert (t[:, 1] - t[:, 0]) / 1e-7 == pytest.approx(honest["problem"]["initial_velocity"][:3], abs=1e-6)
    assert true_margins(honest["problem"], way, 5)
