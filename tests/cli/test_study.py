import json
from pathlib import Path

import pyarrow.parquet as parquet
import pytest
from tests.cli.calling import call
from tests.studies.conftest import rows_of, undisturbed, written  # noqa: F401
from tests.studies.conftest import study as study_fixture

from omniservo.reporting import study_report
from omniservo.studies.study_row import COLUMNS

study = study_fixture

FIXED = [
    *("row", "study_hash", "version", "seed", "method", "camera", "status", "reason", "success", "collision"),
    *("feature_lost", "final_translation_error_m", "final_rotation_error_rad", "seconds"),
]


@pytest.fixture(autouse=True)
def few_of_the_worst(monkeypatch):
    """Reports draw the worst row alone; which ten are the worst, tests/studies/test_study_summary.py says."""
    monkeypatch.setattr(study_report, "_WORST", 1)


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """The path of a study of 12 rows."""
    return written(tmp_path_factory.mktemp("small"), scenes=2)


@pytest.mark.slow
def test_a_study_is_run_and_leaves_rows_and_a_report(small, tmp_path, capsys):
    code, out, _ = call(capsys, "study", small, "--out", tmp_path / "rows", "--workers", 1, "--json")
    found = json.loads(out)
    assert (code, found["rows"], found["status"]) == (0, 12, "done")
    table = parquet.read_table(tmp_path / "rows" / "rows.parquet")
    assert table.column_names == list(COLUMNS)
    assert table.column_names[: len(FIXED)] == FIXED
    assert table.to_pylist() == [vars(row) for row in rows_of(tmp_path / "rows")]
    report = (tmp_path / "rows" / "report.html").read_text()
    assert "http" not in report.replace("http://www.w3.org", "").replace("https://www.w3.org", "")
    for name in ("certified", "ibvs", "pbvs", found["study_hash"]):
        assert name in report


@pytest.mark.slow
def test_shards_are_run_and_merged_by_commands(small, tmp_path, capsys):
    for k in (1, 2):
        shard = ("--shard", f"{k}/2", "--workers", 1, "--json")
        assert call(capsys, "study", small, "--out", tmp_path / f"{k}", *shard)[0] == 0
        assert not (tmp_path / f"{k}" / "rows.parquet").exists()
    code, out, _ = call(capsys, "study", "merge", tmp_path / "1", tmp_path / "2", "--out", tmp_path / "all")
    assert code == 0
    assert "certificates verified again" in out
    with_balls = sum(row.obstacles > 0 for row in rows_of(tmp_path / "all") if row.method == "ibvs")
    assert f"% of {with_balls} " in next(line for line in out.splitlines() if line.startswith("ibvs"))
    assert len(rows_of(tmp_path / "all")) == 12
    code, out, _ = call(capsys, "study", "compare", tmp_path / "all", tmp_path / "all")
    assert code == 0
    assert out.count("which may be none") == 3
    given = ("study", "compare", tmp_path / "all", tmp_path / "all", "--out", tmp_path / "compared.html")
    assert call(capsys, *given, "--json")[0] == 0
    assert "the same study, row by row" in (tmp_path / "compared.html").read_text()
    code, _, err = call(capsys, *given)
    assert code == 2
    assert "--force replaces it" in err
    code, _, err = call(capsys, "study", "merge", tmp_path / "1", "--out", tmp_path / "half")
    assert code == 2
    assert "in none of the folders" in err


@pytest.mark.slow
def test_without_pyarrow_rows_are_csv_and_a_line_says_how_to_get_parquet(
    small, tmp_path, capsys, monkeypatch
):
    monkeypatch.setitem(__import__("sys").modules, "pyarrow", None)
    code, out, _ = call(capsys, "study", small, "--out", tmp_path / "rows", "--workers", 1)
    assert code == 0
    assert "rows.parquet needs: pip install omniservo[study]" in out
    lines = (tmp_path / "rows" / "rows.csv").read_text().splitlines()
    assert lines[0] == ",".join(COLUMNS)
    assert len(lines) == 1 + 12


