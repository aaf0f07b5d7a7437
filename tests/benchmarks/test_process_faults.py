"""Whatever a run over processes must not do makes it a failure, and rows survive an interruption."""

import json
from dataclasses import asdict, replace

import pytest

pytest.importorskip("benchmarks.process_faults", reason="benchmarks/ is not part of this copy")

from benchmarks.process_faults import HARMLESS, KINDS, Row, rows_of, table

SOUND = Row(0, "leader SIGKILL", 0.05, 0.16, 0, resumed=False, reason="", waited=0.0, load=1.0)


@pytest.mark.parametrize("wrong", [{"moved": 0.17}, {"after": 1}, {"resumed": True}])
def test_an_arm_that_rests_late_is_commanded_after_a_stop_or_moves_again_fails(wrong):
    assert not SOUND.fails
    assert replace(SOUND, **wrong).fails


def test_names_in_another_order_must_not_end_a_run():
    run = replace(SOUND, kind=HARMLESS[0], moved=2.0, reason="goal")
    assert not run.fails
    assert replace(run, reason="not_following").fails


def test_rows_are_read_back_but_for_one_that_was_cut_off_and_every_kind_has_a_line(tmp_path):
    rows, file = [replace(SOUND, kind=kind) for kind in KINDS], tmp_path / "rows.jsonl"
    file.write_text("".join(json.dumps(asdict(row)) + "\n" for row in rows) + '{"run": 7')
    assert rows_of([file]) == rows
    assert len(list(table(rows))) == 2 + len(KINDS)
