import copy
import json
import re

import pytest
from tests.tasks.test_load_task import MINIMAL

from omniservo.errors import InputError
from omniservo.tasks import load_task

ROD = {"type": "capsule", "from": [0, 0, 900], "to": [0, 0, 950], "radius": 1, "clearance": 3}
BOX = {"min": [-300, -300, -300], "max": [300, 300, 300], "quaternion": [0, 0, 0, 1]}
FULL = {
    **MINIMAL,
    "sensor": {"rate": 30, "jpeg": 90},
    "scale": {"known_length": {"dots": [0, 1], "length": 5}, "sigma": 0.1},
    "planning": {
        "obstacles": [{"center": [0, 0, 900], "radius": 1}, ROD],
        "clearance": 3,
        "arm_clearance": 4,
        "visibility_margin": 2,
        "risk": 0.1,
        "looks": 1,
        "occlusion": True,
        "workspace": BOX,
        "degrees": {"rotation": 2, "translation": 3},
    },
    "servo": {"gain": 2},
    "simulation": {"light": {"brightness": 1, "direction": [1, 1, 1]}, "lens_error": {"sigma": 0.1}},
    "obstacles": [{"center": [0, 0, 900], "half_extents": [1, 1, 1]}],
    "moves": [{"time": 1, "by": [1, 0, 0], "bodies": [0], "known": [0]}],
}


def leaves(value, place=()):
    """Yield where the numbers and flags of a document stand."""
    if isinstance(value, dict | list):
        for key, inner in value.items() if isinstance(value, dict) else enumerate(value):
            yield from leaves(inner, (*place, key))
    elif not isinstance(value, str):
        yield place


@pytest.mark.parametrize("wrong", [str, bool])
def test_neither_texts_nor_flags_are_numbers_anywhere_in_a_task(tmp_path, wrong):
    path = tmp_path / "task.json"
    path.write_text(json.dumps(FULL))
    load_task(path)
    for *holders, name in leaves(FULL):
        document = copy.deepcopy(FULL)
        holder = document
        for key in holders:
            holder = holder[key]
        if type(holder[name]) is wrong:
            continue
        holder[name] = wrong(holder[name])
        path.write_text(json.dumps(document))
        with pytest.raises(InputError, match=re.escape(f"task.json: {[*holders, name][0]}.")):
            load_task(path)


@pytest.mark.parametrize(
    ("section", "field", "legal"),
    [
        (
            "start",
            {"world_T_camera": {"translation": [1e300, 0, 0]}},
            "translation.0: legal: -1e+06 to 1e+06 m",
        ),
        ("arm", {"foot": [0, 0, -1e300]}, "arm.foot.2: legal: -1e+06 to 1e+06 m"),
        (
            "teach",
            {"initial_T_goal": {"rotation_vector": [0, 1e300, 0]}},
            "vector.1: legal: -1e+06 to 1e+06 rad",
        ),
    ],
)
def test_places_and_turns_beyond_all_measure_are_refused_by_their_field(tmp_path, section, field, legal):
    path = tmp_path / "task.json"
    path.write_text(json.dumps({**FULL, section: {**FULL[section], **field}}))
    with pytest.raises(InputError, match=re.escape(legal)):
        load_task(path)
