import os
import pickle
import resource
import subprocess
import sys
import threading
import warnings

import pytest

from omniservo.errors import AlreadyExists, FeatureLoss, InputError, NotWritten
from omniservo.files import (
    copy_whole,
    made_folder,
    parse_document,
    python_class,
    read_document,
    whole_folder,
    writable_folder,
    write_whole,
)
from omniservo.files.own_warnings import own_warnings


def test_exponents_without_a_point_are_numbers():
    text = "a: 1e-3\nb: [2, 2.5]\nc: '1e-3'"
    assert parse_document(text, "file") == {"a": 1e-3, "b": [2, 2.5], "c": "1e-3"}


def test_json_is_read_by_its_first_character():
    assert parse_document('\n {"a": [1, null, true]}', "file") == {"a": [1, None, True]}


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("a: &x 1\nb: *x", "line 2: aliases are not read"),
        ("a: 1\na: 2", "'a' is given twice"),
        ('{"a": 1, "a": 2}', "'a' is given twice"),
        ('{"a": ', "line 1: not JSON"),
        ("!!python/object/apply:os.system ['true']", "tags are not read"),
        ("a: " + "[" * 60 + "]" * 60, "nested deeper"),
        ('{"a": ' + "[" * 100_000 + "]" * 100_000 + "}", "nested too deeply"),
        ("? [a]\n: 1", "a field's name must be plain"),
    ],
)
def test_a_document_that_is_not_plain_data_is_refused_with_its_reason(text, says):
    with pytest.raises(InputError, match="^file: ") as refusal:
        parse_document(text, "file")
    assert says in str(refusal.value)


def test_missing_folder_binary_and_oversized_files_are_named(tmp_path):
    (tmp_path / "binary").write_bytes(b"\xff\xfe\x00\x80")
    (tmp_path / "large").write_bytes(b"#" * (16 * 2**20 + 1))
    for name, says in {
        "missing": "no such file",
        "": "not a file",
        "binary": "UTF-8",
        "large": "at most",
    }.items():
        with pytest.raises(InputError, match=says):
            read_document(tmp_path / name)


def test_an_existing_file_is_replaced_only_by_force(tmp_path):
    file = tmp_path / "plan.json"
    write_whole(file, "one")
    with pytest.raises(InputError, match="exists"):
        write_whole(file, "two")
    assert file.read_text() == "one"
    write_whole(file, "two", force=True)
    assert file.read_text() == "two"
    assert [p.name for p in tmp_path.iterdir()] == ["plan.json"]


def test_of_two_that_write_one_file_at_once_the_second_is_told(tmp_path):
    file, source = tmp_path / "plan.json", tmp_path / "source"
    source.write_text("second")

    class Slow(type(source)):
        def open(self, *of):
            write_whole(file, "first")
            return super().open(*of)

    with pytest.raises(AlreadyExists):
        copy_whole(Slow(source), file)
    assert file.read_text() == "first"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["plan.json", "source"]


@pytest.mark.parametrize(("umask", "file", "folder"), [(0o077, 0o600, 0o700), (0o002, 0o664, 0o775)])
def test_results_are_readable_by_whom_the_user_lets_read(umask, file, folder, tmp_path):
    before = os.umask(umask)
    try:
        write_whole(tmp_path / "result.json", "{}")
        with whole_folder(tmp_path / "run", "known") as work:
            (work / "known").write_text("1")
    finally:
        os.umask(before)
    assert (tmp_path / "result.json").stat().st_mode & 0o777 == file
    assert (tmp_path / "run").stat().st_mode & 0o777 == folder


def test_a_file_is_written_whole_where_the_disk_has_no_links(tmp_path, monkeypatch):
    def refused(*of):
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "link", refused)
    write_whole(tmp_path / "plan.json", "one")
    assert [path.read_text() for path in tmp_path.iterdir()] == ["one"]


def test_an_interrupted_folder_leaves_nothing_and_keeps_the_old_one(tmp_path):
    folder = tmp_path / "out"
    with whole_folder(folder, "a") as work:
        (work / "a").write_text("old")
    with pytest.raises(KeyboardInterrupt), whole_folder(folder, "a", force=True) as work:
        (work / "a").write_text("new")
        raise KeyboardInterrupt
    assert (folder / "a").read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def limited(script, folder, limit):
    """Run a script in a process of its own whose files may have ``limit`` bytes: as on a full disk."""
    return subprocess.run(
        [sys.executable, "-c", script, str(folder)],
        capture_output=True,
        text=True,
        check=True,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)),
    ).stdout


def test_a_disk_that_gets_full_costs_only_what_did_not_fit(tmp_path):
    script = """if True:
        import sys
        from pathlib import Path
        from omniservo.errors import InputError
        from omniservo.files import whole_folder, write_whole
        for _ in range(2):
            try:
                with whole_folder(Path(sys.argv[1]) / "out", "known") as work:
                    write_whole(work / "metrics.json", "{}")
                    write_whole(work / "film.gif", b"0" * 100_000)
                    write_whole(work / "report.html", "never reached")
            except InputError as error:
                print(error)
        try:
            write_whole(Path(sys.argv[1]) / "plan.json", b"0" * 100_000)
        except InputError as error:
            print(error)
        """
    first, second, third = limited(script, tmp_path, 10_000).splitlines()
    reason = f"{tmp_path}/out/film.gif: File too large; what was written before is kept in {tmp_path}"
    assert first == f"{reason}/out.incomplete"
    assert second == f"{reason}/out.incomplete-2"
    assert third == f"{tmp_path}/plan.json: File too large"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["out.incomplete", "out.incomplete-2"]
    assert [p.name for p in (tmp_path / "out.incomplete").iterdir()] == ["metrics.json"]


