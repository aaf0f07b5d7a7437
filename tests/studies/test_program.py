import pickle
import re
import shutil
from pathlib import Path

import grimp
import pytest
from tests.studies.conftest import rows_of, written

import omniservo
from omniservo.errors import InputError
from omniservo.studies import PACKAGE, Program, load_study, read_header, run_row, run_study
from omniservo.studies import program as programs
from omniservo.studies.study_parts import PartWork, part_of_content

OWN = """
import numpy as np


class Still:
    def __init__(self, gain):
        self.gain = gain

    def step(self, seen):
        return np.array([0.0, 0.0, {speed}, 0.0, 0.0, 0.0])
"""


def own_file(folder, speed=0.01):
    """Return FILE.py:CLASS of a method that moves along its axis."""
    path = folder / "mine.py"
    path.write_text(OWN.format(speed=speed))
    return f"{path}:Still"


@pytest.fixture
def own(tmp_path):
    """A study of 4 rows with a method from a file, and the program that runs it; the file is gone."""
    program = Program.of([own_file(tmp_path)])
    study = load_study(written(tmp_path, scenes=2, cameras="[fe185]", methods="[pbvs]"), program.names)
    (tmp_path / "mine.py").unlink()
    return study, program


def test_the_version_changes_with_any_source_that_a_row_rests_on_and_with_no_other(tmp_path, monkeypatch):
    package = tmp_path / "omniservo"
    shutil.copytree(
        Path(omniservo.__file__).parent, package, ignore=lambda d, names: {n for n in names if "pycache" in n}
    )
    monkeypatch.setattr(programs, "_PACKAGE", package)

    def version(changed):
        path = package / changed
        text = path.read_text()
        path.write_text(text + "\n")
        programs._package_digest.cache_clear()
        found = Program().version
        path.write_text(text)
        return found

    try:
        same = "cli/study.py", "reporting/study_report.py", "runs/run_task.py", "hardware/clock_map.py"
        assert set(map(version, same)) == {PACKAGE.version}
        rests_on = "servoing/feedback.py", "errors.py", "studies/study_row.py", "robots/shipped/ur5e.xml"
        assert len({PACKAGE.version, *map(version, rests_on)}) == 5
    finally:
        programs._package_digest.cache_clear()
    assert re.fullmatch(rf"{re.escape(omniservo.__version__)}\+[0-9a-f]{{8}}", PACKAGE.version)


def test_the_rooms_left_out_of_the_version_are_those_that_studies_import_nothing_of():
    graph = grimp.build_graph("omniservo")
    for lazily in graph.find_modules_directly_imported_by("omniservo"):  # when a public name is used
        graph.remove_import(importer="omniservo", imported=lazily)
    studies = {"omniservo.studies", *graph.find_descendants("omniservo.studies")}
    reached = studies.union(*map(graph.find_upstream_modules, studies))
    inside = {module.split(".")[1] for module in reached if module != "omniservo"}
    rooms = {module.split(".")[1] for module in graph.modules if module != "omniservo"}
    assert sorted(programs.ROOMS_APART) == sorted(rooms - inside - {"__main__"})


def test_a_program_that_travels_has_the_version_of_where_it_arrives(monkeypatch):
    sent = Program()
    assert sent.version == PACKAGE.version
    monkeypatch.setattr(programs, "_package_digest", lambda: b"another package")
    assert pickle.loads(pickle.dumps(sent)).version != sent.version  # noqa: S301


def test_a_method_from_a_file_is_run_where_the_file_is_not(own):
    study, program = own
    assert study.methods == ("pbvs", "mine.Still")
    work = pickle.loads(pickle.dumps(PartWork(study.to_json(), program)))  # noqa: S301
    part = part_of_content(study, program.version, Path("part"), 0, work.content(0))
    still = part.rows[1]
    assert (still.method, still.version, still.status) == ("mine.Still", program.version, "timed_out")
    assert still.path_length_m == pytest.approx(0.01 * still.seconds, rel=0.2)
    assert run_row(study, 1, program).row == still


def test_rows_of_another_text_of_the_file_are_refused(own, tmp_path):
    study, program = own
    assert run_study(study, tmp_path / "rows", program=program, workers=1)
    assert read_header(tmp_path / "rows").study.methods == study.methods
    assert [row.method for row in rows_of(tmp_path / "rows")][:2] == ["pbvs", "mine.Still"]
    other = Program.of([own_file(tmp_path, speed=0.02)])
    assert len({other.version, program.version, PACKAGE.version}) == 3
    with pytest.raises(InputError, match=f"holds rows of version {re.escape(program.version)}; "):
        run_study(study, tmp_path / "rows", program=other, workers=1)


def test_a_program_without_the_study_s_method_is_refused_before_anything_is_run(own, tmp_path):
    with pytest.raises(InputError, match="method: 'mine.Still' given"):
        run_study(own[0], tmp_path / "rows", workers=1)
    assert not (tmp_path / "rows").exists()


def test_a_study_file_names_no_code(tmp_path):
    for given in (own_file(tmp_path), "mine.Still"):
        with pytest.raises(InputError, match=r"methods.*(names methods of the package|legal: certified)"):
            load_study(written(tmp_path, methods=f'["{given}"]'))


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("pbvs", "method file: 'pbvs' given; legal: FILE.py:CLASS"),
        ("mine.py", "method: 'mine.py' given"),
        ("mine.py:Absent", "mine.py has no class 'Absent'"),
        ("mine.py:np", "mine.py:np has no step|not callable|no class"),
        ("absent.py:Still", "absent.py"),
        ("broken.py:Still", r"method: broken.py: line 2: SyntaxError: "),
        ("failing.py:Still", r"method: failing.py: line 3: ModuleNotFoundError: No module named 'absent'"),
    ],
)
def test_a_wrong_method_file_is_named_before_anything_is_run(tmp_path, monkeypatch, source, message):
    own_file(tmp_path)
    (tmp_path / "broken.py").write_text("\nclass (\n")
    (tmp_path / "failing.py").write_text("\n\nimport absent\n")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=message):
        Program.of([source])


def test_a_name_given_twice_is_refused(tmp_path):
    with pytest.raises(InputError, match="a name is given twice"):
        Program.of([own_file(tmp_path)] * 2)
