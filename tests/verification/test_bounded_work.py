"""Whatever stands in a plan file, the work is counted and bounded; long numbers count for more."""

import copy
import importlib
import sys
from contextlib import contextmanager

import numpy as np
import pytest
from benchmarks.hostile_plans import HOSTILE, TINY
from test_fuzzed_plans import BASE

from omniservo.verification import verify_plan, work

module = importlib.import_module("omniservo.verification.verify_plan")


@pytest.fixture
def counted(monkeypatch):
    """Judge a document with so much work allowed; return the answer and the operations that were done."""

    def judge(document, most=work.MOST_OPERATIONS):
        spent = []

        @contextmanager
        def kept():
            with bounded() as left:
                try:
                    yield left
                finally:
                    spent.append(most - left[0])

        bounded = work.bounded
        monkeypatch.setattr(work, "MOST_OPERATIONS", most)
        monkeypatch.setattr(module, "bounded", kept)
        answer = verify_plan(document)
        monkeypatch.undo()
        return answer, sum(spent, 0)

    return judge


def calls_of(function, *given):
    """How many functions, of Python or of C, the call calls: work that nobody has to declare."""
    calls = 0

    def count(frame, event, argument):
        nonlocal calls
        calls += event in ("call", "c_call")

    sys.setprofile(count)
    try:
        found = function(*given)
    finally:
        sys.setprofile(None)
    return found, calls


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_plan_is_answered_within_the_work_allowed(name, monkeypatch):
    document = HOSTILE[name](np.random.default_rng(1))
    most = 400_000
    monkeypatch.setattr(work, "MOST_OPERATIONS", most)
    answer, calls = calls_of(verify_plan, document)
    assert answer.status in ("undecided", "refuted")
    assert any("work" in reason for reason in answer.reasons) or answer.status == "refuted", answer.reasons
    assert calls < 2 * most


def test_long_numbers_count_for_more(counted):
    document = copy.deepcopy(BASE)
    for row in document["path"]["rotation"][:3]:
        row[-1] += TINY  # the same path, but integers a thousand bits longer
    answer, spent = counted(document)
    assert answer.status == "certified", answer.reasons
    assert spent > 2 * counted(copy.deepcopy(BASE))[1]


def test_an_honest_plan_takes_a_small_part_of_the_work(counted):
    answer, spent = counted(copy.deepcopy(BASE))
    assert answer.status == "certified"
    assert 0 < spent < work.MOST_OPERATIONS / 50


def test_what_is_violated_stays_refuted_where_the_work_ends(counted):
    document = copy.deepcopy(BASE)
    document["problem"]["obstacles"][0] |= {"radius": 0.45}
    spent = counted(document)[1]
    answers = [counted(document, int(share * spent))[0] for share in (0.001, *np.linspace(0.05, 0.95, 10))]
    cut = [a for a in answers if any("more work" in reason for reason in a.reasons)]
    assert {a.status for a in cut} == {"undecided", "refuted"}
    for answer in cut:
        found = any(
            reason.startswith("clearance obstacle 0: ") and "needed" in reason for reason in answer.reasons
        )
        assert found == (answer.status == "refuted"), answer.reasons


def test_a_little_work_is_never_enough_to_certify(counted):
    spent = counted(copy.deepcopy(BASE))[1]
    for share in (0.01, 0.3, 0.7, 0.99):
        answer, _ = counted(copy.deepcopy(BASE), int(share * spent))
        assert answer.status == "undecided"
        assert "more work" in answer.reasons[0]
    assert counted(copy.deepcopy(BASE), spent)[0].status == "certified"
