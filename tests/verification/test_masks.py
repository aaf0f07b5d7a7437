"""Masks: target points stay out of convex polygons of the image."""

import numpy as np
import pytest
from sampled_plans import camera, path, plan, problem, slack, true_margins

from omniservo.cameras import UnifiedCamera
from omniservo.verification import verify_plan

SQUARE = [[300.0, 100.0], [340.0, 100.0], [340.0, 140.0], [300.0, 140.0]]
NAMES = ("perspective with skew", "hyper-catadioptric", "fisheye", "strong fisheye")


def random_polygon(rng, center):
    """Strictly convex: corners on an ellipse, either way round."""
    angles = np.sort(rng.uniform(0, 2 * np.pi, rng.integers(3, 9)))
    if np.diff(angles, append=angles[0] + 2 * np.pi).min() < 0.1:
        return random_polygon(rng, center)
    corners = center + rng.uniform(8, 60, 2) * np.column_stack([np.cos(angles), np.sin(angles)])
    return (corners[:: int(rng.choice([-1, 1]))]).tolist()


@pytest.mark.parametrize("name", NAMES)
def test_random_masks_are_judged_as_sampling_judges_them(name):
    rng = np.random.default_rng(NAMES.index(name))
    seen = {"certified": 0, "refuted": 0}
    for _ in range(25):
        lens = camera(name) | {"dead_zone": None}
        lens["mask"] = [random_polygon(rng, rng.uniform([0, 0], [640, 480])) for _ in range(2)]
        asked = problem(
            camera=lens,
            points=rng.uniform([-0.15, -0.2, 0.6], [0.15, 0.1, 0.8], (3, 3)).tolist(),
            obstacles=[],
            visibility_margin=float(rng.choice([0.0, 3.0])),
        )
        way = path(asked, rng.normal(size=3) * 0.1, rng.normal(size=4) * 0.1)
        truth = true_margins(asked, way, 4001)
        masks = [truth[f"visibility mask {i}"][0] for i in (0, 1)]
        # Where the edge changes, the least lies between samples at a kink.
        margins = {n: m - (0.5 if "mask" in n else 1.0) for n, (m, _, _) in truth.items()}
        if min(m for n, (m, _, _) in truth.items() if "mask" not in n) < 0 or abs(min(masks)) < 0.5:
            continue
        if min(masks) < 0:
            margins = {n: min(m, 0.0) if "mask" not in n else 0.0 for n, m in margins.items()}
        answer = verify_plan(plan(asked, way, margins))
        seen[answer.status] += 1
        assert answer.status == ("certified" if min(masks) > 0 else "refuted"), answer.reasons
        if answer.status == "certified":
            margins["visibility mask 1"] = masks[1] * (1 + 1e-9)
            assert verify_plan(plan(asked, way, margins)).status == "refuted"
    assert seen["certified"] >= 3, seen


def test_the_edge_that_a_point_is_beyond_may_change_along_the_path():
    lens = camera("perspective") | {"skew": 0.0}
    # The point goes from left of the square over its top to its right; no one edge separates it.
    asked = problem(camera=lens, points=[[0.0, 0.0, 1.0]], obstacles=[], visibility_margin=2.0)
    asked["goal"] = {"translation": [-0.3, 0.0, 0.0], "quaternion": [0.0, 0.0, 0.0, 1.0]}
    way = path(asked, (0.0, 0.1, 0.0))
    u, v = lens["cx"] + 63.0, lens["cy"]
    lens["mask"] = [[[u - 20, v - 10], [u + 20, v - 10], [u + 20, v + 30], [u - 20, v + 30]]]
    truth = true_margins(asked, way)
    margin = truth["visibility mask 0"][0]
    assert 1 < margin < 40
    margins = {n: m - slack(m) for n, (m, _, _) in truth.items()} | {"visibility mask 0": margin - 0.1}
    assert verify_plan(plan(asked, way, margins)).status == "certified"
    margins["visibility mask 0"] = margin + 1e-6
    assert verify_plan(plan(asked, way, margins)).status == "refuted"
    way = path(asked)
    assert true_margins(asked, way)["visibility mask 0"][0] < 0
    margins["visibility mask 0"] = 0.0
    answer = verify_plan(plan(asked, way, margins))
    assert any(reason.startswith("visibility mask 0") for reason in answer.reasons)


@pytest.mark.parametrize(
    "mask",
    [
        7,
        [SQUARE[:2]],
        [[[0, 0], [2, 0], [2, 2], [1, 0.5], [0, 2]]],
        [[[0, 0], [1, 0], [2, 0], [2, 2]]],
        [[[0, 0], [0, 0], [2, 0], [2, 2]]],
        [[[10, 0], [-8, 6], [3, -9], [3, 9], [-8, -6]]],
        [[*SQUARE, *SQUARE]],
        [[[0, 0], [1, 0], [1, float("nan")]]],
        [[[0, 0], [1, 0], [1]]],
        [SQUARE] * 65,
        [[[np.cos(a), np.sin(a)] for a in np.linspace(0, 6, 65)]],
    ],
)
def test_a_mask_that_is_no_strictly_convex_polygon_is_refuted(mask):
    asked = problem()
    way = path(asked, (0.06, 0.0, 0.0))
    document = plan(asked, way, dict.fromkeys(true_margins(asked, way, 50), 0.0))
    asked["camera"]["mask"] = mask
    answer = verify_plan(document)
    assert answer.status == "refuted"
    assert "problem.camera.mask" in answer.reasons[0]


def test_masks_of_a_distorted_camera_are_judged_as_sampling_judges_them():
    rng = np.random.default_rng(5)
    seen = {"certified": 0, "refuted": 0}
    fields = camera("hyper-catadioptric") | {"skew": 0.0, "dead_zone": None, "max_angle": None}
    lens = UnifiedCamera.from_dict(fields | {"distortion": [-0.08, 0.02, 1e-3, -5e-4]})
    polygon = lens.image_limits(2.0).polygon.tolist()
    for k in range(14):
        points = rng.uniform([-0.1, -0.1, 0.6], [0.1, 0.1, 0.8], (2, 3))
        near = lens.project(points[0])[0] + rng.normal(size=2) * (20.0 if k % 2 else 80.0)
        masked = lens.to_dict() | {"mask": [random_polygon(rng, near)]}
        asked = problem(camera=masked, points=points.tolist(), obstacles=[], visibility_margin=2.0)
        way = path(asked, rng.normal(size=3) * 0.05, rng.normal(size=4) * 0.05)
        truth = true_margins(asked, way, 4001)
        margin = truth["visibility mask 0"][0]
        if abs(margin) < 0.5:
            continue
        margins = {n: m - slack(m) for n, (m, _, _) in truth.items() if "mask" not in n}
        margins |= {"visibility polygon": 0.0, "visibility mask 0": max(0.0, margin - 0.5)}
        document = plan(asked, way, margins)
        document["certificate"]["polygon"] = polygon
        answer = verify_plan(document)
        assert answer.status == ("certified" if margin > 0 else "refuted"), answer.reasons
        seen[answer.status] += 1
        if margin > 0:
            overstated = plan(asked, way, margins | {"visibility mask 0": margin * (1 + 1e-9)})
            overstated["certificate"]["polygon"] = polygon
            assert verify_plan(overstated).status == "refuted"
    assert min(seen.values()) >= 2, seen
