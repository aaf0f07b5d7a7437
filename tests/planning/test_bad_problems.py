"""Every field of a problem file with every kind of wrong value: one clear message, in bounded time."""

import copy
import json
import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from omniservo.cameras import preset
from omniservo.cli.main import main
from omniservo.errors import InputError
from omniservo.planning import PlanningProblem
from omniservo.planning.obstacles.obstacle import KINDS
from omniservo.planning.problem_file import _REQUIRED, OPTIONAL

FULL: dict[str, Any] = {
    "format": "omniservo.problem/1",
    "camera": {
        **preset("fe185").to_dict(),
        "dead_zone": {"center": [20.0, 30.0], "radius": 5.0},
        "mask": [[[600.0, 400.0], [640.0, 400.0], [620.0, 420.0]]],
    },
    "points": [[0.0, 0.0, 0.6], [0.1, 0.0, 0.5]],
    "goal": {"translation": [0.1, 0.0, 0.1], "quaternion": [0.0, 0.0, 0.0, 1.0]},
    "obstacles": [
        {
            "type": "sphere",
            "center": [0.0, 0.5, 0.0],
            "radius": 0.1,
            "clearance": 0.1,
            "motion": [[0.0, 0.1, 0.0], [0.0, 0.0, 0.0], [0.1, 0.0, 0.0]],
        },
        {
            "type": "box",
            "center": [0.0, -0.5, 0.0],
            "quaternion": [0.0, 0.0, 0.0, 1.0],
            "half_extents": [0.1, 0.1, 0.1],
        },
        {"type": "capsule", "from": [0.5, 0.5, 0.0], "to": [0.5, 0.6, 0.0], "radius": 0.1},
        {"type": "half_space", "normal": [0.0, 0.0, 1.0], "offset": -0.5},
        {"type": "cloud", "points": [[0.5, 0.0, 0.0], [0.5, 0.1, 0.0]], "radius": 0.01},
        {"type": "mesh", "vertices": [[0.5, 0.5, 0.5], [0.6, 0.5, 0.5], [0.5, 0.6, 0.5], [0.5, 0.5, 0.6]]},
        {"type": "cylinder", "from": [0.7, 0.5, 0.0], "to": [0.7, 0.6, 0.0], "radius": 0.1},
        {
            "type": "ellipsoid",
            "center": [0.0, -0.8, 0.0],
            "quaternion": [0.0, 0.0, 0.0, 1.0],
            "radii": [0.1, 0.1, 0.1],
        },
    ],
    "clearance": 0.01,
    "least_distance": 0.02,
    "visibility_margin": 1.0,
    "occlusion": True,
    "workspace": {
        "min": [-1.0, -1.0, -1.0],
        "max": [1.0, 1.0, 1.0],
        "half_spaces": [{"normal": [0.0, 0.0, 1.0], "offset": -0.5}],
    },
    "degrees": {"rotation": 2, "translation": 2},
    "initial_velocity": [0.1, 0.0, 0.0, 0.0, 0.0, 0.0],
}
"""Every field that there is."""

MAY_BE_NULL = {
    "skew",
    "distortion",
    "max_angle",
    "dead_zone",
    "mask",
    "clearance",
    "workspace",
    "degrees",
    "initial_velocity",
    "motion",
    "min",
    "max",
}
"""null says the same as leaving the field out, or has a meaning of its own"""

SIGNED = {"fx", "fy", "cx", "cy", "skew", "offset"}
"""numbers that may be negative"""

UNITS = {"normal", "quaternion"}

HUGE = 10**400
LONG = "x" * 100_000


def nested(depth: int) -> Any:
    value: Any = 0.0
    for _ in range(depth):
        value = [value]
    return value


NO_NUMBER = [
    "1.0",
    LONG,
    math.nan,
    math.inf,
    -math.inf,
    [1.0],
    {},
    {"a": 1},
    True,
    HUGE,
    -HUGE,
    1e300,
    nested(900),
]
NO_LIST = ["[0, 0, 0]", LONG, 5, True, {}, {"0": 1.0}, nested(900)]
NO_MAPPING = ["text", LONG, 5, True, [], [["a", 1]], nested(900)]
NO_TEXT = [5, True, [], {}, nested(900), LONG, "x", "", "a\nb", "\ud800", "\0"]
NO_FLAG = [0, 1, "true", [], {}, math.nan, LONG]


