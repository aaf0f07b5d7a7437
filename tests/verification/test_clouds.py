"""Point clouds: most points are excluded many at once, and none wrongly."""

import numpy as np
import pytest
from sampled_plans import path, plan, problem, slack, true_margins

from omniservo.verification import cloud as cloud_module
from omniservo.verification import verify_plan

DETOUR = (0.06, 0.0, 0.0)


def free_cloud(count, seed, radius=0.004, gap=2e-3):
    """A problem and a path that pass a random cloud everywhere, with lines of sight, by a little."""
    rng = np.random.default_rng(seed)
    asked = problem(obstacles=[], clearance=0.02, occlusion=True)
    way = path(asked, DETOUR)
    w = np.linspace(0, 1, 41)
    t = np.array([np.polyval(row, w) for row in way["translation"]]).T
    points = np.empty((0, 3))
    while len(points) < count:
        found = rng.normal(size=(count, 3)) * 0.3
        keep = np.linalg.norm(found[:, None] - t, axis=-1).min(axis=1) > radius + 0.02 + gap
        for h in np.array(asked["points"]):
            along, start = h - t, found[:, None] - t
            share = np.clip((start * along).sum(-1) / (along**2).sum(-1), 0, 1)
            keep &= np.linalg.norm(start - share[..., None] * along, axis=-1).min(axis=1) > radius + gap
        points = np.vstack([points, found[keep]])
    asked["obstacles"] = [{"type": "cloud", "points": points[:count].tolist(), "radius": radius}]
    return asked, way


@pytest.fixture(scope="module")
def large():
    asked, way = free_cloud(3000, 1)
    truth = true_margins(asked, way, 401)
    margins = {name: m - (1e-4 if "obstacle" in name else slack(m)) for name, (m, _, _) in truth.items()}
    document = plan(asked, way, margins)
    answer = verify_plan(document)
    assert answer.status == "certified", answer.reasons
    return document, truth


@pytest.mark.parametrize("name", ["clearance obstacle 0", "occlusion obstacle 0"])
def test_one_point_among_thousands_decides(large, name):
    document, truth = large
    lines = [dict(line) for line in document["certificate"]["constraints"]]
    line = next(line for line in lines if line["name"] == name)
    line["margin"] = truth[name][0] + 1e-5
    answer = verify_plan({**document, "certificate": {"constraints": lines}})
    assert answer.status == "refuted"
    assert [j.name.split(" (")[0] for j in answer.constraints if j.verdict == "violated"] == [name]


def test_a_point_moved_into_the_path_between_samples_is_found(large):
    document, _ = large
    w = 0.437
    center = [float(np.polyval(row, w)) for row in document["path"]["translation"]]
    for away, status in ((0.0240001, "certified"), (0.0239999, "refuted")):
        # Beside the path, square to it and to the other points' side.
        tangent = np.array([np.polyval(np.polyder(row), w) for row in document["path"]["translation"]])
        side = np.cross(tangent, [0.3, -1.0, 0.2])
        point = (np.array(center) + away * side / np.linalg.norm(side)).tolist()
        asked = {**document["problem"], "occlusion": False}
        asked["obstacles"] = [{**asked["obstacles"][0], "points": [*asked["obstacles"][0]["points"], point]}]
        lines = [
            {**line, "margin": 0.0}
            for line in document["certificate"]["constraints"]
            if not line["name"].startswith("occlusion")
        ]
        mine = {**asked, "obstacles": [{**asked["obstacles"][0], "points": [point]}]}
        left = true_margins(mine, document["path"])["clearance obstacle 0"][0]
        assert (left > 0) == (status == "certified")
        answer = verify_plan({**document, "problem": asked, "certificate": {"constraints": lines}})
        assert answer.status == status, answer.reasons


