"""The polygon of a distorted camera is proven again; a dead zone under distortion is judged exactly."""

import copy
from fractions import Fraction

import numpy as np
import pytest
from sampled_plans import FE185, path, plan, problem, slack, true_margins
from scipy.spatial import ConvexHull

from omniservo.verification import verify_plan
from omniservo.verification.distorted_region import region
from omniservo.verification.fields import Fields
from omniservo.verification.image_limits import least_stretch
from omniservo.verification.plan_file import _camera

DISTORTIONS = [(-0.08, 0.02, 1e-3, -5e-4), (0.05, 0.4, -8e-4, 2e-3), (-0.3, 0.06, 0.0, 0.0)]
INSET = 1.0


def lens(distortion, **changes):
    return {**copy.deepcopy(FE185), "max_angle": None, "distortion": list(distortion), **changes}


def distort(camera, m):
    """Pixels of points of the normalised plane."""
    k1, k2, p1, p2 = camera["distortion"]
    x, y = m[..., 0], m[..., 1]
    s = x * x + y * y
    radial = 1 + k1 * s + k2 * s * s
    x, y = (
        x * radial + 2 * p1 * x * y + p2 * (s + 2 * x * x),
        y * radial + p1 * (s + 2 * y * y) + 2 * p2 * x * y,
    )
    return np.stack(
        [camera["fx"] * x + camera["skew"] * y + camera["cx"], camera["fy"] * y + camera["cy"]], -1
    )


def largest_radius(camera, angle, inset):
    """How far the image reaches along one direction of the plane, by dense samples."""
    r = np.linspace(0, 3, 30_001)
    k1, k2, _, _ = camera["distortion"]
    s = r * r
    u, v = distort(camera, r[:, None] * np.array([np.cos(angle), np.sin(angle)])).T
    inside = (u >= inset - 0.5) & (u <= camera["width"] - 0.5 - inset)
    inside &= (v >= inset - 0.5) & (v <= camera["height"] - 0.5 - inset)
    inside &= np.minimum(1 + k1 * s + k2 * s * s, 1 + 3 * k1 * s + 5 * k2 * s * s) > 0.02
    inside &= s * (camera["xi"] ** 2 - 1) < 0.98
    return r[np.argmin(inside) - 1]


def inner_polygon(camera, share, inset=INSET, corners=40):
    """A convex polygon at a share of the way to the image's limits."""
    angles = np.linspace(0, 2 * np.pi, corners, endpoint=False)
    reach = np.array([largest_radius(camera, a, inset) for a in angles])
    rays = np.column_stack([np.cos(angles), np.sin(angles)])
    out = share * reach[:, None] * rays
    return out[ConvexHull(out).vertices]


def judged(camera, polygon, inset=INSET):
    exact = tuple(tuple(Fraction(float(x)) for x in vertex) for vertex in polygon)
    return region(_camera(Fields({"camera": camera}, "problem")), exact, Fraction(inset))


def distorted_plan(camera, polygon, **changes):
    asked = problem(camera=camera, obstacles=[], **changes)
    way = path(asked, (0.03, 0.0, 0.0), (0.01, 0.02, 0.0, 0.01))
    margins = {name: m - slack(m) for name, (m, _, _) in true_margins(asked, way).items()}
    document = plan(asked, way, {**margins, "visibility polygon": INSET})
    document["certificate"]["polygon"] = polygon.tolist()
    return document


@pytest.mark.parametrize("distortion", DISTORTIONS)
def test_polygon_inside_the_image_is_proven_in_either_orientation(distortion):
    camera = lens(distortion)
    polygon = inner_polygon(camera, 0.7)
    assert judged(camera, polygon).verdict == "holds"
    assert judged(camera, polygon[::-1]).verdict == "holds"
    assert verify_plan(distorted_plan(camera, polygon)).status == "certified"


