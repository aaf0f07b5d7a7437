import dataclasses

import numpy as np
import pytest
from benchmarks.many_views import (
    FOCAL_SIGMA,
    coverage,
    focal_covariance,
    known_displacement,
    view_scene,
)
from numpy.testing import assert_allclose
from scipy.optimize import approx_fprime
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo import KnownDisplacements, UnifiedCamera, ViewPoints, estimate_views, preset
from omniservo.errors import InputError
from omniservo.estimation import candidate_views, further_view
from omniservo.estimation.known_displacements import DisplacementPrior
from omniservo.estimation.refinement.view_adjustment import (
    ViewProblem,
    ViewState,
    blocks_of,
    cost_of,
    extra_information,
    slopes_of,
)

CAMERA = preset("fe185")


def moved(pose, off):
    turn = pose.rotation * Rotation.from_rotvec(off[3:])
    return RigidTransform.from_components(pose.translation + off[:3], turn)


def noisy(rng, scene, sigma=0.1):
    return scene.pixels + sigma * rng.normal(size=scene.pixels.shape)


def worst(found, scene):
    poses = zip(found.initial_T_views, scene.poses, strict=True)
    return max(np.linalg.norm(pose.translation - true.translation) for pose, true in poses)


def displaced(scene, pairs, sigmas=(1e-3, 1e-3), off=None):
    moves = [scene.poses[i].inv() * scene.poses[j] for i, j in pairs]
    if off is not None:
        moves = [moved(move, o) for move, o in zip(moves, off, strict=True)]
    return KnownDisplacements(pairs, moves, np.diag(np.repeat(np.square(sigmas), 3)))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("setting", "error"),
    [
        ((4, 30, 0.1), "none"),
        ((4, 30, 0.1), "field 0.3 px"),
        ((4, 30, 0.1), "focal length 2%"),
        ((12, 60, 0.2), "field 0.3 px"),
    ],
)
def test_the_95_percent_ellipsoids_of_many_views_cover(error, setting):
    found = coverage("fe185", setting, error, 15)
    assert found["ok"] == 1.0
    assert found["motion"] >= 0.85
    assert found["size"] >= 0.8
    assert 0.7 < found["in sigma"] < 1.3


def test_a_focal_length_2_percent_off_that_is_not_stated_is_not_covered():
    rng, exact = np.random.default_rng(3), preset("perspective")
    scene = view_scene(rng, exact, 8, 60)
    off = UnifiedCamera.from_dict({**exact.to_dict(), "fx": 1.02 * exact.fx, "fy": 1.02 * exact.fy})
    pixels, length = noisy(rng, scene), float(np.linalg.norm(scene.poses[1].translation))
    stated = {"scale": length, "noise": 0.1, "robust": False}
    sure = estimate_views(off, pixels, **stated)
    right = estimate_views(off, pixels, **stated, calibration_covariance=focal_covariance(off))

    def squares(found):
        t = [p.translation - q.translation for p, q in zip(found.initial_T_views, scene.poses, strict=True)]
        return [e @ np.linalg.solve(c[:3, :3], e) for e, c in zip(t[2:], found.covariance[2:], strict=True)]

    assert np.median(squares(sure)) > 9.0  # 3 numbers: 95% lie below 7.8, half below 2.4
    assert np.median(squares(right)) < 6.0
    assert right.camera_shift[0] / exact.fx == pytest.approx(-FOCAL_SIGMA, rel=0.3)


def test_views_do_not_average_out_the_error_that_they_share():
    sizes = []
    error = {"sigma_px": 0.3, "length_px": 0.2 * CAMERA.width}
    erring = UnifiedCamera.from_dict({**CAMERA.to_dict(), "model_error": error})
    for views in (3, 20):
        scene = view_scene(np.random.default_rng(4), CAMERA, views, 60)
        length = float(np.linalg.norm(scene.poses[1].translation))
        pixels = noisy(np.random.default_rng(4), scene, 0.02)
        found = estimate_views(erring, pixels, scale=length, noise=0.02)
        sizes.append(np.sqrt(np.trace(found.covariance[2, :3, :3])))
    assert sizes[1] > 0.3 * sizes[0]


