import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo import KnownPoints, UnifiedCamera, ViewDistance, estimate_two_view, estimate_views, preset
from omniservo.errors import InputError

CAMERA = UnifiedCamera(296.9365, 298.4197, 316.8076, 254.9012, 1.2910, 659, 432)


class Walk:
    """Views of one target: initial_T_views, points in the first camera's frame, pixels (v, n, 2)."""

    def __init__(self, rng, views=5, n=30, *, flat=False, baseline=0.2):
        while True:
            board = 0.15 * rng.uniform(-1, 1, (n, 3)) * ([1, 1, 0] if flat else 1)
            turn = Rotation.from_rotvec([0.4, -0.5, 0.1])
            self.points = turn.apply(board) + np.array([0.0, 0.0, 0.5])
            self.poses = [RigidTransform.identity()]
            for _ in range(views - 1):
                direction = rng.normal(size=3)
                shift = baseline * direction / np.linalg.norm(direction)
                self.poses.append(
                    RigidTransform.from_components(shift, Rotation.from_rotvec(0.2 * rng.uniform(-1, 1, 3)))
                )
            seen = [CAMERA.project(pose.inv().apply(self.points)) for pose in self.poses]
            if all(valid.all() for _, valid in seen):
                break
        self.pixels = np.stack([pixels for pixels, _ in seen])
        self.noise = lambda sigma: self.pixels + sigma * rng.normal(size=self.pixels.shape)

    def worst(self, found):
        errors = [np.nanmax(np.abs(found.points - self.points))]
        for pose, true in zip(found.initial_T_views, self.poses, strict=True):
            if pose is not None:
                errors.append(np.linalg.norm(pose.translation - true.translation))
                errors.append((pose.rotation.inv() * true.rotation).magnitude())
        return max(errors)


def scales(walk):
    def distance(a, b):
        return float(np.linalg.norm(a - b))

    ends = walk.poses[2].translation, walk.poses[4].translation
    frame = RigidTransform.from_components([1.0, 2.0, 3.0], Rotation.from_rotvec([1.0, 1.0, 0.0]))
    return {
        "first two centres": distance(walk.poses[1].translation, np.zeros(3)),
        "two points": ((3, 7), distance(walk.points[3], walk.points[7])),
        "two views": ViewDistance(2, 4, distance(*ends)),
        "two known points": KnownPoints([3, 7], frame.apply(walk.points[[3, 7]])),
        "many known points": KnownPoints(np.arange(2, 9), frame.apply(walk.points[2:9])),
    }


@pytest.mark.parametrize("scale", list(scales(Walk(np.random.default_rng(0)))))
def test_exact_pixels_give_the_exact_metric_answer_from_every_scale(scale):
    walk = Walk(np.random.default_rng(1))
    found = estimate_views(CAMERA, walk.pixels, scale=scales(walk)[scale])
    assert found.status == "ok", found.message
    assert found.is_metric
    assert walk.worst(found) < 1e-6
    assert found.inliers.all()
    assert np.isfinite(found.covariance).all()


def test_without_a_scale_the_first_two_centres_are_one_apart():
    walk = Walk(np.random.default_rng(2))
    found = estimate_views(CAMERA, walk.pixels)
    assert found.status == "ok", found.message
    assert not found.is_metric
    length = np.linalg.norm(walk.poses[1].translation)
    assert np.linalg.norm(found.initial_T_views[1].translation) == pytest.approx(1.0)
    np.testing.assert_allclose(found.points * length, walk.points, atol=1e-6)
    along = found.initial_T_views[1].translation
    assert np.abs(found.covariance[1, :3, :3] @ along).max() < 1e-9 * np.trace(found.covariance[1])


