import math
import statistics
import sys
from collections import Counter
from dataclasses import replace

import numpy as np
import pyarrow.parquet as parquet
import pytest
from scipy.stats import binom, binomtest
from tests.studies.conftest import rows_of

from omniservo.errors import InputError, NotWritten
from omniservo.reporting.study_report import write_study_report
from omniservo.studies import (
    PACKAGE,
    Rate,
    RateDifference,
    StudyTally,
    compare_studies,
    read_header,
    write_rows,
)
from omniservo.studies.study_summary import RATES, Median


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
        assert set(found.rates) == set(RATES) == {"success", *found.to_dict()["rates"]}
        for rate in found.rates.values():
            low, high = rate.interval
            assert low <= 0.0 <= high or not rate.before.of
            assert not rate.differs
        assert all(before == after for before, after in found.medians.values() if before.value == after.value)
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
    changes = [found.success for found in compare_studies(every, none)]
    assert all(change.differs and change.interval[1] < -0.5 for change in changes)


def test_newcombe_s_example_has_his_interval():
    """Newcombe (1998), 56/70 and 48/80 by method 10: 0.0524 to 0.3339."""
    found = RateDifference(Rate(48, 80), Rate(56, 70))
    assert found.interval == pytest.approx((0.0524, 0.3339), abs=5e-5)


def test_pairs_have_newcombe_s_correlation_and_those_that_agree_by_chance_alone_have_none():
    """φ of 20, 12, 2 and 16 pairs: (20·16 − 12·2 − 50/2) / √(32·18·22·28)."""
    kinds = ((True, True), (True, False), (False, True), (False, False))

    def correlation(*counts):
        pairs = Counter(dict(zip(kinds, counts, strict=True)))
        rates = Rate(counts[0] + counts[1], pairs.total()), Rate(counts[0] + counts[2], pairs.total())
        return RateDifference.of(*rates, pairs).correlation

    assert correlation(20, 12, 2, 16) == pytest.approx(271.0 / math.sqrt(32 * 18 * 22 * 28))
    assert correlation(5, 5, 5, 6) == 0.0
    assert correlation(5, 6, 5, 5) == pytest.approx(-5.0 / math.sqrt(11 * 10 * 10 * 11))


def test_the_interval_of_pairs_holds_the_difference_as_often_as_stated_and_is_half_as_wide():
    """Rows of one study, most of which come out alike: samples taken as independent cover it always."""
    random, n, chances = np.random.default_rng(3), 250, (0.7, 0.02, 0.08, 0.2)
    held, widths = [], []
    for counts in random.multinomial(n, chances, 400).tolist():
        kinds = ((True, True), (True, False), (False, True), (False, False))
        pairs = Counter(dict(zip(kinds, counts, strict=True)))
        rates = Rate(counts[0] + counts[1], n), Rate(counts[0] + counts[2], n)
        paired, apart = RateDifference.of(*rates, pairs), RateDifference(*rates)
        held.append(paired.interval[0] <= 0.06 <= paired.interval[1])
        widths.append([each.interval[1] - each.interval[0] for each in (paired, apart)])
    assert 0.93 <= np.mean(held) <= 0.99
    assert np.mean(widths, axis=0)[0] < 0.6 * np.mean(widths, axis=0)[1]


def test_rates_of_other_rows_are_not_taken_for_pairs(undisturbed):
    rows = rows_of(undisturbed)
    before = [replace(row, success=row.row % 2 == 0) for row in rows]
    other = [replace(row, study_hash="another") for row in before]
    same, apart = (compare_studies(before, after)[0].success for after in (before, other))
    assert same.correlation > 0.5
    assert apart.correlation == 0.0
    assert same.interval[1] < apart.interval[1]
    gone = next(row.row for row in before if row.method == before[0].method)
    some = [replace(row, status="no_scene") if row.row == gone else row for row in before]
    assert compare_studies(before, some)[0].success.correlation == 0.0


def test_studies_without_a_common_method_are_refused(undisturbed):
    rows = rows_of(undisturbed)
    with pytest.raises(InputError, match="no method in common that has rows with a scene: cert.* and other"):
        compare_studies(rows, [replace(row, method="other") for row in rows])


def test_a_tally_has_what_all_rows_at_once_have(undisturbed):
    rows = rows_of(undisturbed)
    rows[3] = replace(rows[3], success=True, seconds=0.1, path_length_m=2.0)
    rows[6] = replace(rows[6], success=True, seconds=0.4, path_length_m=1.0, collision=True)
    tally = StudyTally(iter(rows))
    assert (tally.rows, tally.without) == (len(rows), 0)
    for found in tally.summaries():
        own = [row for row in rows if row.method == found.method]
        good = [row for row in own if row.success]
        assert found.success == Rate(len(good), len(own))
        assert found.feature_lost == Rate(sum(row.feature_lost for row in own), len(own))
        assert found.diverged == Rate(sum(row.diverged for row in own), len(own))
        assert found.statuses == {s: sum(r.status == s for r in own) for s in sorted({r.status for r in own})}
        if good:
            assert found.seconds.value == statistics.median(row.seconds for row in good)
            assert found.path_length_m.value == statistics.median(row.path_length_m for row in good)
            assert found.translation_m.value == statistics.median(
                row.final_translation_error_m for row in good
            )
        kept = tally.methods[found.method]
        assert list(kept.turned) == [row.start_rotation_rad for row in own]
        assert list(kept.reached) == [row.success for row in own]