def test_a_disk_without_the_room_is_refused_before_the_work(tmp_path):
    with pytest.raises(InputError, match=r"MiB are free there; about 1099511627776 are"):  # noqa: SIM117
        with whole_folder(tmp_path / "new" / "out", "known", room=2**60):
            pytest.fail("the work began")
    assert not list(tmp_path.iterdir())


def test_folders_that_were_made_for_what_failed_go_again_and_others_stay(tmp_path):
    with pytest.raises(KeyboardInterrupt), whole_folder(tmp_path / "new" / "runs" / "out", "known"):
        raise KeyboardInterrupt
    assert not list(tmp_path.iterdir())
    (tmp_path / "before").mkdir()
    with pytest.raises(NotWritten), made_folder(tmp_path / "before" / "new") as folder:
        raise NotWritten(folder, "No space left on device")
    assert [path.name for path in tmp_path.iterdir()] == ["before"]
    with pytest.raises(NotWritten), made_folder(tmp_path / "kept" / "new") as folder:
        (folder / "whole.png").write_bytes(b"1")
        raise NotWritten(folder, "No space left on device")
    assert (tmp_path / "kept" / "new" / "whole.png").exists()
    with pytest.raises(NotWritten, match="whole.png: File exists"):
        made_folder(tmp_path / "kept" / "new" / "whole.png").__enter__()


def test_a_folder_that_appeared_during_the_work_is_not_replaced(tmp_path):
    with pytest.raises(InputError, match="exists by now; what was .* is kept in .*out.incomplete"):  # noqa: SIM117
        with whole_folder(tmp_path / "out", "known") as work:
            (work / "mine").write_text("new")
            (tmp_path / "out").mkdir()
            (tmp_path / "out" / "theirs").write_text("old")
    assert (tmp_path / "out" / "theirs").read_text() == "old"
    assert (tmp_path / "out.incomplete" / "mine").read_text() == "new"


@pytest.mark.parametrize("named", [".", ".."])
def test_the_folder_that_one_works_in_is_never_replaced(named, tmp_path, monkeypatch):
    work = tmp_path / "work"
    work.mkdir()
    (work / "precious.txt").write_text("mine")
    monkeypatch.chdir(work)
    with (
        pytest.raises(InputError, match="holds the folder that this is run in"),
        whole_folder(named, "known", force=True),
    ):
        pass
    assert (work / "precious.txt").read_text() == "mine"
    assert [p.name for p in tmp_path.rglob("*")] == ["work", "precious.txt"]


def test_a_folder_of_other_things_is_not_replaced_by_results_before_any_work(tmp_path):
    folder = tmp_path / "mine"
    folder.mkdir()
    with whole_folder(folder, "metrics.json", force=True) as work:  # an empty one is
        (work / "task.yaml").write_text("mine")
    with (
        pytest.raises(InputError, match=r"holds other files, and no metrics\.json"),
        whole_folder(folder, "metrics.json", force=True),
    ):
        pytest.fail("the work began")
    assert (folder / "task.yaml").read_text() == "mine"


def test_a_folder_of_earlier_results_is_refused_before_any_work_without_force(tmp_path):
    (tmp_path / "metrics.json").write_text("{}")
    with pytest.raises(AlreadyExists):
        writable_folder(tmp_path, "metrics.json")
    writable_folder(tmp_path, "metrics.json", force=True)


def test_what_is_no_file_is_not_replaced_by_one(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with pytest.raises(InputError, match="a device or pipe; a file is needed"):
        write_whole(pipe, "words", force=True)
    assert pipe.is_fifo()


def test_files_read_by_two_threads_at_once_leave_the_callers_warnings_as_they_were():
    before, inside, both = list(warnings.filters), threading.Event(), threading.Event()

    def first():
        with own_warnings("ignore"):
            inside.set()
            both.wait(0.2)  # in vain: the second one's turn comes afterwards

    def second():
        inside.wait()
        with own_warnings("error"):
            both.set()
            threads[0].join()

    threads = [threading.Thread(target=work) for work in (first, second)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert list(warnings.filters) == before


@pytest.mark.parametrize(
    "error", [AlreadyExists("plan.json"), NotWritten("plan.json", "disk full"), FeatureLoss("3 of 9")]
)
def test_an_error_reaches_another_process_as_it_is(error):
    """One that does not would leave who waits for a pool of processes waiting for ever."""
    there = pickle.loads(pickle.dumps(error))  # noqa: S301
    assert (type(there), str(there), vars(there)) == (type(error), str(error), vars(error))


def test_code_of_ones_own_means_what_it_means_alone(tmp_path):
    file = tmp_path / "own.py"
    file.write_text("class Own:\n    gain: float = 1.0\n")
    assert python_class(f"{file}:Own", "method").__annotations__ == {"gain": float}


def test_a_folder_behind_a_link_is_replaced_and_the_link_stays(tmp_path):
    (tmp_path / "first").mkdir()
    (tmp_path / "first" / "old").write_text("old")
    (tmp_path / "latest").symlink_to("first")
    with whole_folder(tmp_path / "latest", "old", force=True) as work:
        (work / "fresh").write_text("fresh")
    assert [p.name for p in (tmp_path / "first").iterdir()] == ["fresh"]
    assert (tmp_path / "latest").is_symlink()