def test_two_views_give_what_estimate_two_view_gives():
    rng = np.random.default_rng(3)
    for scale in (None, 0.2, ((0, 5), 0.1)):
        walk = Walk(rng, views=2)
        pixels = walk.noise(0.2)
        one = estimate_two_view(CAMERA, *pixels, scale=scale, noise=0.2)
        many = estimate_views(CAMERA, pixels, scale=scale, noise=0.2)
        assert one.status == many.status == "ok", (one.message, many.message)
        if not (one.inliers.all() and many.inliers.all()):
            continue
        np.testing.assert_allclose(
            many.initial_T_views[1].translation, one.initial_T_goal.translation, atol=1e-5
        )
        np.testing.assert_allclose(many.points, one.points, rtol=1e-3, atol=1e-5)
        # two views alone take valleys of the likelihood into account, and residuals beyond the stated noise
        ratio = np.trace(one.covariance) / np.trace(many.covariance[1])
        assert 0.99 < ratio < 2.0
        np.testing.assert_allclose(
            many.covariance[1] * ratio, one.covariance, atol=0.1 * np.trace(one.covariance)
        )


@pytest.mark.slow
def test_more_views_make_the_answer_sharper():
    rng = np.random.default_rng(4)
    two, five = [], []
    for _ in range(20):
        walk = Walk(rng, n=15)
        pixels = walk.noise(0.3)
        length = float(np.linalg.norm(walk.poses[1].translation))
        pair = estimate_views(CAMERA, pixels[:2], scale=length)
        whole = estimate_views(CAMERA, pixels, scale=length)
        if pair.status == whole.status == "ok" and not whole.message:
            turn = walk.poses[1].rotation.inv()
            two.append((turn * pair.initial_T_views[1].rotation).magnitude())
            five.append((turn * whole.initial_T_views[1].rotation).magnitude())
    assert len(two) >= 15
    assert np.median(five) < 0.7 * np.median(two)


@pytest.mark.slow
@pytest.mark.parametrize("scale", ["two points", "two views", "many known points"])
def test_covariances_are_those_of_repeated_noise(scale):
    walk = Walk(np.random.default_rng(5), views=5, n=16)
    stated = scales(walk)[scale]
    errors, predicted = [], []
    for _ in range(60):
        found = estimate_views(CAMERA, walk.noise(0.1), scale=stated, noise=0.1)
        assert found.status == "ok", found.message
        if not found.inliers.all():
            continue
        pose = found.initial_T_views[3]
        errors.append(
            np.concatenate(
                (
                    pose.translation - walk.poses[3].translation,
                    (walk.poses[3].rotation.inv() * pose.rotation).as_rotvec(),
                    found.points[0] - walk.points[0],
                )
            )
        )
        predicted.append(np.concatenate((np.diag(found.covariance[3]), np.diag(found.points_covariance[0]))))
    assert len(errors) > 36
    ratio = np.sqrt(np.var(errors, axis=0) / np.mean(predicted, axis=0))
    np.testing.assert_allclose(ratio, 1.0, atol=0.25)


def test_the_joint_law_has_the_covariances_of_its_parts():
    walk = Walk(np.random.default_rng(6), n=12)
    stated = scales(walk)["two points"]
    for noise in (0.2, None):
        found = estimate_views(CAMERA, walk.noise(0.2), scale=stated, noise=noise)
        pair = found.two_view(3)
        assert pair.status == "ok"
        motion, points = pair.uncertainty.covariances()
        scale = np.sqrt(np.outer(np.diag(found.covariance[3]), np.diag(found.covariance[3])))
        np.testing.assert_allclose(motion / scale, found.covariance[3] / scale, atol=1e-6)
        kept = pair.inliers
        np.testing.assert_allclose(points, found.points_covariance[kept], rtol=1e-4, atol=1e-12)
        samples = pair.sample(np.random.default_rng(7), 2000)
        spread = np.cov((samples.initial_T_goal.translation).T)
        np.testing.assert_allclose(np.diag(spread), np.diag(motion)[:3], rtol=0.25)


def test_points_seen_in_some_views_only_and_wrong_pixels_do_no_harm():
    rng = np.random.default_rng(8)
    walk = Walk(rng, views=5, n=40)
    pixels, visible = walk.noise(0.1), rng.uniform(size=(5, 40)) < 0.75
    wrong = (rng.uniform(size=(5, 40)) < 0.1) & visible
    pixels[wrong] += rng.uniform(15, 40, (int(wrong.sum()), 2))
    pixels[~visible] = np.nan
    length = float(np.linalg.norm(walk.poses[1].translation))
    found = estimate_views(CAMERA, pixels, visible=visible, scale=length)
    assert found.status == "ok", found.message
    assert not found.inliers[~visible].any()
    assert found.inliers[wrong].sum() <= 1
    assert found.inliers[visible & ~wrong].mean() > 0.95
    for pose, true in zip(found.initial_T_views, walk.poses, strict=True):
        assert np.linalg.norm(pose.translation - true.translation) < 0.01


