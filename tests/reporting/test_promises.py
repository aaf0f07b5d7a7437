"""What is said to be certified is the least of what is proven, and nothing where it is not."""

from types import SimpleNamespace

import pytest
from tests.cli.test_first_contact import METRICS

from omniservo.reporting.margins import certified_clearance, certified_visibility
from omniservo.reporting.run_summary import run_summary
from omniservo.reporting.spelling import reads_less


class Kept:
    """A plan that keeps so much."""

    def __init__(self, status, clearance, visibility):
        self.status, self.kept = status, (clearance, visibility)

    def least_clearance(self, obstacles):
        assert obstacles == [0]
        return self.kept[0]

    def least_visibility(self):
        return self.kept[1]


def run_of(first, *later):
    return SimpleNamespace(
        plan=first,
        replannings=[SimpleNamespace(plan=plan) for plan in later],
        task=SimpleNamespace(planning=SimpleNamespace(common_obstacles=[0])),
    )


def test_of_all_plans_that_were_followed_the_least_is_certified():
    run = run_of(Kept("certified", 0.06, 40.0), Kept("certified", 0.04, 90.0), None)
    assert (certified_clearance(run), certified_visibility(run)) == (0.04, 40.0)


def test_a_plan_that_was_not_certified_promises_nothing():
    for run in (run_of(Kept("undecided", 0.06, 40.0)), run_of(None)):
        assert certified_clearance(run) is certified_visibility(run) is None


@pytest.mark.parametrize("value", [65.34, 65.3449])
def test_what_reads_the_same_reads_no_less(value):
    assert not reads_less(value, 65.34, "px")
    assert reads_less(65.33, 65.34, "px")


def test_a_run_s_lines_round_what_is_certified_down_and_name_the_nearest_link():
    told = METRICS | {
        "plan_status": "certified",
        "clearance_planned_m": 0.0649999,
        "clearance_executed_m": 0.065,
        "arm_clearance_executed_m": 0.009,
        "link_clearance_executed_m": 0.005,
    }
    lines = "\n".join(run_summary(told))
    assert "camera to obstacles   ≥ 64.99 mm certified" in lines
    assert "any link to anything  5.00 mm executed" in lines
