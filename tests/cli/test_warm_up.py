"""``omniservo warm-up`` remembers what it has done, and only that."""

import json

import pytest
from tests.cli.calling import call

from omniservo.cli import compiled_record
from omniservo.cli.compiled_record import CompiledRecord
from omniservo.geometry.compiler_watch import CompilerWatch
from omniservo.geometry.kernel_cache import user_folder


@pytest.fixture
def own_cache(tmp_path, monkeypatch):
    """No record yet, and of the jobs only those that take no whole run; kernels stay where they are."""
    import omniservo.runs.warm_up

    monkeypatch.setattr(compiled_record, "user_folder", lambda: tmp_path / "kernels")
    monkeypatch.setattr(omniservo.runs.warm_up, "_TASKS", ())
    return tmp_path


def test_a_second_warm_up_does_nothing_and_says_so(capsys, own_cache):
    code, out, _ = call(capsys, "warm-up", "--json")
    first = json.loads(out)
    assert (code, first["already"]) == (0, False)
    assert len(list(own_cache.rglob("*.json"))) == 1
    with CompilerWatch() as watch:
        code, out, err = call(capsys, "warm-up")
    assert (code, out, err) == (0, "everything is compiled already\n", "")
    assert (watch.compiled, watch.seconds) == (0, 0.0)


def test_warm_up_starts_again_where_a_kernel_is_gone_or_the_compiler_is_set_otherwise(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    record = CompiledRecord()
    assert not record.is_complete()
    user_folder().mkdir(parents=True)
    kernels = [user_folder() / f"{name}.kernel" for name in "ab"]
    for file in kernels:
        file.write_bytes(b"compiled")
    assert record.save()
    assert record.is_complete()
    kernels[0].unlink()
    assert not record.is_complete()
    assert record.save()
    monkeypatch.setenv("NUMBA_OPT", "1")
    assert not CompiledRecord().is_complete()


def test_where_nothing_can_be_remembered_warm_up_says_so(capsys, own_cache, monkeypatch):
    (own_cache / "kernels").write_text("no folder")
    code, out, _ = call(capsys, "warm-up")
    assert code == 0
    assert "it is not kept, as " in out
    assert "could not be written" in out
