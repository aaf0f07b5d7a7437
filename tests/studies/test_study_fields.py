"""Every number of a study's file does something: another one makes other rows."""

import json
from dataclasses import replace

import pytest
from tests.studies.conftest import written

from omniservo.studies import Study, load_study, run_row

COMMON = """
format: omniservo.study/1
name: fields
units: {angle: deg}
seed: 3
scenes: 2
cameras: [fe185]
methods: [pbvs]
"""
GIVEN = {
    "target": {"distance": 0.5},
    "start": {"rotation": {"uniform": [20, 60]}},
    "obstacles": {"count": 2, "radius": 0.02},
    "images": {"noise": 0.2},
    "limits": {"seconds": 1.0},
}
OTHERS = {
    "target": {"points": 12, "size": 0.2, "distance": 0.6, "off_axis": 5, "view_share": 0.3},
    "start": {"rotation": 180, "distance_ratio": 2.0, "off_axis": 10, "view_share": 0.4},
    "obstacles": {"count": 1, "radius": 0.05, "aside": 0.3, "clearance": 0.2, "moved": 1, "moved_at": 0.1},
    "images": {
        "noise": 1.0, "lost": 0.3, "wrong": 0.1, "rate": 15, "latency": 0.08, "jitter": 0.05, "dropped": 0.3,
        "delayed": 0.5, "delay": 0.05,
    },
    "errors": {
        "model": 1.0, "focal": 0.02, "centre": 5.0, "depth": 0.1, "mount_translation": 0.02,
        "mount_rotation": 5,
    },
    "servo": {
        "gain": 0.5, "tolerance_px": 90, "linear_speed": 0.05, "angular_speed": 10, "clearance_margin": 0.05,
        "visibility_margin": 195, "risk": 0.01, "depth_sigma": 0.05,
    },
    "limits": {"translation": 0.5, "rotation": 170, "seconds": 0.5},
}  # fmt: skip
FIELDS = [(section, field) for section, fields in OTHERS.items() for field in fields]
WITH = {
    "mount_translation": {"arms": "ur5e"},
    "mount_rotation": {"arms": "ur5e"},
    "moved_at": {"obstacles": {"moved": 1}},
    "delay": {"images": {"delayed": 0.5}},
    "clearance_margin": {"methods": ["certified"]},
    "visibility_margin": {"methods": ["certified"]},
    "risk": {"methods": ["certified"]},
    "depth_sigma": {"methods": ["certified"], "servo": {"risk": 0.01}},
    "translation": {"limits": {"rotation": 170}, "obstacles": {"count": 0}},
    "rotation": {"limits": {"translation": 0.5}, "obstacles": {"count": 0}},
    "tolerance_px": {"limits": {"seconds": 4.0}},
}
"""what a field needs to count at all"""


def rows(folder, *changes):
    """Return the rows of the study with these sections, without its hash."""
    sections = {name: dict(fields) for name, fields in GIVEN.items()}
    for change in changes:
        for name, value in change.items():
            sections[name] = {**sections.get(name, {}), **value} if isinstance(value, dict) else value
    study = load_study(written(folder, COMMON, **sections))
    return [replace(run_row(study, number).row, study_hash="") for number in range(study.rows)]


@pytest.fixture(scope="module")
def before(tmp_path_factory):
    """Makes the rows of the study with what a field needs: once for all fields that need the same."""
    known = {}

    def made(needed):
        name = json.dumps(needed)
        if name not in known:
            known[name] = rows(tmp_path_factory.mktemp("before"), needed)
        return known[name]

    return made


def test_these_are_all_numbers_of_the_file():
    sections = {name: set(Study.model_fields[name].annotation.model_fields) for name in OTHERS}
    assert sections == {name: set(fields) for name, fields in OTHERS.items()}


@pytest.mark.parametrize(("section", "field"), FIELDS)
def test_another_number_makes_other_rows(tmp_path, before, section, field):
    needed = WITH.get(field, {})
    assert before(needed) != rows(tmp_path, needed, {section: {field: OTHERS[section][field]}})


def test_another_seed_draws_other_scenes_and_the_same_one_the_same(tmp_path):
    first, again, other = ([row.start_distance_m for row in rows(tmp_path, {"seed": k})] for k in (3, 3, 4))
    assert first == again
    assert not set(first) & set(other)
    assert len(set(first)) == len(first)
