import math
import re

import numpy as np
import pytest
from tests.studies.conftest import written

from omniservo.camera_files import save_camera
from omniservo.cameras import preset
from omniservo.errors import InputError
from omniservo.shipped_studies import shipped_studies, study_file
from omniservo.studies import load_study
from omniservo.studies.distribution import read_distribution
from omniservo.studies.load_study import study_of_json


@pytest.mark.parametrize("name", shipped_studies())
def test_every_shipped_study_is_legal(name):
    assert load_study(name).name == name


def test_a_study_is_the_same_study_in_its_own_json(study):
    again = study_of_json(study.to_json())
    assert again.to_json() == study.to_json()
    assert again.hash == study.hash
    assert list(again.cameras) == ["fe185", "perspective"]


def test_units_are_taken_in(study):
    assert study.start.rotation.bounds == pytest.approx((math.radians(5), math.radians(60)))


@pytest.mark.parametrize(
    "fields",
    [
        {"seed": 8},
        {"methods": "[ibvs, certified, pbvs]"},
        {"cameras": "[perspective, fe185]"},
        {"scenes": 15},
    ],
)
def test_whatever_differs_changes_the_hash(study, tmp_path, fields):
    assert load_study(written(tmp_path, **fields)).hash != study.hash


def test_the_hash_is_that_of_the_camera_and_not_of_its_file_name(study, tmp_path):
    other = tmp_path / "a"
    other.mkdir()
    save_camera(preset("fe185"), tmp_path / "lens.json", "own")
    save_camera(preset("perspective"), other / "lens.json", "own")
    hashes = {load_study(written(folder, cameras="{mine: lens.json}")).hash for folder in (tmp_path, other)}
    assert len(hashes) == 2


