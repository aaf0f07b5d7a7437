"""The table paper / ours."""

from dataclasses import replace

import numpy as np

from omniservo.reporting import comparison_table, paper_table_markdown
from omniservo.reporting.curves import planned_curve


def value(rows, quantity):
    return next(row for row in rows if row.quantity.startswith(quantity))


def test_the_papers_numbers_of_both_examples_stand_in_the_table(made_up_run):
    one = comparison_table(made_up_run("paper-example-1"))
    two = comparison_table(made_up_run("paper-example-2"))
    assert value(one, "smallest distance").paper == "66.127"
    assert value(two, "smallest distance").paper == "82.249"
    assert value(one, "safe distance").paper == "55"
    assert value(two, "path planning").paper == "1.814 s"


def test_our_planned_distance_is_that_of_the_path(run):
    positions = planned_curve(run).positions
    centres = np.array([o.center for o in run.task.planning.obstacles])
    smallest = np.linalg.norm(positions[:, None] - centres, axis=-1).min()
    assert float(value(comparison_table(run), "smallest distance").ours) == np.round(1e3 * smallest, 2)


def test_a_run_that_touched_says_so(run):
    log = replace(run.log, contacts={("wrist", "obstacle 0")})
    assert "touches" in value(comparison_table(replace(run, log=log)), "arm to the obstacle").ours


def test_another_task_has_no_rows(run):
    other = replace(run, task=run.task.model_copy(update={"name": "other"}))
    assert comparison_table(other) == ()
    assert paper_table_markdown([other]) == ""


def test_markdown_has_two_columns_for_every_run_and_equal_rows(run, made_up_run):
    lines = paper_table_markdown([run, made_up_run("paper-example-2")]).strip().split("\n")
    assert {line.count("|") for line in lines} == {7}
    assert "example 1: paper" in lines[0]
    assert "example 2: certified" in lines[0]