def test_derivatives_of_the_adjustment_are_those_of_finite_differences():
    rng = np.random.default_rng(5)
    scene = view_scene(rng, CAMERA, 3, 6)
    state = ViewState(
        np.stack([np.concatenate((p.rotation.as_quat(), p.translation)) for p in scene.poses]),
        scene.points + 0.01 * rng.normal(size=(6, 3)),
        np.array([0.5, -1.0]),
    )
    prior = DisplacementPrior.of(displaced(scene, [[0, 2], [2, 1]], off=0.02 * rng.normal(size=(2, 6))), 3)
    by_camera = rng.normal(size=(3, 6, 2, 2))
    weights = rng.uniform(0.5, 2.0, (3, 6))
    weights[1, 2] = 0.0
    problem = ViewProblem(CAMERA, noisy(rng, scene), weights, by_camera, prior)
    blocks = blocks_of(slopes_of(problem, state))
    extra, pull = extra_information(problem, state, None, 0.0)
    assert_allclose(extra, extra.T)

    def cost(x):
        poses = state.poses.copy()
        for view in (1, 2):
            pose = RigidTransform.from_components(poses[view, 4:], Rotation.from_quat(poses[view, :4]))
            pose = moved(pose, x[6 * view - 6 : 6 * view])
            poses[view] = np.concatenate((pose.rotation.as_quat(), pose.translation))
        points = state.points + x[14:].reshape(6, 3)
        return 0.5 * cost_of(problem, ViewState(poses, points, state.deviation + x[12:14]))

    slopes = approx_fprime(np.zeros(32), cost, 1e-7)
    found = np.concatenate((blocks.gradient + pull, blocks.pull.ravel()))
    assert_allclose(found, slopes, rtol=2e-3, atol=1e-3 * np.abs(slopes).max())


def test_known_displacements_fix_scale_and_exact_pixels_give_the_exact_answer():
    rng = np.random.default_rng(6)
    scene = view_scene(rng, CAMERA, 5, 30)
    order = [3, 0, 4, 1, 2]
    known = KnownDisplacements([[1, 3]], [scene.poses[0].inv() * scene.poses[1]], np.diag([1e-6] * 6))
    found = estimate_views(CAMERA, scene.pixels[order], scale=known)
    assert found.is_metric
    assert found.status == "ok"
    for pose, k in zip(found.initial_T_views, order, strict=True):
        true = scene.poses[3].inv() * scene.poses[k]
        assert_allclose(pose.as_matrix(), true.as_matrix(), atol=1e-5)


def test_the_scale_is_as_sure_as_the_displacement_that_gives_it():
    rng = np.random.default_rng(7)
    scene = view_scene(rng, CAMERA, 4, 40)
    length = float(np.linalg.norm(scene.poses[1].translation))
    sigmas = []
    for sigma in (1e-3, 4e-3):
        known = displaced(scene, [[0, 1]], (sigma, 0.5))
        sigmas.append(estimate_views(CAMERA, noisy(rng, scene, 0.02), scale=known, noise=0.02).size_sigma)
    assert sigmas[0] == pytest.approx(1e-3 / length, rel=0.1)
    assert sigmas[1] == pytest.approx(4e-3 / length, rel=0.1)


def test_an_error_of_the_mount_stands_in_all_displacements_of_an_arm():
    rng = np.random.default_rng(8)
    scene = view_scene(rng, CAMERA, 4, 10)
    mount = RigidTransform.from_components([0.05, 0.0, 0.1], Rotation.from_rotvec([0.1, 0.2, 0.0]))
    flanges = [pose * mount.inv() for pose in scene.poses]
    spread = np.diag([1e-3] * 3 + [1e-2] * 3) ** 2
    exact = KnownDisplacements.of_poses(flanges, mount, position_sigma=1e-4, rotation_sigma=1e-4)
    known = KnownDisplacements.of_poses(
        flanges, mount, position_sigma=1e-4, rotation_sigma=1e-4, mount_covariance=spread
    )
    assert_allclose(known.first_T_second[2].as_matrix(), scene.poses[3].as_matrix(), atol=1e-9)
    with pytest.raises(InputError, match="mount_covariance: a symmetric matrix"):
        KnownDisplacements.of_poses(
            flanges, mount, position_sigma=1e-4, rotation_sigma=1e-4, mount_covariance=-spread
        )
    shifts = []
    for _ in range(400):
        wrong = moved(mount, rng.normal(size=6) * np.sqrt(np.diag(spread)))
        off = [(flanges[0] * wrong).inv() * flange * wrong for flange in flanges[1:]]
        pairs = zip(off, known.first_T_second, strict=True)
        shifts.append(np.concatenate([a.translation - b.translation for a, b in pairs]))
    rows = np.concatenate([6 * k + np.arange(3) for k in range(3)])
    of_mount = (known.covariance - exact.covariance)[np.ix_(rows, rows)]
    assert_allclose(np.sqrt(np.diag(of_mount)), np.std(shifts, axis=0), rtol=0.15)
    unit = np.sqrt(np.outer(np.diag(of_mount), np.diag(of_mount)))
    assert_allclose(of_mount / unit, np.corrcoef(np.transpose(shifts)), atol=0.15)


