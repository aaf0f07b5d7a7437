import math
from dataclasses import replace

import pytest
from scipy.stats import binomtest
from tests.studies.conftest import rows_of

from omniservo.errors import InputError
from omniservo.studies import Rate, StudyTally, compare_studies


def summarised(rows):
    return StudyTally(rows).summaries()


@pytest.mark.parametrize(("count", "of"), [(0, 10), (3, 10), (10, 10), (731, 1000), (1, 1)])
def test_the_interval_is_scipy_s_wilson_interval(count, of):
    known = binomtest(count, of).proportion_ci(method="wilson")
    assert Rate(count, of).interval == pytest.approx((known.low, known.high), abs=1e-12)


def test_nothing_says_nothing():
    assert math.isnan(Rate(0, 0).share)
    assert Rate(0, 0).interval == (0.0, 1.0)


def test_rows_without_a_scene_are_left_out_and_crashes_are_not(undisturbed):
    rows = [row for row in rows_of(undisturbed) if row.method == "ibvs"]
    spoilt = [replace(rows[0], status="no_scene"), replace(rows[1], status="error", success=False), *rows[2:]]
    (found,) = summarised(spoilt)
    assert found.success.of == len(rows) - 1
    assert found.statuses["error"] == 1


def test_collisions_are_counted_of_the_rows_with_an_obstacle(undisturbed):
    rows = rows_of(undisturbed)
    for found in summarised(rows):
        own = [row for row in rows if row.method == found.method and row.obstacles]
        assert 0 < found.collision.of == len(own) < found.success.of
        assert found.collision.count == sum(row.collision for row in own)


def test_two_equal_studies_do_not_differ(undisturbed):
    for found in compare_studies(rows_of(undisturbed), rows_of(undisturbed)):
        low, high = found.interval
        assert low <= 0.0 <= high
        assert not found.differs
        assert found.lost == found.won == ()


def test_rows_that_are_lost_and_won_are_named(undisturbed):
    before = [replace(row, success=row.row % 2 == 0) for row in rows_of(undisturbed)]
    after = [replace(row, success=row.row % 3 == 0) for row in before]
    first = compare_studies(before, after)[0]
    assert first.lost == tuple(
        r.row for r in before if r.method == first.method and r.row % 2 == 0 and r.row % 3
    )
    every = [replace(row, success=True) for row in before]
    none = [replace(row, success=False) for row in before]
    assert all(found.differs and found.interval[1] < -0.5 for found in compare_studies(every, none))


def test_newcombe_s_example_has_his_interval():
    """Newcombe (1998), 56/70 and 48/80 by method 10: 0.0524 to 0.3339."""
    from omniservo.studies import MethodDifference

    found = MethodDifference("any", Rate(48, 80), Rate(56, 70), (), ())
    assert found.interval == pytest.approx((0.0524, 0.3339), abs=5e-5)


def test_studies_without_a_common_method_are_refused(undisturbed):
    rows = rows_of(undisturbed)
    with pytest.raises(InputError, match="no method in common"):
        compare_studies(rows, [replace(row, method="other") for row in rows])
