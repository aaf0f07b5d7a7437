import pytest

from omniservo.studies import load_study, read_parts, run_study

SHORT = """
format: omniservo.study/1
name: short
units: {angle: deg}
seed: 7
scenes: 9
cameras: [fe185, perspective]
methods: [certified, ibvs, pbvs]
start: {rotation: {uniform: [5, 60]}}
obstacles: {count: {choice: [0, 1, 2]}, radius: 0.02}
images: {noise: {uniform: [0, 0.4]}, lost: 0.05, wrong: 0.02, jitter: 0.02, dropped: 0.1, delayed: 0.1}
errors: {depth: {normal: [0, 0.01]}, focal: {normal: [0, 0.001]}, model: 0.1}
limits: {seconds: 0.4}
"""


def written(folder, text=SHORT, **fields):
    """Return the path of a study file; ``fields`` stand in the place of lines that begin so."""
    lines = [line for line in text.splitlines() if line.partition(":")[0] not in fields]
    path = folder / "study.yaml"
    path.write_text("\n".join([*lines, *(f"{name}: {value}" for name, value in fields.items())]) + "\n")
    return path


def rows_of(folder):
    return [row for part in read_parts(folder) for row in part.rows]


@pytest.fixture(scope="session")
def study(tmp_path_factory):
    """54 rows of 0.4 s each, in 6 parts."""
    return load_study(written(tmp_path_factory.mktemp("study")))


@pytest.fixture(scope="session")
def undisturbed(study, tmp_path_factory):
    """The folder of the study, run at once in this process."""
    folder = tmp_path_factory.mktemp("undisturbed") / "rows"
    assert run_study(study, folder, workers=1)
    return folder