def test_displacements_place_views_whose_pictures_alone_do_not():
    rng = np.random.default_rng(9)
    scene = view_scene(rng, CAMERA, 4, 30)
    visible = np.ones((4, 30), dtype=bool)
    visible[3, 3:] = False  # three points are too few for a pose
    pixels = noisy(rng, scene)
    plain = estimate_views(CAMERA, pixels, visible=visible, noise=0.1)
    assert plain.view_status == ("ok", "ok", "ok", "too_few_points")
    assert "3" in plain.view_reasons[3]
    known = displaced(scene, [[0, 1], [1, 3]])
    found = estimate_views(CAMERA, pixels, visible=visible, noise=0.1, scale=known)
    assert found.view_status[3] == "ok"
    assert worst(found, scene) < 5e-3
    visible[3] = False
    lone = estimate_views(CAMERA, pixels, visible=visible, noise=0.1, scale=known)
    assert lone.view_status[3] == "by_displacement"
    assert_allclose(np.sqrt(np.diag(lone.covariance[3])[:3]).max(), 1e-3, rtol=0.5)


def test_small_displacements_of_an_arm_that_pixels_alone_do_not_determine_are_used():
    rng = np.random.default_rng(10)
    scene = view_scene(rng, CAMERA, 3, 12)
    for k in (1, 2):  # looks: a centimetre, no turn
        scene.poses[k] = RigidTransform.from_translation(0.01 * np.eye(3)[k - 1])
        scene.pixels[k] = CAMERA.project(scene.poses[k].inv().apply(scene.points))[0]
    known = displaced(scene, [[0, 1], [0, 2]], (2e-4, 5e-4))
    found = estimate_views(CAMERA, noisy(rng, scene, 0.3), noise=0.3, scale=known)
    assert found.status == "ok", found.message
    assert worst(found, scene) < 1e-3
    assert np.sqrt(np.trace(found.covariance[1, :3, :3])) < 5e-4


def test_without_the_first_view_the_frame_is_that_of_the_next_and_that_is_said():
    rng = np.random.default_rng(11)
    scene = view_scene(rng, CAMERA, 4, 30)
    visible = np.ones((4, 30), dtype=bool)
    visible[0] = False
    found = estimate_views(CAMERA, noisy(rng, scene), visible=visible, noise=0.1)
    assert found.status == "ok"
    assert found.reference == 1
    assert found.view_status[0] == "too_few_points"
    assert "the frame is that of view 1" in found.message
    with pytest.raises(InputError, match="view 0, from which it is seen, has no pose"):
        found.two_view(2)


@pytest.mark.slow
def test_pixels_with_larger_stated_noise_count_less():
    rng, errors = np.random.default_rng(12), {True: [], False: []}
    for _ in range(15):
        scene = view_scene(rng, CAMERA, 4, 30)
        noise = np.where(np.arange(30) % 2, 1.0, 0.05) * np.ones((4, 1))
        pixels = scene.pixels + noise[:, :, None] * rng.normal(size=scene.pixels.shape)
        length = float(np.linalg.norm(scene.poses[1].translation))
        for told in (True, False):
            stated = noise if told else None
            found = estimate_views(CAMERA, pixels, noise=stated, scale=length, robust=False)
            errors[told].append(worst(found, scene))
    assert np.median(errors[True]) < 0.5 * np.median(errors[False])


def test_wrong_pixels_that_are_near_at_first_are_left_out_before_the_noise_is_judged():
    """Off by eighteen times what is stated, which is less than the pixel within which points are placed."""
    rng = np.random.default_rng(23)
    scene = view_scene(rng, CAMERA, 3, 60)
    pixels, wrong = noisy(rng, scene, 0.05), rng.random((3, 60)) < 0.15
    angle = rng.uniform(0.0, 2.0 * np.pi, wrong.sum())
    pixels[wrong] += 0.9 * np.column_stack((np.cos(angle), np.sin(angle)))
    noise = np.full((3, 60), 0.05)
    length = float(np.linalg.norm(scene.poses[1].translation))
    found = estimate_views(CAMERA, pixels, noise=noise, scale=length)
    assert found.status == "ok", found.message
    assert found.noise_px < 0.1
    assert worst(found, scene) < 1e-3


def test_points_measured_in_overlapping_windows_make_an_estimate_less_sure():
    rng = np.random.default_rng(13)
    scene = view_scene(rng, CAMERA, 4, 80)
    pixels, shape = noisy(rng, scene), scene.pixels.shape[:2]
    alone = estimate_views(CAMERA, ViewPoints(pixels, noise=0.1), scale=0.1)
    wide = estimate_views(CAMERA, ViewPoints(pixels, noise=0.1, window=np.full(shape, 20.0)), scale=0.1)
    narrow = estimate_views(CAMERA, ViewPoints(pixels, noise=0.1, window=np.full(shape, 1e-3)), scale=0.1)
    assert_allclose(narrow.covariance[2], alone.covariance[2], rtol=1e-6)
    assert np.trace(wide.covariance[2]) > 1.5 * np.trace(alone.covariance[2])


