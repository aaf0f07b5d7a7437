"""A first run lets another process compile, where there is a core for it and much to compile."""

import contextlib
import os
import subprocess

import pytest

from omniservo.geometry.kernel_cache import user_folder
from omniservo.planning.search.search import search
from omniservo.runs.compile_ahead import ENOUGH, compile_ahead, compiling_ahead, usable_cores
from omniservo.tracking.step_kernel import track_step


@pytest.fixture
def empty_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return user_folder()


@pytest.mark.slow
@pytest.mark.skipif(usable_cores() < 2, reason="needs two cores")
def test_the_other_process_keeps_kernels_where_this_one_looks_and_ends_with_it(empty_cache):
    with compiling_ahead() as child:
        while not list(empty_cache.glob("*.kernel")):
            with contextlib.suppress(subprocess.TimeoutExpired):
                child.wait(0.05)
            assert child.poll() is None
    assert child.returncode is not None


def test_there_is_none_where_most_is_compiled(empty_cache):
    empty_cache.mkdir(parents=True)
    for k in range(ENOUGH):
        (empty_cache / f"{k}.kernel").touch()
    with compiling_ahead() as child:
        assert child is None


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="cores cannot be chosen here")
def test_there_is_none_on_one_core(empty_cache):
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, list(cores)[:1])
    try:
        with compiling_ahead() as child:
            assert child is None
    finally:
        os.sched_setaffinity(0, cores)


def test_it_calls_the_search_and_the_trackers_step():
    compile_ahead()
    assert search.signatures
    assert track_step.signatures
