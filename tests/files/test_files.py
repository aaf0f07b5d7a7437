import resource
import subprocess
import sys

import pytest

from omniservo.errors import InputError
from omniservo.files import parse_document, read_document, whole_folder, write_whole


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


def test_an_interrupted_folder_leaves_nothing_and_keeps_the_old_one(tmp_path):
    folder = tmp_path / "out"
    with whole_folder(folder) as work:
        (work / "a").write_text("old")
    with pytest.raises(KeyboardInterrupt), whole_folder(folder, force=True) as work:
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
                with whole_folder(Path(sys.argv[1]) / "out") as work:
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
        with whole_folder(tmp_path / "new" / "out", room=2**60):
            pytest.fail("the work began")
    assert not list(tmp_path.iterdir())


def test_a_folder_that_appeared_during_the_work_is_not_replaced(tmp_path):
    with pytest.raises(InputError, match="exists by now; what was .* is kept in .*out.incomplete"):  # noqa: SIM117
        with whole_folder(tmp_path / "out") as work:
            (work / "mine").write_text("new")
            (tmp_path / "out").mkdir()
            (tmp_path / "out" / "theirs").write_text("old")
    assert (tmp_path / "out" / "theirs").read_text() == "old"
    assert (tmp_path / "out.incomplete" / "mine").read_text() == "new"
