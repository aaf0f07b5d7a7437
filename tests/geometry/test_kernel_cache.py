"""Compiled kernels on disk belong to this very code, whoever else is compiling."""

import os
import pwd
import shutil
import subprocess
import sys
from pathlib import Path

import llvmlite
import numba
import numpy as np
import pytest
from numba.core.dispatcher import Dispatcher

import omniservo
from omniservo.cameras.models.block_kernels import write_pixels
from omniservo.cli.compiled_record import CompiledRecord
from omniservo.cli.first_steps import first_steps
from omniservo.geometry import kernel_cache
from omniservo.geometry.compiler_watch import CompilerWatch
from omniservo.geometry.kernel import kernel, leaf
from omniservo.geometry.kernel_cache import KernelCache, kernel_files, kernel_folders, user_folder
from omniservo.planning import plan_path

PACKAGE = Path(omniservo.__file__).parent

SCRIPT = """
import sys
import numpy as np
from omniservo.cameras.models.block_kernels import write_pixels
from omniservo.geometry.compiler_watch import CompilerWatch

def pixels(kind):
    p = np.array([300.0, 1.0, 0.0, 310.0, 320.0, 240.0, 0, 0, 0, 0, 0.0, 4.0, 4.0], dtype=kind)
    x, y = np.linspace(-1.0, 1.0, 7).astype(kind), np.linspace(0.5, -0.25, 7).astype(kind)
    found, valid = np.empty((7, 2), dtype=kind), np.empty(7, dtype=bool)
    write_pixels(p, x, y, found, valid)
    assert valid.all()
    return found

kinds = [np.float64, np.float32]
print("ready", flush=True)
sys.stdin.readline()
with CompilerWatch() as watch:
    found = {kind.__name__: pixels(kind).tobytes().hex() for kind in kinds[:: int(sys.argv[1])]}
print(watch.compiled, found["float64"], found["float32"])
"""