def test_stated_errors_that_residuals_contradict_are_raised_and_that_is_said():
    rng = np.random.default_rng(14)
    scene = view_scene(rng, CAMERA, 5, 60)
    error = {"sigma_px": 0.05, "length_px": 0.2 * CAMERA.width}
    erring = UnifiedCamera.from_dict({**CAMERA.to_dict(), "model_error": error})
    found = estimate_views(erring, noisy(rng, scene, 0.3), noise=0.1, scale=0.1)
    assert found.status == "ok"
    assert "contradict the stated errors" in found.message


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"pairs": [[0, 9]]}, "scale: pairs: 0 to 9 given; legal: views 0 to 2"),
        ({"pairs": [[1, 1]]}, "scale: pairs: view 1 given twice"),
        ({"pairs": [0, 1]}, "scale: pairs: .* whole numbers"),
        ({"first_T_second": []}, "scale: first_T_second: 1 single poses"),
        ({"first_T_second": [np.eye(4)]}, "scale: first_T_second: .* single poses are needed"),
        ({"covariance": np.eye(5)}, r"scale: covariance: shape \(5, 5\) given"),
        ({"covariance": np.zeros((6, 6))}, "scale: covariance: a variance of 0"),
        ({"covariance": np.ones((6, 6))}, "scale: covariance: a symmetric, positive definite"),
    ],
)
def test_wrong_displacements_name_what_is_wrong(change, message):
    rng = np.random.default_rng(15)
    scene = view_scene(rng, CAMERA, 3, 12)
    known = dataclasses.replace(known_displacement(rng, scene), **change)
    with pytest.raises(InputError, match=message):
        estimate_views(CAMERA, scene.pixels, scale=known)


def test_noise_and_windows_of_another_shape_are_named():
    pixels = view_scene(np.random.default_rng(16), CAMERA, 3, 12).pixels
    with pytest.raises(InputError, match=r"noise: shape \(2, 12\) given; \(3, 12\) is needed"):
        estimate_views(CAMERA, pixels, noise=np.ones((2, 12)))
    with pytest.raises(InputError, match="window: -1 given"):
        estimate_views(CAMERA, ViewPoints(pixels, window=-np.ones((3, 12))))
    with pytest.raises(InputError, match="visible, noise: given beside ViewPoints"):
        estimate_views(CAMERA, ViewPoints(pixels), noise=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("scale", ["length", "displacements"])
def test_what_a_further_view_is_said_to_gain_it_gains(scale):
    rng, ratios = np.random.default_rng(17), []
    for _ in range(6):
        scene = view_scene(rng, CAMERA, 4, 40)
        pixels = noisy(rng, scene)
        known = float(np.linalg.norm(scene.poses[1].translation))
        after = known
        if scale == "displacements":
            known, after = displaced(scene, [[0, 1]]), displaced(scene, [[0, 1], [0, 3]])
        options = {"noise": 0.1, "calibration_covariance": focal_covariance(CAMERA)}
        found = estimate_views(CAMERA, pixels[:3], scale=known, **options)
        spread = np.diag([1e-6] * 6) if scale == "displacements" else None
        said = further_view(found, scene.poses[3], displacement=spread)
        then = estimate_views(CAMERA, pixels, scale=after, **options)
        assert said.points == 40
        assert said.position_sigma[1] < said.position_sigma[0]
        reached = np.sqrt(np.trace(then.covariance[2, :3, :3])), np.sqrt(np.trace(then.covariance[2, 3:, 3:]))
        ratios.append((reached[0] / said.position_sigma[1], reached[1] / said.rotation_sigma[1]))
        assert then.size_sigma == pytest.approx(said.size_sigma[1], rel=0.2)
    assert_allclose(ratios, 1.0, atol=0.2)


def test_candidates_for_a_further_view_are_sorted_by_what_they_gain():
    rng = np.random.default_rng(18)
    scene = view_scene(rng, CAMERA, 3, 40)
    found = estimate_views(CAMERA, noisy(rng, scene), scale=0.1, noise=0.1)
    gains = candidate_views(found)
    assert len(gains) >= 3
    assert [g.position_sigma[1] for g in gains] == sorted(g.position_sigma[1] for g in gains)
    assert "position σ" in repr(gains[0])
    lost = estimate_views(CAMERA, scene.pixels[:, :3], noise=0.1)
    with pytest.raises(InputError, match="without an estimate"):
        candidate_views(lost)