def wrong_vectors(given: list[float], unit: bool) -> Iterator[Any]:
    yield from [[], given[:-1], [*given, 0.0], [given], [[x] for x in given], given * 100_000]
    for bad in ("0", None, math.nan, math.inf, True, HUGE, 1e300, [0.0], {}):
        yield [*given[:-1], bad]
    if unit:
        yield from [[0.0] * len(given), [2 * x for x in given], [x * (1 + 2e-6) for x in given]]


def wrong_values(name: str, value: Any) -> Iterator[Any]:
    """What may not stand in the place of a legal value of this kind."""
    if name not in MAY_BE_NULL:
        yield None
    if isinstance(value, bool):
        yield from NO_FLAG
    elif isinstance(value, int | float):
        yield from NO_NUMBER
        if name not in SIGNED:
            yield -1
    elif isinstance(value, str):
        yield from NO_TEXT
    elif isinstance(value, dict):
        yield from NO_MAPPING
        yield {**value, "unknown": 1}
        yield {**value, LONG: 1}
        yield {**value, "a\nb\ud800": 1}
    else:
        yield from NO_LIST
        if isinstance(value[0], float):
            yield from wrong_vectors(value, name in UNITS)
        elif isinstance(value[0], list):
            yield from ([*value[:-1], bad] for bad in (None, 0.0, "0", []))
            if isinstance(value[0][0], float):
                yield from ([*value[:-1], bad] for bad in wrong_vectors(value[-1], unit=False))


