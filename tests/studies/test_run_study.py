import gzip
import json
import multiprocessing
import shutil

import pytest
from tests.studies.conftest import rows_of, written

from omniservo.errors import InputError, NoSolutionError, NotWritten
from omniservo.files import whole_folder
from omniservo.studies import (
    PACKAGE,
    Shard,
    load_study,
    merge_studies,
    read_parts,
    run_row,
    run_study,
    write_rows,
)
from omniservo.studies.study_folder import HEADER
from omniservo.studies.study_parts import part_count, part_file, rows_of_part, write_part


def copied(folder, target):
    """Return a copy of a study's folder that may be spoilt: its parts are never written in place."""
    shutil.copytree(folder, target)
    return target


def changed(path, change):
    """Rewrite a part by a function of its lines, without its digest made right."""
    lines = gzip.decompress(path.read_bytes()).decode().splitlines(keepends=True)
    path.write_bytes(gzip.compress("".join(change(lines)).encode()))


def digested(path, change):
    """Rewrite a part by a function of its lines but the last, with a digest that fits, as a forger would."""
    import hashlib

    lines = gzip.decompress(path.read_bytes()).decode().splitlines(keepends=True)
    end = json.loads(lines[-1])
    kept = "".join(change(lines[:-1]))
    end["digest"] = hashlib.sha256(kept.encode()).hexdigest()
    path.write_bytes(gzip.compress((kept + json.dumps(end) + "\n").encode()))


def merged(folders, target):
    with whole_folder(target, "study.json") as work:
        merge_studies(folders, work)
    return target


def test_rows_are_all_there_once_and_in_order(study, undisturbed):
    assert [row.row for row in rows_of(undisturbed)] == list(range(study.rows))


def test_a_row_is_the_same_alone_and_in_another_order(study, undisturbed):
    rows = rows_of(undisturbed)
    assert len({row.final_translation_error_m for row in rows}) == study.rows
    for number in (53, 5, 40, 0):
        assert run_row(study, number).row == rows[number]


@pytest.mark.slow
def test_rows_of_two_workers_that_are_killed_and_resumed_are_those_of_one_process(
    study, undisturbed, tmp_path
):
    killed = []

    def kill_all(stage, share):
        if share and not killed:
            killed.extend(multiprocessing.active_children())
            for process in killed:
                process.kill()

    with pytest.raises(
        NoSolutionError, match=r"a worker process was killed while rows \d+ to \d+.* were run"
    ):
        run_study(study, tmp_path / "rows", workers=2, progress=kill_all)
    there = len(list((tmp_path / "rows" / "parts").glob("0*")))
    assert killed
    assert 1 <= there < part_count(study)
    assert run_study(study, tmp_path / "rows", workers=1)
    assert rows_of(tmp_path / "rows") == rows_of(undisturbed)


def test_parts_that_are_there_are_not_run_again_and_half_written_ones_are(study, undisturbed, tmp_path):
    folder = copied(undisturbed, tmp_path / "rows")
    part_file(folder, 2).unlink()
    left = part_file(folder, 2).with_name(".000002.jsonl.gz.17")
    left.write_bytes(b"half")
    before = {path.name: path.stat().st_mtime_ns for path in (folder / "parts").glob("0*")}
    said = []
    assert run_study(study, folder, workers=1, progress=lambda stage, share: said.append(stage))
    assert said[0] == f"running {len(rows_of_part(study, 2))} rows, {part_count(study) - 1} parts are there"
    assert not left.exists()
    assert {name: (folder / "parts" / name).stat().st_mtime_ns for name in before} == before
    assert rows_of(folder) == rows_of(undisturbed)


@pytest.mark.slow
def test_merged_shards_are_the_undisturbed_study_to_the_byte_of_its_table(study, undisturbed, tmp_path):
    folders = [tmp_path / f"shard-{k}" for k in (1, 2, 3)]
    for k, folder in enumerate(folders, 1):
        assert not run_study(study, folder, workers=1, shard=Shard(k, 3))
    with whole_folder(tmp_path / "all", "study.json") as work:
        found, certificates = merge_studies([*reversed(folders), folders[0]], work)
    assert found.hash == study.hash
    assert certificates == sum(row.certified for row in rows_of(undisturbed)) > 5
    tables = [write_rows(folder, rows_of(folder)).read_bytes() for folder in (tmp_path / "all", undisturbed)]
    assert tables[0] == tables[1]