@pytest.mark.parametrize("distortion", DISTORTIONS)
def test_one_vertex_outside_the_image_is_refuted(distortion):
    camera = lens(distortion)
    angles = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    reach = np.array([largest_radius(camera, a, INSET) for a in angles])
    for k in (0, 7, 18, 31):
        factor = np.full(40, 0.65)
        factor[k] = 1.02
        out = (factor * reach)[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
        polygon = out[ConvexHull(out).vertices]
        assert judged(camera, polygon).verdict == "violated"
        answer = verify_plan(distorted_plan(camera, polygon))
        assert answer.status == "refuted"
        assert any("polygon" in reason for reason in answer.reasons)


def test_side_that_bulges_out_between_two_inner_vertices_is_refuted():
    # Pincushion: the image's preimage curves inward between its corners.
    camera = lens((0.6, 0.0, 0.0, 0.0), width=601, height=601, cx=300.0, cy=300.0, fx=300.0, fy=300.0, xi=0.5)
    corner = 0.995 * largest_radius(camera, np.pi / 4, INSET) / np.sqrt(2)
    square = corner * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
    assert all(0 < x < 600 for x in distort(camera, square).ravel())
    middle = distort(camera, np.array([[corner, 0.0]]))[0, 0]
    assert (middle > 600) == (judged(camera, square).verdict == "violated")


def test_polygon_that_is_not_convex_is_refuted():
    camera = lens(DISTORTIONS[0])
    polygon = inner_polygon(camera, 0.8)
    dented = polygon.copy()
    dented[3] *= 0.7
    star = polygon[[(7 * k) % len(polygon) for k in range(len(polygon))]]
    for bad in (dented, star, polygon[[0, 1, 0, 1]], polygon[[2, 2, 2]]):
        assert judged(camera, bad).note == "the polygon is not convex"
        assert judged(camera, bad).verdict == "violated"


def test_polygon_beyond_the_fold_of_the_distortion_is_refuted():
    # 1 + 3k₁r² = 0 at r = 0.577: the pixels of a larger circle lie inside the image again.
    camera = lens((-1.0, 0.0, 0.0, 0.0), xi=1.0)
    for radius, verdict in ((0.57, "holds"), (0.6, "violated")):
        angles = np.linspace(0, 2 * np.pi, 12, endpoint=False)
        polygon = radius * np.column_stack([np.cos(angles), np.sin(angles)])
        inside = distort(camera, polygon)
        assert (inside > 0).all()
        assert judged(camera, polygon).verdict == verdict


def octagon(radius, center=(0.0, 0.0)):
    angles = np.linspace(0, 2 * np.pi, 8, endpoint=False)
    return np.array(center) + radius * np.column_stack([np.cos(angles), np.sin(angles)])


def test_distortion_that_folds_and_unfolds_again_before_the_corners_is_refuted():
    # The radial slope 1 - 2.1r² + r⁴ is 1 on the axis, -0.1 at r = 1 and 0.73 at the corners, r = 1.4.
    camera = lens((-0.7, 0.2, 0.0, 0.0), xi=1.0)
    corners = octagon(1.4)
    answer = judged(camera, corners)
    assert (answer.verdict, answer.note) == ("violated", "the distortion is not one-to-one on the polygon")
    assert (distort(camera, corners) > 0).all()
    assert judged(camera, octagon(0.8)).verdict == "holds"


def test_polygon_beside_the_principal_axis_is_judged_by_what_lies_between():
    wide = {"width": 2000, "height": 2000, "cx": 200.0, "cy": 1000.0, "xi": 1.0}
    mild = lens((-0.02, 0.001, 0.0, 0.0), **wide)
    beside = octagon(0.5, (1.2, 0.1))
    assert judged(mild, beside).verdict == "holds"
    assert judged(mild, beside[::-1]).verdict == "holds"
    assert judged({**mild, "width": 600}, beside).note.endswith("crosses the right edge")
    # With a fold at r = 1 between it and the axis this lens does not show a polygon, though it unfolds again.
    folding = lens((-0.7, 0.2, 0.0, 0.0), **wide)
    far = octagon(0.06, (1.33, 0.0))
    assert (distort(folding, far) > 0).all()
    assert judged(folding, far).note == "the distortion is not one-to-one on the polygon"
    # and a corner that a circle of max_angle cuts off is told from the axis, wherever the polygon lies
    narrow = {**mild, "max_angle": 1.9}
    assert "max_angle" in judged(narrow, beside).note


def test_polygon_beyond_the_domain_or_the_largest_angle_is_refuted():
    square = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) / np.sqrt(2)
    wide = lens((-0.01, 0.0, 0.0, 0.0), width=5000, height=5000, cx=2500.0, cy=2500.0)
    rim = 1 / np.sqrt(wide["xi"] ** 2 - 1)
    assert judged(wide, square * rim * 0.999).verdict == "holds"
    assert "domain" in judged(wide, square * rim * 1.001).note
    narrow = {**wide, "max_angle": 1.0}
    circle = np.sin(1.0) / (np.cos(1.0) + wide["xi"])
    assert judged(narrow, square * circle * 0.9999, 0.0).verdict == "holds"
    assert "max_angle" in judged(narrow, square * circle * 1.0001, 0.0).note
    # On the axis of least stretch the true distance in pixels is what is proven.
    for inset in (2.0, 10.0):
        radii = np.linspace(0, circle, 20_001)
        pixels = wide["fx"] * (radii - 0.01 * radii**3)
        fits = radii[np.searchsorted(pixels, pixels[-1] - inset)]
        assert judged(narrow, square * fits * 0.9999, inset).verdict == "holds"
        assert judged(narrow, square * fits * 1.0005, inset).verdict == "violated"


