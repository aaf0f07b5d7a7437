"""Whatever stands in a document: PlanFileError or an answer, and never "certified" for a false plan."""

import copy

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sampled_plans import camera, path, plan, problem, true_margins

from omniservo.verification import Certificate, PlanFileError, verify_plan

DETOUR = (0.06, 0.0, 0.0)
BOX = {
    "type": "box",
    "center": [5.0, 0.0, 0.0],
    "quaternion": [0.0, 0.0, 0.0, 1.0],
    "half_extents": [0.5, 0.5, 0.5],
}
MESH = {
    "type": "mesh",
    "vertices": [[-5.0, 0.0, 0.0], [-5.0, 1.0, 0.0], [-5.0, 0.0, 1.0], [-6.0, 0.0, 0.0]],
    "motion": [[0.0, 0.25], [0.0, 0.0], [0.5, 0.0]],
}


def base():
    """Every kind of field that the verifier reads, small."""
    lens = camera("para-catadioptric") | {"max_angle": 1.9}
    lens["dead_zone"]["radius"] = 2.0
    lens["mask"] = [[[5.0, 5.0], [25.0, 5.0], [15.0, 25.0]]]
    asked = problem(
        camera=lens,
        points=[[0.12, -0.05, 0.5], [0.1, 0.06, 0.55]],
        obstacles=[
            {"type": "sphere", "center": [0.0, -0.4, 0.1], "radius": 0.05, "motion": [[0.1, 0.0]] * 3},
            {"type": "half_space", "normal": [0.0, 0.0, 1.0], "offset": -0.5, "clearance": 0.01},
            {"type": "cloud", "points": [[-0.4, 0.2, 0.1], [-0.4, 0.25, 0.1]], "radius": 0.01},
        ],
        occlusion=True,
        clearance=0.02,
        workspace={
            "min": [-1.0, -1.0, -1.0],
            "max": [1.0, 1.0, 1.0],
            "half_spaces": [{"normal": [0.0, 1.0, 0.0], "offset": -0.5}],
        },
    )
    way = path(asked, DETOUR)
    asked["initial_velocity"] = [row[-2] for row in way["translation"]] + [0.0, 0.0, 0.0]
    truth = true_margins(asked, way, 2001)
    margins = {name: m - 1e-3 - 0.2 * (name.split()[0] == "visibility") for name, (m, _, _) in truth.items()}
    asked["obstacles"] += [BOX, MESH]
    sides = {3: [-1.0, 0.0, 0.0], 4: [1.0, 0.0, 0.0]}
    margins |= {f"{family} obstacle {i}": 0.5 for family in ("clearance", "occlusion") for i in sides}
    document = plan(asked, way, margins)
    separators = document["certificate"]["separators"] = []
    for i, normal in sides.items():
        pieces = [[0.0, 0.5, *normal], [0.5, 1.0, *normal]]
        separators.append({"constraint": f"clearance obstacle {i}", "pieces": pieces})
        for j in range(2):
            separators.append({"constraint": f"occlusion obstacle {i}", "point": j, "pieces": pieces})
    return document


BASE = base()
SCALARS = st.one_of(
    st.none(),
    st.booleans(),
    st.floats(),
    st.sampled_from([0, -1, 1e-300, -1e-320, 1e300, -1e200, 1e30, 10**400, 1 << 70, float("nan")]),
    st.text(max_size=4),
    st.sampled_from(["sphere", "mesh", "cloud", "certified", "infeasible", "undecided", "refuted"]),
    st.lists(st.floats(allow_nan=False), max_size=4),
    st.lists(st.lists(st.floats(-1e3, 1e3), min_size=3, max_size=3), max_size=5),
    st.dictionaries(st.sampled_from(["type", "center", "name", "w"]), st.integers(), max_size=2),
)


def places(node, at=()):
    """Every place in the document."""
    yield at
    children = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    for key, child in children:
        yield from places(child, (*at, key))


PLACES = [at for at in places(BASE) if at]


def put(document, at, value, *, drop=False):
    """Replace or drop what stands at a place, where the place is still there."""
    node = document
    for key in at[:-1]:
        if not isinstance(node, dict | list) or (isinstance(node, list) and not 0 <= key < len(node)):
            return
        node = node.get(key) if isinstance(node, dict) else node[key]
    if isinstance(node, dict) or (isinstance(node, list) and at[-1] < len(node)):
        node[at[-1]] = value
        if drop:
            del node[at[-1]]


def answered(document):
    try:
        answer = verify_plan(document)
    except PlanFileError:
        return "error"
    assert isinstance(answer, Certificate)
    assert answer.reasons or answer.status == "certified"
    return answer.status


def test_the_plan_that_is_fuzzed_is_certified():
    answer = verify_plan(copy.deepcopy(BASE))
    assert answer.status == "certified", answer.reasons


@settings(max_examples=150, deadline=None, derandomize=True)
@given(st.lists(st.tuples(st.sampled_from(PLACES), SCALARS, st.booleans()), min_size=1, max_size=3))
def test_any_change_of_a_document_is_answered(changes):
    document = copy.deepcopy(BASE)
    for at, value, drop in changes:
        put(document, at, value, drop=drop)
    answered(document)


PATH = [at for at in PLACES if at[0] == "path" and len(at) == 4]


@pytest.mark.parametrize("scale", [1e-320, 1e-150, 1e10, 1e80, 1e160, 1e300])
def test_numbers_of_any_size_are_answered(scale):
    rng = np.random.default_rng(int(abs(np.log10(scale))))
    numeric = [at for at in PLACES if at[0] in ("problem", "path", "certificate")]
    for at in rng.choice(len(numeric), 30):
        document = copy.deepcopy(BASE)
        node = document
        for key in numeric[at]:
            node = node[key]
        if isinstance(node, float):
            put(document, numeric[at], scale * (1 if node >= 0 else -1))
            answered(document)


@settings(max_examples=40, deadline=None, derandomize=True)
@given(st.sampled_from(PATH), st.floats(1e-8, 1e3) | st.floats(-1e3, -1e-8))
def test_no_coefficient_of_the_path_may_change(at, by):
    # The poses fix both ends, the velocity the start: nothing is free at degree 2.
    document = copy.deepcopy(BASE)
    _, name, row, _ = at
    node = document["path"][name][row]
    node[at[3]] += by
    if name == "rotation" and row == 3:
        return  # only stretches the quaternion
    assert answered(document) == "refuted"


@settings(max_examples=30, deadline=None, derandomize=True)
@given(st.sampled_from(range(len(BASE["certificate"]["constraints"]))), st.floats(2.0, 1e308))
def test_no_margin_may_grow(k, by):
    document = copy.deepcopy(BASE)
    document["certificate"]["constraints"][k]["margin"] += by * 100
    document["certificate"]["worst"] = None
    assert answered(document) != "certified"


def nested(depth):
    found = []
    for _ in range(depth):
        found = [found]
    return found


@pytest.mark.parametrize("value", [10**5000, [10**5000] * 3, nested(100_000)], ids=["long", "longs", "deep"])
@pytest.mark.parametrize("name", ["clearance", "goal", "points", "camera", "obstacles", "occlusion"])
def test_what_cannot_be_shown_is_answered(name, value):
    document = copy.deepcopy(BASE)
    document["problem"][name] = value
    assert answered(document) == "refuted"