@pytest.mark.slow
def test_a_row_is_replayed_alone_with_images_report_and_plan(
    small,
    undisturbed,  # noqa: F811
    tmp_path,
    capsys,
    monkeypatch,
):
    monkeypatch.chdir(tmp_path)
    number = next(row.row for row in rows_of(undisturbed) if row.certified)
    code, out, _ = call(capsys, "run", "--replay", f"{undisturbed}:{number}", "--json")
    found = json.loads(out)
    figure, folder = Path(found.pop("figure")), Path(found.pop("out"))
    del found["format"]
    assert code == 0
    assert found == vars(rows_of(undisturbed)[number]) == json.loads((folder / "row.json").read_text())
    assert figure.parent == folder == Path("runs") / f"short-row-{number}"
    pictures = ("initial.png", "goal.png", "final.png")
    for name in (figure.name, "views.png", *pictures):
        assert (folder / name).read_bytes()[:4] == b"\x89PNG"
    assert len({(folder / name).read_bytes() for name in pictures}) == 3
    assert (folder / "report.html").read_text().count("<figure") == 3
    assert call(capsys, "verify", folder / "plan.json")[0] == 0
    reactive = next(row.row for row in rows_of(undisturbed) if row.method == "ibvs")
    given = ("run", "--replay", f"{undisturbed}:{reactive}", "--out", folder)
    code, _, err = call(capsys, *given)
    assert code == 2
    assert "--force replaces it" in err
    assert call(capsys, *given, "--force")[0] == 0
    assert json.loads((folder / "row.json").read_text())["row"] == reactive
    assert not (folder / "plan.json").exists()
    code, _, err = call(capsys, "run", "--replay", f"{small}:12")
    assert code == 2
    assert "has rows 0 to 11" in err


@pytest.mark.slow
def test_a_method_from_a_file_is_run_beside_the_others_and_its_code_is_not_kept(
    tmp_path, capsys, monkeypatch
):
    study = written(tmp_path, scenes=2, cameras="[fe185]", methods="[pbvs]")
    own = Path(__file__).parents[2] / "examples" / "own_method.py"
    given = ("study", study, "--out", tmp_path / "rows", "--workers", 1, "--method-file", f"{own}:TurnFirst")
    code, out, _ = call(capsys, *given, "--json")
    assert code == 0
    assert [method["method"] for method in json.loads(out)["methods"]] == ["pbvs", "own_method.TurnFirst"]
    assert "TurnFirst" in (tmp_path / "rows" / "report.html").read_text()
    assert str(own) not in (tmp_path / "rows" / "study.json").read_text()
    code, _, err = call(capsys, *given[:-2])
    assert code == 2
    assert "is another" in err
    monkeypatch.chdir(tmp_path)  # where the figure is put
    row = f"{tmp_path / 'rows'}:1"
    code, _, err = call(capsys, "run", "--replay", row)
    assert code == 2
    assert "row 1 is of own_method.TurnFirst, whose code is not kept" in err
    assert "needed: --method FILE.py:CLASS" in err
    code, out, _ = call(capsys, "run", "--replay", row, "--method", f"{own}:TurnFirst", "--json")
    found = json.loads(out)
    assert found.pop("format") == "omniservo.run-replay-row-output/1"
    assert (tmp_path / found.pop("figure")).exists()
    assert (tmp_path / found.pop("out") / "report.html").exists()
    assert code == 0
    assert found == vars(rows_of(tmp_path / "rows")[1])
    code, _, err = call(capsys, "run", "--replay", row, "--method", f"{own}:TurnFirst", "--seed", 1)
    assert code == 2
    assert "--seed: given with --replay" in err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["quick", "--method-file", "pbvs"], "method file: 'pbvs' given; legal: FILE.py:CLASS"),
        (["quick", "--scheduler", "tcp://127.0.0.1:9", "--workers", "2"], "legal: one of them"),
        (["quik"], "did you mean 'quick'"),
        (["quick", "--shard", "3/2"], "shard: 3/2 given"),
    ],
)
def test_a_wrong_call_is_one_line_and_leaves_nothing(tmp_path, capsys, arguments, message):
    code, _, err = call(capsys, "study", *arguments, "--out", tmp_path / "rows")
    assert code == 2
    assert message in err.splitlines()[-1]
    assert not (tmp_path / "rows").exists()