RINGS = [
    (-0.14, 0.03, 0, 0),
    (0.1, 0.05, 0, 0),
    (-0.1, 0.1, 0, 0),
    (0.1, -0.1, 0, 0),
    (-0.05, 0.02, 0.01, -0.02),
    (-0.1, 0.1, 0.01, -0.02),
]


@pytest.mark.parametrize("distortion", RINGS)
def test_pixels_to_the_circle_of_the_largest_angle_are_told_within_a_thousandth(distortion):
    camera = lens(distortion, width=5000, height=5000, cx=2500.0, cy=2500.0, xi=1.0, max_angle=1.5)
    circle = np.sin(1.5) / (np.cos(1.5) + 1.0)
    k1, k2, p1, p2 = distortion
    radii = np.linspace(0, circle, 20_001)
    s = radii**2
    slope = np.minimum(1 + k1 * s + k2 * s**2, 1 + 3 * k1 * s + 5 * k2 * s**2) - 6 * np.hypot(p1, p2) * radii
    assert slope.min() > 0.1
    way = np.concatenate([[0], np.cumsum((slope[1:] + slope[:-1]) / 2) * (radii[1] - radii[0])])
    least = min(camera["fx"], camera["fy"])
    square = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) / np.sqrt(2)
    for radius in (0.2, 0.5, 0.8):
        pixels = least * (way[-1] - np.interp(radius, radii, way))
        assert judged(camera, square * radius, pixels * 0.999).verdict == "holds"
        assert judged(camera, square * radius, pixels * 1.0001).verdict == "violated"


def test_the_least_singular_value_of_k_is_enclosed():
    for fx, skew, fy in ((300.0, 0.0, 310.0), (300.0, 200.0, 310.0), (-300.0, 5e-3, 299.0), (1e-5, 1e3, 2.0)):
        camera = _camera(Fields({"camera": lens((0, 0, 0, 0), fx=fx, fy=fy, skew=skew)}, "problem"))
        below, above = least_stretch(camera)
        assert below <= above
        determinant, trace = Fraction(fx) * Fraction(fy), sum(Fraction(x) ** 2 for x in (fx, skew, fy))
        for bound, sign in ((below, 1), (above, -1)):  # x is below both roots of x² - trace x + determinant²
            x = bound**2
            assert sign * (x * x - trace * x + determinant**2) >= 0
        assert above - below <= Fraction(1, 10**9) * above


