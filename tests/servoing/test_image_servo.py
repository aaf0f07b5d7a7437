import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.cameras import UnifiedCamera
from omniservo.errors import FeatureLoss, InputError, SingularInteraction
from omniservo.servoing import ImageServo, ImageServoOptions

PERSPECTIVE = UnifiedCamera(420.0, 420.0, 319.5, 239.5, 0.0, 640, 480)
FISHEYE = UnifiedCamera(296.9365, 298.4197, 316.8076, 254.9012, 1.291, 659, 432, max_angle=np.radians(92.5))
POINTS = np.array([[0.08 * i, 0.06 * k, 0.5 - 0.07 * abs(i)] for k in (-1, 0, 1) for i in (-1, 0, 1)])
START = RigidTransform.from_components([0.05, -0.03, -0.06], Rotation.from_rotvec([0.05, -0.1, 0.2]))


def view(camera, goal_T_camera):
    """Pixels and distances of the target from a pose stated in the goal's camera frame."""
    seen = goal_T_camera.inv().apply(POINTS)
    return camera.project(seen)[0], np.linalg.norm(seen, axis=1)


def goal_of(camera):
    return view(camera, RigidTransform.identity())


@pytest.mark.parametrize("camera", [PERSPECTIVE, FISHEYE])
@pytest.mark.parametrize("feature", ["bearing", "virtual-plane"])
@pytest.mark.parametrize("matrix", ["current", "desired", "mean"])
def test_converges_to_the_goal_image(camera, feature, matrix):
    pixels, distances = goal_of(camera)
    options = ImageServoOptions(feature=feature, matrix=matrix, gain=2.0)
    servo = ImageServo(camera, pixels, goal_distances=distances, options=options)
    pose = START
    for _ in range(500):
        twist = servo.step(*view(camera, pose))
        pose = pose * RigidTransform.from_exp_coords(np.concatenate((twist[3:], twist[:3])) * 0.02)
    assert servo.report.error_px < 1e-4
    assert np.linalg.norm(pose.translation) < 1e-6


def test_the_features_error_falls_as_an_exponential_with_the_current_matrix():
    pixels, _ = goal_of(PERSPECTIVE)
    servo = ImageServo(PERSPECTIVE, pixels, options=ImageServoOptions(gain=1.0))
    small = RigidTransform.from_components([1e-4, 2e-4, -1e-4], Rotation.from_rotvec([1e-4, 0, 2e-4]))
    pose, errors = small, []
    for _ in range(100):
        twist = servo.step(*view(PERSPECTIVE, pose))
        errors.append(servo.report.error_px)
        pose = pose * RigidTransform.from_exp_coords(np.concatenate((twist[3:], twist[:3])) * 0.01)
    np.testing.assert_allclose(errors, errors[0] * 0.99 ** np.arange(100), rtol=1e-3)


def test_lost_points_may_hold_nan_and_are_not_used():
    pixels, _ = goal_of(PERSPECTIVE)
    servo = ImageServo(PERSPECTIVE, pixels)
    seen, distances = view(PERSPECTIVE, START)
    everything = servo.step(seen, distances)
    valid = np.ones(9, dtype=bool)
    valid[[1, 4, 5]] = False
    seen[~valid] = np.nan
    distances[~valid] = np.nan
    some = servo.step(seen, distances, valid)
    assert servo.report.valid_count == 6
    np.testing.assert_allclose(some, everything, atol=0.05)


def test_too_few_points_stop_it():
    pixels, distances = goal_of(PERSPECTIVE)
    servo = ImageServo(PERSPECTIVE, pixels)
    valid = np.arange(9) < 4
    with pytest.raises(FeatureLoss, match="3 usable points; at least 4"):
        servo.step(pixels, distances, np.arange(9) < 3)
    servo.step(pixels, distances, valid)


def test_points_on_one_line_stop_it():
    line = np.array([[0.05 * i, 0.0, 0.5] for i in range(-3, 4)])
    pixels, _ = PERSPECTIVE.project(line)
    servo = ImageServo(PERSPECTIVE, pixels)
    with pytest.raises(SingularInteraction):
        servo.step(pixels, np.linalg.norm(line, axis=1))


def test_goal_pixel_past_90_degrees_has_no_virtual_plane_feature():
    angle = np.radians(91.5)
    edge = FISHEYE.project([np.sin(angle), 0.0, np.cos(angle)])[0]
    pixels = np.vstack((goal_of(FISHEYE)[0], edge))
    with pytest.raises(InputError, match="row 9, .* has no virtual-plane feature"):
        ImageServo(FISHEYE, pixels)
    ImageServo(FISHEYE, pixels, options=ImageServoOptions(feature="bearing"))


def test_speed_limits_are_kept_and_said():
    pixels, _ = goal_of(PERSPECTIVE)
    free = ImageServo(PERSPECTIVE, pixels, options=ImageServoOptions(gain=50.0, max_linear_speed=1e3,
                                                                     max_angular_speed=1e3))  # fmt: skip
    bound = ImageServo(PERSPECTIVE, pixels, options=ImageServoOptions(gain=50.0, max_linear_speed=0.1))
    image = view(PERSPECTIVE, START)
    wanted, limited = free.step(*image), bound.step(*image)
    assert np.linalg.norm(limited[:3]) <= 0.1 * (1 + 1e-12)
    np.testing.assert_allclose(np.cross(wanted[:3], limited[:3]), 0.0, atol=1e-9)
    assert bound.report.limited
    assert not free.report.limited


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"feature": "corner"}, "feature"),
        ({"matrix": "average"}, "legal: current, desired, mean"),
        ({"gain": 0.0}, "gain"),
        ({"least_features": 3}, "least_features"),
        ({"max_linear_speed": np.nan}, "max_linear_speed"),
    ],
)
def test_wrong_options_are_named(options, message):
    with pytest.raises(InputError, match=message):
        ImageServoOptions(**options)


def test_wrong_images_are_named():
    pixels, distances = goal_of(PERSPECTIVE)
    servo = ImageServo(PERSPECTIVE, pixels)
    broken = pixels.copy()
    broken[3, 1] = np.nan
    for call, message in [
        ((pixels[:5], distances), "pixels: shape"),
        ((broken, distances), r"pixels \(valid rows\).*\(3, 1\)"),
        ((pixels,), "distances: missing"),
        ((pixels, distances[:5]), "distances: shape"),
        ((pixels, -distances), "distances: .* legal: > 0"),
        ((pixels, distances, np.ones(9)), "valid: float64"),
    ]:
        with pytest.raises(InputError, match=message):
            servo.step(*call)
    with pytest.raises(InputError, match="goal_distances: missing"):
        ImageServo(PERSPECTIVE, pixels, options=ImageServoOptions(matrix="mean"))