@pytest.mark.parametrize("share", [None, 0.05, 0.6])
def test_small_clouds_are_judged_like_as_many_spheres(share):
    asked, way = free_cloud(30, 7)
    cloud = asked["obstacles"][0]
    if share is not None:  # on a line of sight, nearer to the path or to the target
        t = np.array([np.polyval(row, 0.4) for row in way["translation"]])
        cloud["points"][11] = (t + share * (np.array(asked["points"][5]) - t)).tolist()
    balls = [{"type": "sphere", "center": p, "radius": 0.004} for p in cloud["points"]]
    apart = {**asked, "obstacles": balls}
    alike = []
    for scene in (asked, apart):
        truth = true_margins(scene, way, 801)
        margins = {name: m - 1e-5 if m > 2e-5 else 0.0 for name, (m, _, _) in truth.items()}
        answer = verify_plan(plan(scene, way, margins))
        hit = {j.name.split()[0] for j in answer.constraints if j.verdict == "violated"}
        alike.append((answer.status, hit))
    assert alike[0] == alike[1]
    assert alike[0][0] == ("certified" if share is None else "refuted")


def test_radius_0_hides_nothing_and_keeps_its_clearance():
    asked, way = free_cloud(50, 4)
    asked["obstacles"][0]["radius"] = 0.0
    truth = {name: m - 1e-4 for name, (m, _, _) in true_margins(asked, way, 401).items()}
    assert "occlusion obstacle 0" not in truth
    assert verify_plan(plan(asked, way, truth)).status == "certified"
    asked["obstacles"][0]["clearance"] = 0.3
    assert verify_plan(plan(asked, way, truth)).status == "refuted"


def test_equal_and_collinear_points_are_judged():
    asked, way = free_cloud(1, 2)
    one = asked["obstacles"][0]["points"][0]
    asked["occlusion"] = False
    for points in ([one] * 300, [[one[0] + 3.0, k / 64.0, one[2]] for k in range(300)]):
        asked["obstacles"][0]["points"] = points
        truth = true_margins(asked, way, 401)
        margins = {name: m - 1e-4 for name, (m, _, _) in truth.items()}
        assert verify_plan(plan(asked, way, margins)).status == "certified"
        margins["clearance obstacle 0"] += 2e-4
        assert verify_plan(plan(asked, way, margins)).status == "refuted"


@pytest.mark.parametrize("tiny", [1e-320, 5e-324, -1e-300])
def test_a_coordinate_next_to_0_is_judged_like_0(tiny):
    asked, way = free_cloud(30, 7)
    asked["obstacles"][0]["points"][3][1] = 0.0
    truth = {name: m - 1e-5 for name, (m, _, _) in true_margins(asked, way, 801).items()}
    asked["obstacles"][0]["points"][3][1] = tiny
    answer = verify_plan(plan(asked, way, truth))
    assert answer.status == "certified", answer.reasons
    truth["clearance obstacle 0"] += 2e-5
    reason = verify_plan(plan(asked, way, truth)).reasons[0]
    assert reason.startswith("clearance obstacle 0: ")
    assert " m left at w = " in reason


def test_more_work_than_is_taken_on_is_undecided(large, monkeypatch):
    monkeypatch.setattr(cloud_module, "MOST_TESTS", 500)
    answer = verify_plan(large[0])
    assert answer.status == "undecided"
    assert "more work" in answer.reasons[0]


@pytest.mark.parametrize(
    "change",
    [
        {"points": []},
        {"points": [[0.0, 0.0]]},
        {"points": [[0.0, 0.0, float("nan")]]},
        {"points": "scan.ply"},
        {"points": [[0.0, 0.0, 9.0]] * 100_001},
        {"radius": -1e-9},
        {"radius": None},
    ],
)
def test_a_malformed_cloud_is_refuted(large, change):
    document = large[0]
    asked = {**document["problem"], "obstacles": [{**document["problem"]["obstacles"][0], **change}]}
    answer = verify_plan({**document, "problem": asked})
    assert answer.status == "refuted"
    assert "problem.obstacles[0]" in answer.reasons[0]


def test_a_cloud_in_a_file_is_not_judged(large):
    document = large[0]
    asked = {**document["problem"], "obstacles": [{"type": "cloud", "file": "scan.npy", "radius": 0.0}]}
    assert verify_plan({**document, "problem": asked}).status == "undecided"