def test_the_worst_rows_are_ten_and_two_of_each_method_come_before_others(undisturbed):
    rows = [
        replace(row, success=False, collision=False, final_translation_error_m=0.001 * (row.row % 17))
        for row in rows_of(undisturbed)
    ]
    rows[9] = replace(rows[9], collision=True, final_translation_error_m=0.0)
    worst = StudyTally(reversed(rows)).worst(10)
    assert worst[0] == rows[9]
    others = [row.final_translation_error_m for row in worst[1:]]
    assert others == sorted(others, reverse=True)
    assert len(worst) == 10
    for method in ("ibvs", "pbvs"):
        own = sorted((row.final_translation_error_m for row in rows if row.method == method), reverse=True)
        shown = [row.final_translation_error_m for row in worst if row.method == method]
        assert len(shown) >= 2
        assert shown == own[: len(shown)]
    alone = [row for row in rows if row.method == "pbvs"]
    assert len(StudyTally(alone).worst(10)) == 10


def test_crashes_come_first_of_the_worst_and_what_never_moved_last(undisturbed):
    rows = [replace(row, success=True) for row in rows_of(undisturbed)]
    crash = replace(rows[0], success=False, status="error", final_translation_error_m=None, images=0)
    refused = replace(rows[3], success=False, status="not_planned", final_translation_error_m=0.9, images=0)
    missed = replace(rows[6], success=False, collision=False, final_translation_error_m=0.1, images=5)
    hit = replace(rows[4], success=False, collision=True, final_translation_error_m=0.5)
    assert StudyTally([refused, missed, hit, crash, *rows[9:]]).worst(10) == [crash, hit, missed, refused]


def test_stops_are_counted_by_their_names(undisturbed):
    rows = [row for row in rows_of(undisturbed) if row.method == "ibvs"][:4]
    reasons = ("feature_loss: 0 points", "divergence: 9 px: more", "feature_loss: 2 points")
    stopped = [replace(row, status="stopped", reason=why) for row, why in zip(rows, reasons, strict=False)]
    (found,) = summarised([*stopped, replace(rows[3], status="timed_out", reason="not: a stop")])
    assert found.stops == {"divergence": 1, "feature_loss": 2}


@pytest.mark.parametrize("count", [1, 5, 6, 7, 30, 101, 2000])
def test_a_median_s_interval_is_that_of_the_binomial_law(count):
    """Exact: numbers j and n + 1 − j leave out the median with chance 2 P(X < j), which is at most 5%."""
    numbers = [float(k) for k in range(1, count + 1)]
    found = Median.of(numbers[::-1])
    assert found.value == statistics.median(numbers)
    low, high = found.interval
    chance = [binom.cdf(j - 1, count, 0.5) for j in range(1, count + 1)]
    held = [j for j, outside in enumerate(chance, start=1) if outside <= 0.025]
    if not held:
        assert math.isnan(low)
        assert math.isnan(high)
        return
    assert (low, high) == (max(held), count + 1 - max(held))


def test_nothing_has_no_median():
    found = Median.of([])
    assert math.isnan(found.value)
    assert all(map(math.isnan, found.interval))


def test_a_table_in_several_groups_has_every_row_once(undisturbed, tmp_path, monkeypatch):
    monkeypatch.setattr("omniservo.studies.study_rows._TOGETHER", 20)
    rows = rows_of(undisturbed)
    table = parquet.ParquetFile(write_rows(tmp_path, iter(rows)))
    assert [table.metadata.row_group(k).num_rows for k in range(table.num_row_groups)] == [20, 20, 14]
    assert table.read().to_pylist() == [vars(row) for row in rows]
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    lines = write_rows(tmp_path, iter(rows)).read_text().splitlines()
    assert [line.split(",")[0] for line in lines] == ["row", *(str(row.row) for row in rows)]


def test_a_report_of_another_version_s_rows_draws_none_of_them_and_says_so(undisturbed, tmp_path):
    header, tally = read_header(undisturbed), StudyTally(rows_of(undisturbed))
    old = replace(header, version="0.1.0+00000000")
    write_study_report(old, tally, tmp_path / "report.html", PACKAGE)
    report = (tmp_path / "report.html").read_text()
    assert f"Not drawn: the rows were run by 0.1.0+00000000, and this is {PACKAGE.version}." in report
    assert "Two of each method" not in report


def test_a_study_without_a_scene_or_with_one_start_alone_has_its_report(undisturbed, tmp_path):
    header, rows = read_header(undisturbed), rows_of(undisturbed)
    old = replace(header, version="0.1.0+00000000")
    none = StudyTally(replace(row, status="no_scene", success=False) for row in rows)
    write_study_report(old, none, tmp_path / "none.html", PACKAGE)
    report = (tmp_path / "none.html").read_text()
    assert "54 rows had no scene" in report
    assert "<figure" not in report
    alike = [replace(row, success=False, start_rotation_rad=0.5, start_distance_ratio=1.0) for row in rows]
    write_study_report(old, StudyTally(alike * 30), tmp_path / "one.html", PACKAGE)
    report = (tmp_path / "one.html").read_text()
    assert report.count("<figure") == 2
    assert "grey: no start is there" in report


def test_a_table_that_cannot_be_written_leaves_the_one_before(undisturbed, tmp_path):
    rows = rows_of(undisturbed)
    before = write_rows(tmp_path, rows).read_bytes()

    def broken():
        yield rows[0]
        raise OSError(28, "No space left on device")

    with pytest.raises(NotWritten, match=r"rows.parquet: No space left on device"):
        write_rows(tmp_path, broken())
    assert [path.name for path in tmp_path.iterdir()] == ["rows.parquet"]
    assert (tmp_path / "rows.parquet").read_bytes() == before