def test_rows_are_scenes_times_cameras_times_methods(study):
    assert study.rows == 9 * 2 * 3
    places = [study.place(row) for row in range(7)]
    assert [method for _, _, method in places] == ["certified", "ibvs", "pbvs"] * 2 + ["certified"]
    assert [camera for _, camera, _ in places] == ["fe185"] * 3 + ["perspective"] * 3 + ["fe185"]
    assert [scene for scene, _, _ in places] == [0, 0, 0, 1, 1, 1, 2]


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"format": "omniservo.study/2"}, "format: 'omniservo.study/2' given; legal: 'omniservo.study/1'"),
        ({"scens": 3}, "scens: no such field; legal: name, seed, scenes.*did you mean 'scenes'"),
        ({"arm": "rx60"}, "arm: no such field; .*did you mean .arms."),
        ({"scenes": 0}, "scenes: .*greater than or equal to 1; 0 given"),
        ({"scenes": 10**7}, "rows; legal: at most"),
        ({"seed": -1}, "seed: .*-1 given"),
        ({"name": "../x"}, "name: "),
        ({"cameras": "[]"}, "cameras: "),
        ({"cameras": "[fe186]"}, "cameras.fe186: .*did you mean 'fe185'"),
        ({"cameras": "[fe185, fe185]"}, "cameras: .*twice"),
        ({"cameras": "[../../etc/passwd]"}, "legal: a relative path inside the file's folder"),
        ({"methods": "[ibv]"}, "methods: .*did you mean 'ibvs'"),
        ({"methods": "[own.py:Method]"}, "methods: .*of the package alone"),
        ({"methods": "[ibvs, ibvs]"}, "methods: .*given twice"),
        ({"units": "{angle: turn}"}, "units.angle"),
        ({"start": "{rotation: {uniform: [0, 181]}}"}, "start.rotation: .*legal: 0 to 3.14159"),
        ({"start": "{rotation: {uniform: [9, 3]}}"}, "start.rotation: .*legal: .LEAST, MOST."),
        ({"start": "{rotation: {gauss: [9, 3]}}"}, "start.rotation: .*legal: a number, .uniform"),
        ({"start": "{rotation: {normal: [9, 3]}}"}, "start.rotation: .*normal distribution has no bounds"),
        ({"start": "{distance_ratio: .nan}"}, "start.distance_ratio: "),
        ({"target": "{points: 3}"}, "target.points: .*legal: 4 to 500"),
        ({"target": "{points: {uniform: [5, 9]}}"}, "target.points: .*whole number"),
        ({"target": "{size: -1}"}, "target.size: "),
        ({"images": "{lost: 1.5}"}, "images.lost: .*legal: 0 to 1"),
        ({"images": "{noise: {log_uniform: [0, 1]}}"}, "images.noise: .*above 0"),
        ({"images": "{rate: 0}"}, "images.rate: "),
        ({"obstacles": "{count: {choice: []}}"}, "obstacles.count: "),
        ({"errors": "{focal: yes}"}, "errors.focal: "),
        ({"errors": "{focal: {uniform: [-1.0e308, 1.0e308]}}"}, "errors.focal: uniform: numbers within"),
        (
            {"images": "{noise: {log_uniform: [1.0e-300, 1.0e8]}}"},
            "images.noise: log_uniform: legal: MOST at",
        ),
        ({"images": f"{{noise: 1{'0' * 400}}}"}, "images.noise: legal: a number.*numbers within"),
        ({"cameras": '{"a\\n\\e[31m": fe185}'}, r"cameras: name 'a.*legal: 1 to 200 characters that are"),
        ({"cameras": '{"": fe185}'}, r"cameras: name ''; legal: 1 to 200"),
        (
            {"arms": '{choice: ["x\\t"], mounts: {"x\\t": {model: ur5e, flange_T_camera: {}}}}'},
            r"arms: .*name 'x.*legal: 1 to 200",
        ),
        ({"limits": "{translation: 0}"}, "limits.translation: "),
        ({"servo": "{gain: .inf}"}, "servo.gain: "),
        ({"servo": "{visibility_margin: 216}"}, "servo.visibility_margin: 216 .* less than 216, .* of fe185"),
    ],
)
def test_what_is_wrong_in_a_study_is_named(tmp_path, fields, message):
    with pytest.raises(InputError, match=message) as refused:
        load_study(written(tmp_path, **fields))
    assert "study.yaml" in str(refused.value)
    assert len(str(refused.value)) < 600


def test_a_wrong_name_is_refused_with_the_shipped_ones():
    with pytest.raises(
        InputError, match="shipped studies: mine, paper-benchmark, quick; did you mean 'quick'"
    ):
        load_study("quik")


@pytest.mark.parametrize(
    ("field", "mean", "sigma"),
    [
        (3.0, 3.0, 0.0),
        ({"uniform": [1, 3]}, 2.0, 2 / math.sqrt(12)),
        ({"normal": [1, 0.5]}, 1.0, 0.5),
        ({"choice": [0, 1, 5]}, 2.0, math.sqrt(14 / 3)),
        ({"log_uniform": [1, math.e]}, math.e - 1, math.sqrt((math.e**2 - 1) / 2 - (math.e - 1) ** 2)),
    ],
)
def test_draws_have_the_stated_mean_and_deviation(field, mean, sigma):
    random, said = np.random.default_rng(5), read_distribution(field)
    drawn = np.array([said.draw(random) for _ in range(20_000)])
    assert drawn.mean() == pytest.approx(mean, abs=4 * sigma / math.sqrt(20_000) + 1e-12)
    assert drawn.std() == pytest.approx(sigma, rel=0.03, abs=1e-12)
    assert drawn.min() >= said.bounds[0]
    assert drawn.max() <= said.bounds[1]


def test_the_template_says_what_every_field_is():
    text, sections = study_file("mine").read_text(), load_study("mine").model_dump()
    for section in ("target", "start", "obstacles", "images", "errors", "limits"):
        for name in sections[section]:
            assert re.search(rf"(?m)^  (# )?{name}: ", text), name
