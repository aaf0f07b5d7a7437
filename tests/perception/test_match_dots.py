"""Matching two views without being told which dot is which."""

import importlib.util
from itertools import combinations
from pathlib import Path

import dot_scenes
import numpy as np
import pytest
from dot_scenes import Scene, dot_patches, render
from scipy.spatial.transform import Rotation

from omniservo.errors import InputError
from omniservo.perception import FoundDots, find_dots, match_dots
from omniservo.perception.match_dots import _exchanges

CAMERA = dot_scenes.paper_camera()


@pytest.fixture(scope="module")
def protocol():
    """The protocol behind the stated figures, benchmarks/perception_accuracy.py."""
    path = Path(__file__).resolve().parents[2] / "benchmarks" / "perception_accuracy.py"
    if not path.is_file():
        pytest.skip("benchmarks/ is not part of this copy")
    spec = importlib.util.spec_from_file_location("perception_accuracy", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


# 3×3 dots on two boards that meet at a ridge, off the boards by 4 mm; the signs have no symmetry
SIGNS = np.array([1, -1, -1, -1, 1, -1, 1, 1, -1])


def ridge(signs=SIGNS):
    i, k = (g.ravel().astype(float) for g in np.meshgrid([-1, 0, 1], [-1, 0, 1]))
    centres = np.stack([0.06 * i, 0.055 * k, -0.04 * np.abs(i) + 0.004 * signs], 1)
    normals = np.stack([-0.04 * i, 0 * i, np.where(i, -0.06, -1.0)], 1)
    return centres, normals / np.linalg.norm(normals, axis=1, keepdims=True)


def seen(camera, roll=0.0, tilt=(0.0, 0.0), at=(0.0, 0.0, 0.36), signs=SIGNS, radius=0.009):
    """Dots of a view as exactly as they can be seen: outlines projected, no noise; in the layout's order."""
    turn = Rotation.from_rotvec([*np.deg2rad(tilt), 0]) * Rotation.from_euler("z", roll, degrees=True)
    centres, normals = ridge(signs)
    centres, normals = turn.apply(centres) + at, turn.apply(normals)
    pixels, areas, shapes = camera.project(centres)[0], [], []
    for patch in dot_patches(centres, normals, radius)[1::2]:
        outline = camera.project(patch.outline(48))[0]
        areas.append(dot_scenes.image_area(camera, patch))
        shapes.append(0.5 * np.cov(outline.T, bias=True))
    return FoundDots(pixels, np.array(areas), np.array(shapes))


def picked(dots, index):
    return FoundDots(dots.pixels[index], dots.area_px[index], dots.covariance[index])


def own(n):
    return np.stack([np.arange(n), np.arange(n)], 1)


@pytest.mark.parametrize("roll", [0.0, 45.0, 90.0, 135.0, 180.0, -100.0])
def test_views_rolled_by_any_angle_are_matched(roll):
    match = match_dots(CAMERA, seen(CAMERA), seen(CAMERA, roll, (15.0, -20.0), (0.05, 0.03, 0.4)))
    assert match.status == "ok"
    assert np.array_equal(match.pairs, own(9))
    assert match.residual_px < 0.02


def test_order_of_the_dots_does_not_matter():
    order = np.random.default_rng(0).permutation(9)
    match = match_dots(CAMERA, seen(CAMERA), picked(seen(CAMERA, 170.0, (10.0, 20.0)), order))
    assert match.status == "ok"
    assert np.array_equal(order[match.pairs[:, 1]], match.pairs[:, 0])


@pytest.mark.parametrize(
    "signs", [np.ones(9), np.array([-1, 1, -1, 1, -1, 1, -1, 1, -1])], ids=["even", "checkered"]
)
def test_a_symmetric_layout_is_refused(signs):
    match = match_dots(CAMERA, seen(CAMERA, signs=signs), seen(CAMERA, 20.0, (10.0, -20.0), signs=signs))
    assert match.status == "ambiguous"
    assert len(match.pairs) == 0


@pytest.mark.parametrize("change", [{"fx": -296.9365}, {"fy": -298.4197}, {"xi": 0.9}, {"xi": 0.0}])
def test_mirrored_and_other_cameras_are_matched(change):
    camera = dot_scenes.paper_camera(max_angle=None, **change)
    match = match_dots(camera, seen(camera), seen(camera, 150.0, (15.0, 15.0), (0.03, 0.0, 0.4)))
    assert match.status == "ok"
    assert np.array_equal(match.pairs, own(9))


def test_a_reflected_picture_is_not_matched():
    view = seen(CAMERA, 30.0, (15.0, -20.0))
    flip = np.diag([-1.0, 1.0])
    pixels = view.pixels * [-1, 1] + [2 * 316.8076, 0]
    mirrored = FoundDots(pixels, view.area_px, flip @ view.covariance @ flip)
    assert match_dots(CAMERA, seen(CAMERA), mirrored).status != "ok"


def test_the_same_picture_matches_itself():
    match = match_dots(CAMERA, seen(CAMERA), seen(CAMERA))
    assert match.status == "ok"
    assert np.array_equal(match.pairs, own(9))


def test_pure_rotation_is_matched():
    turn = Rotation.from_rotvec([0.2, -0.3, 2.0])
    first = seen(CAMERA, at=(0.0, 0.0, 0.35))
    rays, _ = CAMERA.unproject(first.pixels)
    second = CAMERA.project(turn.apply(rays))[0]
    rims = []
    for pixel, shape in zip(first.pixels, first.covariance, strict=True):
        angle = np.linspace(0, 2 * np.pi, 48, endpoint=False)
        rim = pixel + 2 * np.stack([np.cos(angle), np.sin(angle)], 1) @ np.linalg.cholesky(shape).T
        turned = CAMERA.project(turn.apply(CAMERA.unproject(rim)[0]))[0]
        rims.append(0.5 * np.cov(turned.T, bias=True))
    match = match_dots(CAMERA, first, FoundDots(second, first.area_px, np.array(rims)))
    assert match.status == "ok"
    assert np.array_equal(match.pairs, own(9))


@pytest.mark.parametrize("hidden", range(9))
def test_a_dot_hidden_in_one_view_stays_unmatched(hidden):
    left = np.delete(np.arange(9), hidden)
    match = match_dots(CAMERA, seen(CAMERA), picked(seen(CAMERA, 100.0, (15.0, -20.0)), left))
    assert match.status in ("ok", "ambiguous")
    if match.status == "ok":
        assert np.array_equal(left[match.pairs[:, 1]], match.pairs[:, 0])
        assert hidden not in match.pairs[:, 0]


def test_a_false_dot_stays_unmatched():
    view = seen(CAMERA, 100.0, (15.0, -20.0))
    false = FoundDots(
        np.vstack([view.pixels, [[420.0, 330.0]]]),
        np.append(view.area_px, 30.0),
        np.concatenate([view.covariance, 2.4 * np.eye(2)[None]]),
    )
    match = match_dots(CAMERA, seen(CAMERA), false)
    assert match.status == "ok"
    assert np.array_equal(match.pairs, own(9))


def test_another_target_is_no_match():
    other = seen(CAMERA, 30.0)
    moved = FoundDots(other.pixels[[4, 0, 1, 2, 3, 5, 6, 7, 8]], other.area_px, other.covariance)
    shuffled = FoundDots(
        moved.pixels + np.random.default_rng(1).normal(0, 9, (9, 2)), moved.area_px, moved.covariance
    )
    match = match_dots(CAMERA, seen(CAMERA), shuffled)
    assert match.status == "no_match"
    assert len(match.pairs) == 0


@pytest.mark.parametrize("count", [0, 1, 7])
def test_fewer_than_eight_dots_are_too_few(count):
    match = match_dots(CAMERA, picked(seen(CAMERA), np.arange(count)), seen(CAMERA, 30.0))
    assert match.status == "too_few"
    assert str(count) in match.reason


@pytest.mark.parametrize("turn", [[0.2, -0.3, 1.0], [0.1, 0.3, 3.0]])
def test_evenly_spaced_dots_on_one_line_are_refused(turn):
    places = np.stack([0.02 * np.arange(-4.0, 5.0), np.zeros(9), np.zeros(9)], 1)
    views = []
    for rotation in (Rotation.identity(), Rotation.from_rotvec(turn)):
        where = rotation.apply(places) + np.array([0.0, 0.0, 0.35])
        faces = np.tile(rotation.apply([0.0, 0.0, -1.0]), (9, 1))
        outlines = [CAMERA.project(p.outline(48))[0] for p in dot_patches(where, faces, 0.009)[1::2]]
        shapes = np.array([0.5 * np.cov(outline.T, bias=True) for outline in outlines])
        views.append(FoundDots(CAMERA.project(where)[0], np.full(9, 30.0), shapes))
    assert match_dots(CAMERA, *views).status in ("no_match", "ambiguous")


def test_rendered_pictures_are_matched():
    centres, normals = ridge()
    pictures = []
    for roll, tilt, at in [(0, (0, 0), (0.02, 0, 0.34)), (140, (12, -18), (-0.02, 0.03, 0.4))]:
        turn = Rotation.from_rotvec([*np.deg2rad(tilt), 0]) * Rotation.from_euler("z", roll, degrees=True)
        where = turn.apply(centres) + at
        scene = Scene(dot_patches(where, turn.apply(normals), 0.009, board=2.5), background=170.0)
        pictures.append((find_dots(render(CAMERA, scene, blur=0.4), CAMERA), CAMERA.project(where)[0]))
    names = [np.linalg.norm(d.pixels[:, None] - true, axis=2).argmin(1) for d, true in pictures]
    match = match_dots(CAMERA, pictures[0][0], pictures[1][0])
    assert match.status == "ok"
    assert np.array_equal(names[0][match.pairs[:, 0]], names[1][match.pairs[:, 1]])


def test_drawn_layouts_are_never_matched_wrongly(protocol):
    figures = protocol.matching(count=60, seed=11)
    assert figures["wrong"] == 0
    assert figures["refused"] <= 3


@pytest.mark.slow
def test_drawn_dots_are_all_found_and_no_other(protocol):
    figures = protocol.dot_centres(count=12, seed=12)
    assert figures["lost_of_12_px_or_more"] == 0
    assert figures["false_dots"] == 0
    assert figures["error_max_px"] < 0.2


def test_wrong_calls_are_refused():
    view = seen(CAMERA)
    with pytest.raises(InputError, match="noise_px"):
        match_dots(CAMERA, view, view, noise_px=0)
    broken = FoundDots(np.full((9, 2), np.nan), view.area_px, view.covariance)
    with pytest.raises(InputError, match="dots_b.pixels"):
        match_dots(CAMERA, view, broken)


def test_all_exchanges_of_two_partners_are_tried_a_dot_at_a_time():
    partner = np.array([3, -1, 0, 2, 5])
    blocks = [rows for rows, _ in _exchanges(partner, np.zeros(12))]
    known = [0, 2, 3, 4]
    expected = []
    for a, b in combinations(known, 2):
        row = partner.copy()
        row[[a, b]] = row[[b, a]]
        expected.append(row)
    np.testing.assert_array_equal(np.concatenate(blocks), expected)
    first, motions = next(_exchanges(np.arange(1000), np.zeros(12)))
    assert first.nbytes + motions.nbytes < 10e6  # of a thousand dots all at once have 4 GB