def test_a_flat_target_of_known_points_needs_no_depth():
    rng = np.random.default_rng(9)
    walk = Walk(rng, views=4, n=12, flat=True)
    pixels = walk.noise(0.1)
    assert estimate_views(CAMERA, pixels, noise=0.1).status == "planar_points"
    known = KnownPoints(np.arange(6), walk.points[:6])
    found = estimate_views(CAMERA, pixels, scale=known)
    assert found.status == "ok", found.message
    assert walk.worst(found) < 0.02


@pytest.mark.parametrize(("larger", "status"), [(1.5, "ok"), (5.0, "not_converged")])
def test_a_group_of_known_points_in_quite_another_size_is_refused_by_its_points(larger, status):
    walk = Walk(np.random.default_rng(1))
    groups = np.repeat(np.arange(4), 4)
    known = np.where(groups[:, None] == 2, 1.0 / larger, 1.0) * walk.points[:16]
    found = estimate_views(CAMERA, walk.noise(0.1), scale=KnownPoints(np.arange(16), known, groups))
    assert found.status == status, found.message
    if status != "ok":
        assert found.message.startswith("the known points 8, 9, 10, 11 are ")


def test_a_place_next_to_infinity_does_not_make_up_the_whole_size():
    rng = np.random.default_rng(4)
    walk, groups = Walk(rng, views=3, n=24), np.repeat(np.arange(4), 4)
    pixels = walk.noise(0.05)
    far = 1e7 * np.array([0.1, 0.0, 1.0])
    pixels[:, 3] = [CAMERA.project(pose.inv().apply(far))[0] for pose in walk.poses]
    known = KnownPoints(np.arange(16), walk.points[:16], groups)
    found = estimate_views(CAMERA, pixels, scale=known)
    assert found.status == "not_converged", found
    assert "times as far apart as they should be" in found.message


def test_views_of_which_much_noise_is_stated_have_poses():
    walk = Walk(np.random.default_rng(3), views=4, n=30)
    found = estimate_views(CAMERA, walk.noise(3.0), noise=3.0)
    assert found.view_status == ("ok",) * 4, found.message
    assert found.inliers.mean() > 0.9


def test_noise_that_is_not_stated_is_found_where_it_is_more_than_usual():
    walk = Walk(np.random.default_rng(3), views=4, n=30)
    found = estimate_views(CAMERA, walk.noise(2.0))
    assert found.view_status == ("ok",) * 4, found.message
    assert found.inliers.mean() > 0.98
    assert found.noise_px == pytest.approx(2.0, rel=0.15)


@pytest.mark.slow
def test_one_residual_alone_does_not_tell_the_noise():
    outside = []
    for seed in range(40):
        walk = Walk(np.random.default_rng(seed), views=2, n=6)
        found = estimate_views(CAMERA, walk.noise(0.2), scale=KnownPoints(np.arange(6), walk.points))
        if found.status != "ok":
            continue
        assert found.freedom == pytest.approx(5.0)  # the residual's, and four of a usual σ
        pose, true = found.initial_T_views[1], walk.poses[1]
        turn = (pose.rotation.inv() * true.rotation).as_rotvec()
        error = np.concatenate((true.translation - pose.translation, turn))
        outside.append(error @ np.linalg.solve(found.covariance[1], error) > 22.5)  # χ²₆: one of 1000
    assert len(outside) > 20
    assert np.mean(outside) < 0.1


def test_a_view_of_something_else_has_no_pose_and_is_named():
    rng = np.random.default_rng(10)
    walk = Walk(rng, views=4, n=20)
    pixels = walk.noise(0.1)
    pixels[3] = rng.uniform([200, 150], [440, 350], (20, 2))
    found = estimate_views(CAMERA, pixels)
    assert found.status == "ok", found.message
    assert found.initial_T_views[3] is None
    assert np.isnan(found.covariance[3]).all()
    assert "view 3 has no pose" in found.message
    assert found.two_view(3).status == "not_converged"