def test_the_one_side_that_bulges_out_of_the_image_is_found_wherever_the_list_begins():
    camera = lens((-0.1, 0, 0, 0), width=601, height=2001, cx=300.0, cy=1000.0, fx=300.0, fy=300.0, xi=1.0)
    sides = np.array([[1.17, -0.6], [1.17, 0.6], [-0.5, 0.6], [-0.5, -0.6]])
    assert (distort(camera, sides)[:, 0] < 600).all()
    assert judged(camera, sides * [0.97, 1.0], 0).verdict == "holds"
    for first in range(4):
        for polygon in (np.roll(sides, first, axis=0), np.roll(sides, first, axis=0)[::-1]):
            assert judged(camera, polygon, 0).note.endswith("crosses the right edge")


@pytest.mark.parametrize("tangential", [(0.2, 0.0), (-0.2, 0.0), (0.0, 0.2), (0.0, -0.2), (0.14, 0.14)])
def test_a_fold_on_one_side_of_the_axis_is_found(tangential):
    # Along (p2, p1) the slope is 1 + 6 |p| r: it is 0 at r = 0.83 on one side only.
    camera = lens((0, 0, *tangential), width=4000, height=4000, cx=2000.0, cy=2000.0, xi=0.5)
    assert judged(camera, octagon(0.75)).verdict == "holds"
    assert judged(camera, octagon(0.9)).note == "the distortion is not one-to-one on the polygon"


def test_polygon_beyond_the_circle_of_the_largest_angle_is_named():
    camera = lens((0.0, 0.0, 0.2, 0.0), width=4000, height=4000, cx=2000.0, cy=2000.0, xi=0.5, max_angle=1.0)
    radius = np.sin(1.0) / (np.cos(1.0) + 0.5)
    assert judged(camera, octagon(0.99 * radius), 0).verdict == "holds"
    assert judged(camera, octagon(1.01 * radius), 0).note == "the polygon leaves the circle of max_angle"


def test_point_outside_the_polygon_is_refuted():
    camera = lens(DISTORTIONS[0])
    answer = verify_plan(distorted_plan(camera, inner_polygon(camera, 0.25)))
    assert answer.status == "refuted"
    assert any(reason.startswith("visibility polygon (point") for reason in answer.reasons)
    # The points are inside the image's edges: that many px are left there is not what was violated.
    assert all("violated at w = " in r and " left" not in r for r in answer.reasons if "polygon" in r)


def test_overstated_margin_of_the_polygon_is_refuted():
    camera = lens(DISTORTIONS[0])
    document = distorted_plan(camera, inner_polygon(camera, 0.7))
    line = next(x for x in document["certificate"]["constraints"] if x["name"] == "visibility polygon")
    line["margin"] = 120.0
    assert verify_plan(document).status == "refuted"


def test_missing_polygon_is_refuted_and_never_certified():
    camera = lens(DISTORTIONS[0])
    document = distorted_plan(camera, inner_polygon(camera, 0.7))
    del document["certificate"]["polygon"]
    assert verify_plan(document).status == "refuted"
    document.update(certificate=None, status="undecided")
    assert verify_plan(document).status == "undecided"


def test_dead_zone_under_distortion_is_judged_in_true_pixels():
    camera = lens(DISTORTIONS[0], dead_zone={"center": [330.0, 390.0], "radius": 20.0})
    document = distorted_plan(
        camera,
        inner_polygon(camera, 0.7),
        points=[[0.02, -0.01, 0.4], [-0.03, 0.05, 0.5]],
        visibility_margin=0.5,
    )
    assert verify_plan(document).status == "certified"
    line = next(x for x in document["certificate"]["constraints"] if x["name"] == "dead_zone")
    truth = true_margins(document["problem"], document["path"])["dead_zone"][0]
    line["margin"] = truth + 1e-9 * truth
    assert verify_plan(document).status == "refuted"


def test_infeasible_distorted_view_is_confirmed_by_exact_edges():
    camera = lens(DISTORTIONS[0])
    asked = problem(camera=camera, obstacles=[], points=[[0.0, 0.0, 0.5], [0.0, 1.2, 0.5]])
    document = {"format": "omniservo.plan/1", "problem": asked, "status": "infeasible", "path": None}
    answer = verify_plan(document)
    assert "visibility bottom edge (point 1)" in answer.reasons[0]
    asked["points"] = [[0.0, 0.0, 0.5]]
    assert verify_plan(document).status == "undecided"