def start(order, cache, source=PACKAGE.parent):
    """A process that computes pixels in two types, in one order or the other."""
    environment = os.environ | {"XDG_CACHE_HOME": str(cache), "PYTHONPATH": str(source)}
    return subprocess.Popen(
        [sys.executable, "-c", SCRIPT, str(order)],
        env=environment,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def end(process):
    """How many functions a process has compiled, and its pixels in two types."""
    out, err = process.communicate()
    assert process.returncode == 0, err
    compiled, wide, narrow = out.removeprefix("ready\n").split()
    return (
        int(compiled),
        np.frombuffer(bytes.fromhex(wide), np.float64),
        np.frombuffer(bytes.fromhex(narrow), np.float32),
    )


def pixels():
    """The pixels by NumPy."""
    x, y = np.linspace(-1.0, 1.0, 7), np.linspace(0.5, -0.25, 7)
    return np.column_stack([300.0 * x + y + 320.0, 310.0 * y + 240.0]).ravel()


@pytest.fixture
def copied(tmp_path):
    """A copy of the package's source, which may be edited."""
    to = tmp_path / "source" / "omniservo"
    shutil.copytree(PACKAGE, to, ignore=shutil.ignore_patterns("__pycache__", "kernels"))
    return to


@pytest.mark.slow
def test_three_processes_that_compile_at_once_into_one_empty_folder_all_compute_the_same(tmp_path):
    started = [start(order, tmp_path) for order in (1, -1, 1)]
    assert [process.stdout.readline() for process in started] == ["ready\n"] * 3
    for process in started:
        process.stdin.write("\n")
        process.stdin.flush()
    ended = [end(process) for process in started]
    assert sum(compiled for compiled, _, _ in ended) > 2
    afterwards = end(start(-1, tmp_path))
    assert afterwards[0] == 0
    for _, wide, narrow in (*ended, afterwards):
        np.testing.assert_allclose(wide, pixels(), rtol=1e-15)
        np.testing.assert_allclose(narrow, pixels(), rtol=1e-6)
    assert not [file for file in tmp_path.rglob("*") if file.is_file() and file.suffix != ".kernel"]


def test_an_edit_of_a_callee_in_another_file_is_seen_by_its_callers(tmp_path, copied):
    first, again = end(start(1, tmp_path, copied.parent)), end(start(1, tmp_path, copied.parent))
    assert (first[0] > 0, again[0]) == (True, 0)
    callee = copied / "cameras" / "models" / "plane_kernels.py"
    text = callee.read_text()
    assert text.count("+ p[CX] if ok") == 1
    callee.write_text(text.replace("+ p[CX] if ok", "+ 2.0 * p[CX] if ok"))
    edited = end(start(1, tmp_path, copied.parent))
    assert edited[0] > 0
    np.testing.assert_allclose(edited[1] - first[1], [320.0, 0.0] * 7, atol=1e-9)


ROOTS = """
import numpy as np
from omniservo.geometry import kernel_cache
kernel_cache.LARGEST_LINKED = 0
from omniservo.geometry.compiler_watch import CompilerWatch
from omniservo.geometry.real_roots import real_roots

with CompilerWatch() as watch:
    roots = np.empty(3)
    count = real_roots(np.array([-6.0, 11.0, -6.0, 1.0]), 10.0, roots)
print(watch.compiled, *roots[:count].round(9))
"""


@pytest.mark.slow
def test_a_callee_is_called_in_place_of_linked_and_where_its_file_is_gone_the_caller_is_compiled_again(
    tmp_path,
):
    """Machine code that calls what is not there would end the process."""

    def compiled():
        environment = os.environ | {"XDG_CACHE_HOME": str(tmp_path), "PYTHONPATH": str(PACKAGE.parent)}
        out = subprocess.run(
            [sys.executable, "-c", ROOTS], env=environment, capture_output=True, text=True, check=True
        )
        count, *roots = out.stdout.split()
        assert roots == ["1.0", "2.0", "3.0"]
        return int(count)

    assert compiled() > 0
    files = {file.name for file in tmp_path.rglob("*.kernel")}
    [callee] = tmp_path.rglob("*real_roots._value-*")
    for damage in (callee.unlink, lambda: callee.write_bytes(callee.read_bytes()[:-1])):
        damage()
        assert compiled() > 0
        assert {file.name for file in tmp_path.rglob("*.kernel")} == files
    assert compiled() == 0


@pytest.mark.slow
def test_what_is_edited_while_a_process_runs_is_not_kept_by_it(tmp_path, copied):
    process = start(1, tmp_path, copied.parent)
    assert process.stdout.readline() == "ready\n"
    callee = copied / "cameras" / "models" / "plane_kernels.py"
    callee.write_text(callee.read_text() + "\n")
    assert end(process)[0] > 0
    assert not list(tmp_path.rglob("*.kernel"))


def test_what_kernels_are_compiled_from_is_under_the_hash_and_what_they_never_see_is_not():
    files = {str(file.relative_to(PACKAGE)) for file in kernel_files()}
    assert {
        "cameras/models/plane_kernels.py",
        "geometry/kernel.py",
        "geometry/held.py",
        "planning/constraints/constraints.py",
    } <= files
    assert not [file for file in files if file.startswith(("cli/", "reporting/", "runs/", "verification/"))]


def test_globals_of_kernels_come_from_files_under_the_hash():
    """Constants and callees are part of the code; whatever names they have, their files are hashed."""
    assert plan_path.__name__  # with all that it imports
    files = set(kernel_files())
    modules = [module for name, module in sys.modules.items() if name.startswith("omniservo.")]
    kernels = {id(v): v for m in modules for v in vars(m).values() if isinstance(v, Dispatcher)}
    assert len(kernels) > 250
    for compiled in kernels.values():
        function = compiled.py_func
        assert Path(function.__code__.co_filename) in files
        used = [function.__globals__.get(name) for name in function.__code__.co_names]
        for value in used:
            home = sys.modules.get(getattr(value, "__module__", None) or "")
            if home is not None and home.__name__.startswith("omniservo."):
                assert Path(home.__file__) in files, (function, value)


@pytest.mark.parametrize(
    ("setting", "value"),
    [
        ("NUMBA_OPT", "1"),
        ("NUMBA_CPU_NAME", "x86-64"),
        ("NUMBA_CPU_FEATURES", ""),
        ("NUMBA_BOUNDSCHECK", "1"),
    ],
)
def test_another_processor_or_setting_of_the_compiler_is_another_folder(monkeypatch, setting, value):
    before = user_folder()
    monkeypatch.setenv(setting, value)
    assert user_folder() != before
    assert user_folder().parent == before.parent


@pytest.fixture
def compiled(tmp_path, monkeypatch):
    """A cache of one function in a folder of its own, with what `write_pixels` compiles to in it.

    Compiled anew: what came from another cache has no object code that could be kept again.
    """
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(kernel_cache, "_callable", {})
    anew, cache = leaf(write_pixels.py_func), KernelCache(write_pixels.py_func)
    p, x = np.zeros(13), np.zeros(3)
    anew(p, x, x, np.empty((3, 2)), np.empty(3, dtype=bool))
    [signature] = anew.signatures
    return cache, anew, signature, user_folder() / cache._file(signature)


def loaded(cache, signature):
    """What a process that has loaded nothing yet finds in a cache for a signature."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(kernel_cache, "_callable", {})
        return cache.load_overload(signature, write_pixels.targetctx)


def test_a_damaged_file_and_one_of_another_signature_are_not_used(compiled):
    cache, _, signature, file = compiled
    assert loaded(cache, signature).signature.args == signature
    content = file.read_bytes()
    for damaged in (content[:-1], content[:40], b"", content[:-1] + bytes([content[-1] ^ 1])):
        file.write_bytes(damaged)
        assert loaded(cache, signature) is None
    other = (*signature[:-1], numba.types.float32[::1])
    file.write_bytes(content)
    file.rename(user_folder() / cache._file(other))
    assert loaded(cache, other) is None


def test_what_is_only_called_leaves_its_bitcode_unread(compiled):
    cache, anew, signature, _ = compiled
    library = loaded(cache, signature).library
    assert library._get_module_for_linking.cache_info().currsize == 0
    linked = library._get_module_for_linking()
    assert not linked.get_function(anew.overloads[signature].fndesc.mangled_name).is_declaration


def test_a_folder_that_cannot_be_written_is_no_error(compiled, tmp_path, monkeypatch):
    cache, anew, signature, _ = compiled
    (tmp_path / "file").write_text("no folder")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    cache.save_overload(signature, anew.overloads[signature])
    assert loaded(cache, signature) is None


def test_folders_of_other_code_are_kept_up_to_a_number_those_used_last(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    for k in range(9):
        folder = tmp_path / "omniservo" / f"kernels-{k}"
        folder.mkdir(parents=True)
        (folder / "some.kernel").write_bytes(b"old")
        os.utime(folder, (1e9 + k, 1e9 + k))
    kernel_cache._begin(user_folder())
    left = {folder.name for folder in (tmp_path / "omniservo").iterdir()}
    assert left == {user_folder().name, *(f"kernels-{k}" for k in range(9 - kernel_cache.KEPT + 1, 9))}


def test_a_wheels_kernels_are_looked_for_first_and_only_where_the_processor_runs_them(tmp_path, monkeypatch):
    level, features = kernel_cache.GENERIC.get(kernel_cache.platform.machine(), ("generic", ""))
    monkeypatch.setattr(kernel_cache, "SHIPPED", tmp_path)
    assert kernel_folders() == [user_folder()]
    shipped = tmp_path / f"kernels-{kernel_cache._key(level, '')}"
    shipped.mkdir()
    assert kernel_folders() == [shipped, user_folder()]
    monkeypatch.setattr(kernel_cache, "_host", lambda: ("old", "+sse2,-avx2"))
    assert kernel_folders() == ([user_folder()] if features else [shipped, user_folder()])


def test_kernels_of_other_packages_are_not_kept(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))

    @kernel
    def _twice(x: float) -> float:
        return 2.0 * x

    with CompilerWatch() as watch:
        assert _twice(3.0) == 6.0
    assert watch.compiled == 1
    assert not list(tmp_path.iterdir())


def test_the_private_parts_of_numba_that_are_used_are_those_that_were_tried(compiled):
    """Numba names none of this as public: a new version is tried, with all tests, before it is allowed."""
    assert (numba.__version__, llvmlite.__version__) == ("0.68.1", "0.50.0")
    _, anew, signature, _ = compiled
    assert isinstance(anew, Dispatcher)
    assert isinstance(anew._cache, KernelCache)
    result = anew.overloads[signature]
    assert callable(result._reduce)
    assert callable(type(result)._rebuild)
    assert result.library.has_dynamic_globals is False
    assert callable(result.library._get_module_for_linking)
    assert isinstance(result.library.codegen._engine._defined_symbols, set)


@pytest.mark.parametrize("relative", ["", "cache", "./cache", "~/cache"])
def test_a_cache_folder_that_is_not_absolute_is_ignored(relative, monkeypatch, tmp_path):
    """Each working folder would have kernels of its own, compiled again for minutes."""
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("XDG_CACHE_HOME", relative)
    assert user_folder().parent == tmp_path / ".cache" / "omniservo"
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "mine"))
    assert user_folder().parent == tmp_path / "mine" / "omniservo"


def test_a_user_without_a_home_keeps_no_kernels_and_meets_no_error(monkeypatch):
    """As in a container that is run under a number that no one there has."""

    def unknown(user):
        raise KeyError(user)

    for name in ("HOME", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(pwd, "getpwuid", unknown)
    assert not CompiledRecord().save()
    assert "omniservo warm-up" in first_steps()
    assert not user_folder().parent.exists()