def test_pictures_from_one_place_are_named():
    rng = np.random.default_rng(11)
    walk = Walk(rng, views=3, baseline=0.0)
    found = estimate_views(CAMERA, walk.noise(0.05))
    assert found.status in ("pure_rotation", "no_motion")
    assert all(pose is None for pose in found.initial_T_views)
    assert np.isnan(found.points).all()
    assert found.two_view().status == found.status


def test_views_that_six_wrong_pixels_spoil_are_refused_without_a_warning():
    rng, camera, n = np.random.default_rng(3), preset("fe185"), 25
    points = rng.uniform([-0.4, -0.4, 0.4], [0.4, 0.4, 1.0], (n, 3))
    steps = [(rng.uniform(-0.15, 0.15, 3), rng.uniform(-0.2, 0.2, 3)) for _ in range(3)]
    poses = [RigidTransform.from_components(t, Rotation.from_rotvec(turn)) for t, turn in steps]
    seen = [points, *(pose.inv().apply(points) for pose in poses)]
    pixels = np.array([camera.project(c)[0] for c in seen]) + 0.2 * rng.normal(size=(4, n, 2))
    pixels[3, :6] = pixels[3][np.random.default_rng(15).permutation(n)[:6]]
    visible = np.ones((4, n), dtype=np.bool_)
    visible[3, 6:] = False
    length = float(np.linalg.norm(poses[0].translation))
    found = estimate_views(camera, pixels, visible=visible, scale=length, noise=0.2)
    assert found.status == "not_converged" or found.initial_T_views[3] is None


def test_the_uncertain_length_moves_everything_together():
    walk = Walk(np.random.default_rng(12))
    found = estimate_views(CAMERA, walk.noise(1e-3), scale=0.2, scale_sigma=0.05, noise=1e-3)
    t = found.initial_T_views[2].translation
    along = t / np.linalg.norm(t)
    assert np.sqrt(along @ found.covariance[2, :3, :3] @ along) == pytest.approx(
        0.05 * np.linalg.norm(t), rel=0.05
    )
    assert found.two_view(2).scale_sigma == 0.05


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"pixels": np.zeros((1, 9, 2))}, "pixels: shape"),
        ({"pixels": np.zeros((3, 9))}, "pixels: shape"),
        ({"pixels": np.full((3, 9, 2), np.nan)}, "pixels .visible rows.: nan"),
        ({"pixels": np.full((3, 9, 2), 1e5)}, r"pixels: .* at index \(0, 0\) is outside"),
        ({"visible": np.ones((3, 8), dtype=bool)}, "visible: bool"),
        ({"noise": -1.0}, "noise: -1 given"),
        ({"scale": -1.0}, "scale: -1 given"),
        ({"scale": 1e300}, r"scale: 1e\+300 given"),
        ({"scale": ((0, 99), 1.0)}, "scale: index 99 given; legal: whole numbers from 0 to 29"),
        ({"scale": ((1, 1), 1.0)}, "scale: index: .* they must differ"),
        ({"scale": (1, 2, 3)}, "scale: .* given; legal: None"),
        ({"scale": ViewDistance(0, 9, 1.0)}, "scale: view 9 given"),
        ({"scale": ViewDistance(0, 1, 0.0)}, "scale: metres: 0 given"),
        ({"scale": ViewDistance(0, 1, 1e-300)}, "scale: metres: 1e-300 given"),
        ({"scale": KnownPoints([0, 1, 2], np.eye(3)[:2])}, "scale: 3 indices and 2 points"),
        ({"scale": KnownPoints([0, 1], np.zeros((2, 3)))}, "scale: points: all at one place"),
        ({"scale": KnownPoints([0, 1.5], np.eye(3)[:2])}, "scale: index 1.5"),
        ({"scale_sigma": -0.1}, "scale_sigma: -0.1"),
    ],
)
def test_wrong_input_names_the_argument(change, message):
    call = {"pixels": Walk(np.random.default_rng(13)).pixels} | change
    with pytest.raises(InputError, match=message):
        estimate_views(CAMERA, call.pop("pixels"), **call)