def places(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """The path to every field, and to the items of lists of mappings."""
    if path:
        yield path
    if isinstance(value, dict):
        for key, item in value.items():
            yield from places(item, (*path, key))
    elif isinstance(value, list) and isinstance(value[0], dict):
        for i, item in enumerate(value):
            yield from places(item, (*path, i))


def changed(path: tuple[Any, ...], value: Any) -> dict[str, Any]:
    document = copy.deepcopy(FULL)
    node: Any = document
    for key in path[:-1]:
        node = node[key]
    node[path[-1]] = value
    return document


def at(path: tuple[Any, ...]) -> Any:
    node: Any = FULL
    for key in path:
        node = node[key]
    return node


def spelled(path: tuple[Any, ...]) -> str:
    """A pattern: the parts of the path in order, as "obstacles[2].radius" or "camera: fx"."""
    return ".*?".join(rf"\[{p}\]" if isinstance(p, int) else rf"\b{re.escape(p)}\b" for p in path)


def check_message(error: InputError, file: Path, path: tuple[Any, ...]) -> None:
    text = str(error)
    assert text.startswith(f"{file}: ")
    assert re.search(spelled(path), text), (path, text)
    assert len(text.removeprefix(str(file))) < 400, text
    assert text.isprintable(), text


def test_the_full_document_is_legal_and_has_every_field(tmp_path):
    file = tmp_path / "p.json"
    file.write_text(json.dumps(FULL))
    problem = PlanningProblem.load(file)
    assert set(FULL) == {*_REQUIRED, *OPTIONAL}
    assert set(FULL["camera"]) == set(problem.camera.to_dict())
    assert {o["type"] for o in FULL["obstacles"]} == set(KINDS)
    for obstacle in FULL["obstacles"]:
        assert {"type", *KINDS[obstacle["type"]].FIELDS} == set(obstacle) - {"clearance", "motion"}


@pytest.mark.parametrize("path", list(places(FULL)), ids=lambda p: ".".join(map(str, p)))
def test_each_wrong_value_is_named_with_its_file_and_field(tmp_path, path):
    file = tmp_path / "p.json"
    for bad in wrong_values(path[-1], at(path)):
        file.write_text(json.dumps(changed(path, bad)))
        with pytest.raises(InputError) as caught:
            PlanningProblem.load(file)
            pytest.fail(f"{path}: {bad!r:.80} was taken")
        check_message(caught.value, file, path)


REQUIRED = [
    *((name,) for name in _REQUIRED),
    *(("goal", name) for name in FULL["goal"]),
    *(("camera", name) for name in ("model", "fx", "fy", "cx", "cy", "xi", "width", "height")),
    ("camera", "dead_zone", "center"),
    ("camera", "dead_zone", "radius"),
    *(
        ("obstacles", i, name)
        for i, o in enumerate(FULL["obstacles"])
        for name in o
        if name not in MAY_BE_NULL and not (o["type"] in ("box", "ellipsoid") and name == "quaternion")
    ),
    ("workspace", "min"),
    ("workspace", "max"),
    ("workspace", "half_spaces", 0, "normal"),
    ("workspace", "half_spaces", 0, "offset"),
]


@pytest.mark.parametrize("path", REQUIRED, ids=lambda p: ".".join(map(str, p)))
def test_each_missing_field_is_named(tmp_path, path):
    document = changed(path, None)
    node: Any = document
    for key in path[:-1]:
        node = node[key]
    del node[path[-1]]
    file = tmp_path / "p.json"
    file.write_text(json.dumps(document))
    with pytest.raises(InputError) as caught:
        PlanningProblem.load(file)
    check_message(caught.value, file, path)


OUT_OF_RANGE = {
    "zero-size box": (("obstacles", 1, "half_extents"), [0.1, 0.0, 0.1]),
    "inverted box": (("obstacles", 1, "half_extents"), [0.1, -0.1, 0.1]),
    "capsule without radius": (("obstacles", 2, "radius"), 0.0),
    "dead zone without radius": (("camera", "dead_zone", "radius"), 0.0),
    "focal length 0": (("camera", "fx"), 0.0),
    "focal length tiny": (("camera", "fy"), 1e-300),
    "angle 0": (("camera", "max_angle"), 0.0),
    "angle beyond a half turn": (("camera", "max_angle"), 3.2),
    "half a pixel": (("camera", "width"), 640.5),
    "no pixel": (("camera", "height"), 0),
    "a billion pixels": (("camera", "height"), 10**9),
    "mask dented": (("camera", "mask"), [[[0, 0], [9, 0], [2, 2], [0, 9]]]),
    "no target": (("points",), []),
    "motion of high degree": (("obstacles", 0, "motion"), [[0.0] * 18] * 3),
    "motion in the plane": (("obstacles", 0, "motion"), [[0.0, 0.1]] * 2),
    "motion far": (("obstacles", 0, "motion"), [[1e7, 0.0]] * 3),
    "million coefficients": (("obstacles", 0, "motion"), [[0.0] * 10**6] * 3),
    "target far": (("points",), [[0.0, 0.0, 1e7]]),
    "target flat": (("points",), [0.0, 0.0, 1.0]),
    "half degree": (("degrees", "rotation"), 1.5),
    "high degree": (("degrees", "translation"), 17),
    "inverted workspace": (("workspace", "min"), [2.0, -1.0, -1.0]),
    "million points": (("points",), [[0, 0, 1]] * 10**6),
    "million obstacles": (("obstacles",), [0] * 10**6),
    "million polygons": (("camera", "mask"), [0] * 10**6),
    "million half-spaces": (("workspace", "half_spaces"), [0] * 10**6),
}


@pytest.mark.parametrize("name", OUT_OF_RANGE)
def test_what_no_problem_has_is_named(tmp_path, name):
    path, bad = OUT_OF_RANGE[name]
    file = tmp_path / "p.json"
    file.write_text(json.dumps(changed(path, bad)))
    with pytest.raises(InputError) as caught:
        PlanningProblem.load(file)
    check_message(caught.value, file, path)


TEXTS = {
    "deep JSON": ('{"a":' * 100_000 + "1" + "}" * 100_000, "nested too deeply"),
    "deep YAML": ("[" * 10_000 + "]" * 10_000, "nested"),
    "deep YAML blocks": ("\n".join(" " * k + "a:" for k in range(1000)), "nested"),
    "field twice": ('{"clearance": 1, "clearance": 2}', "field 'clearance' is given twice"),
    "long field twice": (f'{{"{LONG}": 1, "{LONG}": 2}}', "is given twice"),
    "field twice among many": (
        "{" + ",".join(f'"{k}": 0' for k in range(200_000)) + ', "199999": 1}',
        "field '199999' is given twice",
    ),
    "field twice in YAML": ("clearance: 1\nclearance: 2\n", "'clearance' is given twice"),
    "long number": ('{"clearance": ' + "9" * 1_000_000 + "}", "number .* digits"),
    "long number in YAML": ("clearance: " + "9" * 100_000, "number .* digits"),
    "alias": ("a: &x [1]\nb: *x\n", "aliases are not read"),
    "tag": ("!!python/object/apply:os.system [echo]\n", "tag"),
    "tag of an empty number": ('clearance: !!int ""\n', "tag"),
    "tag of a wrong flag": ("occlusion: !!bool maybe\n", "tag"),
    "tag of a wrong date": ("clearance: !!timestamp soon\n", "tag"),
    "list": ("[1, 2]", "mapping"),
    "text": ("just text", "mapping"),
    "nothing": ("", "mapping"),
    "broken": ('{"format": ', "line 1: not JSON"),
    "control character": ('{"clearance": "\x01"}', "not JSON"),
    "much YAML": ("a: 1\n" + "# more\n" * 200_000, "1048576 bytes of YAML"),
}


@pytest.mark.parametrize("name", TEXTS)
def test_a_document_that_is_none_is_refused_with_the_reason(tmp_path, name):
    text, says = TEXTS[name]
    file = tmp_path / "p.json"
    file.write_text(text)
    with pytest.raises(InputError, match=says) as caught:
        PlanningProblem.load(file)
    check_message(caught.value, file, ())


def test_bytes_that_are_no_text_and_files_too_large_are_refused_unread(tmp_path):
    file = tmp_path / "p.json"
    file.write_bytes(b"\xff\xfe{}")
    with pytest.raises(InputError, match="not a text file"):
        PlanningProblem.load(file)
    with file.open("wb") as stream:
        stream.truncate(100 * 2**20)
    with pytest.raises(InputError, match="104857600 bytes; at most 16777216 are read"):
        PlanningProblem.load(file)
    with pytest.raises(InputError, match="not a file"):
        PlanningProblem.load(tmp_path)


PATHS = {
    "parent": ("../lens.json", "inside the file's folder"),
    "through a folder": ("cameras/../../lens.json", "inside the file's folder"),
    "absolute": ("/etc/hostname", "inside the file's folder"),
    "link out": ("out.json", "inside the file's folder"),
    "linked folder": ("outside/lens.json", "inside the file's folder"),
    "loop": ("loop.json", "camera: "),
    "absent": ("absent.json", "no such file"),
    "folder": ("cameras", "not a file"),
    "empty": ("", "camera: "),
    "null byte": ("a\0b", "camera: "),
    "surrogate": ("\ud800", "camera: "),
    "long": (LONG, "camera: "),
    "many parts": ("a/" * 50_000, "camera: "),
    "itself": ("p.json", "camera: "),
}


@pytest.mark.parametrize(
    "place",
    [("camera",), ("obstacles", 4, "file"), ("obstacles", 5, "file")],
    ids=["camera", "cloud", "mesh"],
)
@pytest.mark.parametrize("name", PATHS)
def test_a_path_that_is_no_such_file_in_the_folder_is_refused(tmp_path, place, name):
    given, says = PATHS[name]
    folder = tmp_path / "inside"
    (folder / "cameras").mkdir(parents=True)
    (tmp_path / "lens.json").write_text(json.dumps(preset("fe185").to_dict()))
    (folder / "out.json").symlink_to(tmp_path / "lens.json")
    (folder / "outside").symlink_to(tmp_path)
    (folder / "loop.json").symlink_to(folder / "loop.json")
    file, document = folder / "p.json", copy.deepcopy(FULL)
    if place == ("camera",):
        document["camera"] = given
    else:
        more = {"radius": 0.1} if place[1] == 4 else {}
        kind = FULL["obstacles"][place[1]]["type"]
        document["obstacles"][place[1]] = {"type": kind, "file": given, **more}
        says = says if "inside" in says else "file: "
    file.write_text(json.dumps(document))
    with pytest.raises(InputError, match=says) as caught:
        PlanningProblem.load(file)
    check_message(caught.value, file, place)


@pytest.mark.parametrize(
    "text",
    [
        json.dumps(changed(("clearance",), -1)),
        json.dumps(changed(("points",), [[0, 0, math.nan]])),
        json.dumps({**FULL, "camera": "../lens.json"}),
        json.dumps({**FULL, "visibility_margin": 1000.0}),
        '{"clearance": 1, "clearance": 2}',
        "[" * 100_000,
    ],
)
def test_the_command_line_says_it_on_one_line_and_exits_with_2(tmp_path, capsys, text):
    file = tmp_path / "p.json"
    file.write_text(text)
    with pytest.raises(SystemExit) as left:
        main(["plan", str(file)])
    assert left.value.code == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert str(file) in said.err or "visibility_margin" in said.err
    assert "Traceback" not in said.err
    assert len(said.err.strip().splitlines()) == 1
