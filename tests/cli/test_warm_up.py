"""``omniservo warm-up`` remembers what it has done, and only that."""

import json
import sys

import pytest
from tests.cli.calling import call

from omniservo.cli.compiled_record import CompiledRecord
from omniservo.geometry.compiler_watch import CompilerWatch


@pytest.fixture
def own_cache(tmp_path, monkeypatch):
    """No record yet, and of the jobs only those that take no whole run."""
    import omniservo.runs.warm_up

    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(omniservo.runs.warm_up, "_TASKS", ())
    return tmp_path


def test_a_second_warm_up_does_nothing_and_says_so(capsys, own_cache):
    code, out, _ = call(capsys, "warm-up", "--json")
    first = json.loads(out)
    assert (code, first["already"]) == (0, False)
    assert len(list((own_cache / "omniservo").iterdir())) == 1
    with CompilerWatch() as watch:
        code, out, err = call(capsys, "warm-up")
    assert (code, out, err) == (0, "everything is compiled already\n", "")
    assert (watch.compiled, watch.seconds) == (0, 0.0)


def test_warm_up_starts_again_where_a_file_is_gone_or_the_compiler_is_set_otherwise(own_cache, monkeypatch):
    assert not CompiledRecord().is_complete()
    assert "omniservo.planning" in sys.modules  # whose kernels are noted
    record = CompiledRecord()
    assert record.save()
    assert record.is_complete()
    files = json.loads(record.path.read_text())
    record.path.write_text(json.dumps([*files, str(own_cache / "gone.nbc")]))
    assert not record.is_complete()
    assert record.save()
    monkeypatch.setenv("NUMBA_OPT", "1")
    assert not CompiledRecord().is_complete()


def test_where_nothing_can_be_remembered_warm_up_says_so(capsys, own_cache, monkeypatch):
    (own_cache / "file").write_text("no folder")
    monkeypatch.setenv("XDG_CACHE_HOME", str(own_cache / "file"))
    code, out, _ = call(capsys, "warm-up")
    assert code == 0
    assert "could not be written" in out