def test_a_missing_part_is_named(undisturbed, tmp_path):
    folder = copied(undisturbed, tmp_path / "rows")
    part_file(folder, 3).unlink()
    with pytest.raises(InputError, match=r"1 of \d+ parts are missing: 000003.jsonl.gz"):
        rows_of(folder)
    with pytest.raises(InputError, match=r"in none of the folders: 000003.jsonl.gz"):
        merged([folder], tmp_path / "all")
    assert not (tmp_path / "all").exists()


@pytest.mark.parametrize(
    "spoil",
    [
        lambda path: path.write_bytes(path.read_bytes()[:-200]),
        lambda path: path.write_bytes(b"not gzip"),
        lambda path: changed(path, lambda lines: [line.replace("false", "true") for line in lines]),
        lambda path: changed(path, lambda lines: lines[:-1]),
        lambda path: digested(path, lambda lines: [lines[0], *reversed(lines[1:])]),
        lambda path: digested(path, lambda lines: ["[]\n", *lines[1:]]),
        lambda path: digested(path, lambda lines: [lines[0], "[" * 10_000, "\n"]),
        lambda path: digested(path, lambda lines: [line.replace(": false", ": 0") for line in lines]),
        lambda path: digested(path, lambda lines: [line.replace('"pbvs"', '"other"') for line in lines]),
        lambda path: digested(
            path, lambda lines: [lines[0], *(s.replace('"seed": 7', '"seed": 8') for s in lines[1:])]
        ),
        lambda path: digested(path, lambda lines: [line.replace('"least_gap_m"', '"gap"') for line in lines]),
    ],
)
def test_a_damaged_part_is_named(undisturbed, tmp_path, spoil):
    folder = copied(undisturbed, tmp_path / "rows")
    spoil(part_file(folder, 1))
    with pytest.raises(InputError, match=r"000001.jsonl.gz: damaged: .*delete it"):
        rows_of(folder)


def test_a_part_of_another_version_is_named(undisturbed, tmp_path):
    folder = copied(undisturbed, tmp_path / "rows")
    old = (f'"{PACKAGE.version}"', '"0.0.9"')  # its rows may have had other columns
    digested(part_file(folder, 1), lambda lines: [lines[0].replace(*old), '{"row": {}}\n'])
    with pytest.raises(
        InputError, match=r"000001.jsonl.gz: version: '0.0.9'; '0.1.0\+[0-9a-f]{8}' is needed"
    ):
        rows_of(folder)


def test_folders_of_other_versions_and_studies_are_refused(study, undisturbed, tmp_path):
    old = copied(undisturbed, tmp_path / "old")
    header = json.loads((old / HEADER).read_text())
    (old / HEADER).write_text(json.dumps({**header, "version": "0.0.9"}))
    with pytest.raises(InputError, match=r"old: holds rows of version 0.0.9; 0.1.0\+[0-9a-f]{8} is another"):
        merged([undisturbed, old], tmp_path / "all")
    with pytest.raises(InputError, match=r"old: holds rows of version 0.0.9"):
        run_study(study, old, workers=1)
    other = load_study(written(tmp_path, seed=8))
    with pytest.raises(InputError, match=f"the study short {study.hash}; short {other.hash} is"):
        run_study(other, undisturbed, workers=1)


def test_a_header_whose_study_was_changed_is_refused(undisturbed, tmp_path):
    folder = copied(undisturbed, tmp_path / "rows")
    text = (folder / HEADER).read_text().replace('"seed": 7', '"seed": 8')
    (folder / HEADER).write_text(text)
    with pytest.raises(InputError, match=r"study.json: study_hash"):
        rows_of(folder)


def moved_path(line):
    """Return a certified row's line with a plan whose path leads elsewhere, its certificate as it was."""
    entry = json.loads(line)
    if "plan" in entry:
        entry["plan"]["path"]["translation"][0][0] += 1.0
    return json.dumps(entry) + "\n"


