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