@pytest.mark.parametrize("change", [moved_path, lambda line: line.replace('"plan": {', '"plan_": {')])
def test_a_certificate_that_does_not_hold_is_not_merged(undisturbed, tmp_path, change):
    folder = copied(undisturbed, tmp_path / "rows")
    digested(part_file(folder, 0), lambda lines: [lines[0], *map(change, lines[1:])])
    with pytest.raises(InputError, match=r"000000.jsonl.gz: row.*(certificate does not hold|not the same)"):
        merged([folder], tmp_path / "all")
    assert not (tmp_path / "all").exists()


def test_a_folder_in_use_and_a_folder_of_something_else_are_refused(study, tmp_path):
    seen = []

    def second(stage, share):
        with pytest.raises(InputError, match="another process works in it"):
            run_study(study, tmp_path / "rows", workers=1)
        seen.append(stage)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_study(study, tmp_path / "rows", workers=1, progress=second)
    assert seen
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "letter.txt").write_text("mine")
    with pytest.raises(InputError, match="is not a study's folder"):
        run_study(study, tmp_path / "full", workers=1)


def test_a_study_that_ended_before_its_header_was_written_begins_again_in_its_folder(study, tmp_path):
    """As on a full disk: the lock alone is there."""
    (tmp_path / "rows").mkdir()
    (tmp_path / "rows" / ".lock").touch()

    def begun(stage, share):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_study(study, tmp_path / "rows", workers=1, progress=begun)
    assert (tmp_path / "rows" / HEADER).exists()


def test_a_study_whose_header_does_not_fit_on_the_disk_leaves_nothing(study, tmp_path, monkeypatch):
    def full(path, *content, **options):
        raise NotWritten(path, "No space left on device")

    monkeypatch.setattr("omniservo.studies.study_folder.write_whole", full)
    with pytest.raises(NotWritten, match=r"study.json: No space left"):
        run_study(study, tmp_path / "new" / "rows", workers=1)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("machines", ["5", '["x"]', '[{"cpu": []}]', '[{"cpu": 5}]'])
def test_a_header_s_machines_that_are_none_are_refused(undisturbed, tmp_path, machines):
    folder = copied(undisturbed, tmp_path / "rows")
    header = json.loads((folder / HEADER).read_text())
    (folder / HEADER).write_text(json.dumps({**header, "machines": json.loads(machines)}))
    with pytest.raises(InputError, match=r"study.json: version and machines are needed"):
        merged([folder], tmp_path / "all")


def test_a_disk_that_gets_full_in_a_merge_keeps_no_half_of_a_part(undisturbed, tmp_path, monkeypatch):
    def refused(*given):
        raise OSError(18, "another disk")

    def half(source, target):
        target.write(source.read(10))
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.link", refused)
    monkeypatch.setattr("shutil.copyfileobj", half)
    with pytest.raises(NotWritten, match=r"000000\.jsonl\.gz: No space left .*; nothing was written"):
        merged([undisturbed], tmp_path / "all")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("number", [1, 38, 95])  # EPERM, ENOSYS, ENOTSUP
def test_parts_are_written_where_the_disk_has_no_links(study, undisturbed, tmp_path, monkeypatch, number):
    def refused(*given):
        raise OSError(number, "no links here")

    part = part_file(undisturbed, 0).read_bytes()
    monkeypatch.setattr("omniservo.studies.study_parts.os.link", refused)
    (tmp_path / "parts").mkdir()
    write_part(tmp_path, 0, part)
    assert part_file(tmp_path, 0).read_bytes() == part
    assert len(list((tmp_path / "parts").iterdir())) == 1


def test_a_full_disk_is_named_and_leaves_no_part(study, tmp_path, monkeypatch):
    def full(handle):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("omniservo.studies.study_parts.os.fsync", full)
    with pytest.raises(NotWritten, match=r"000000.jsonl.gz: No space left on device"):
        run_study(study, tmp_path / "rows", workers=1)
    assert list((tmp_path / "rows" / "parts").iterdir()) == []


@pytest.mark.parametrize("text", ["0/3", "4/3", "1", "1/", "/2", "a/b", "1/2/3", "-1/2", "1.5/2"])
def test_a_shard_that_is_none_is_refused(text):
    with pytest.raises(InputError, match="legal: k/n"):
        Shard.parse(text)


def test_the_plan_of_every_certified_row_is_kept(undisturbed):
    for part in read_parts(undisturbed):
        assert sorted(part.plans) == [row.row for row in part.rows if row.certified]
