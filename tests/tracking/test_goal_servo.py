import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.cameras import preset
from omniservo.errors import Divergence, FeatureLoss
from omniservo.tracking import GoalServo

CAMERA = preset("fe185")
POINTS = np.array(
    [[x, y, 0.4 - 0.3 * abs(x)] for x in (-0.08, 0.0, 0.09) for y in (-0.07, 0.01, 0.06)], dtype=np.float64
)
GOAL = RigidTransform.from_components([0.03, -0.05, 0.1], Rotation.from_rotvec([0.1, -0.2, 0.15]))


def seen_from(initial_T_camera):
    return CAMERA.project(initial_T_camera.inv().apply(POINTS))[0]


def servo(**kwargs):
    return GoalServo(CAMERA, POINTS, seen_from(GOAL), tolerance_px=1e-3, **kwargs)


def test_the_camera_arrives_where_the_goal_image_was_taken():
    controller, pose, dt = servo(), RigidTransform.identity(), 0.02
    everything = np.ones(len(POINTS), dtype=np.bool_)
    for k in range(2000):
        expected, ok = controller.predict(k * dt)
        assert ok.all()
        if k:
            assert np.abs(expected - seen_from(pose)).max() < 1e-6
        twist = controller.step(k * dt, seen_from(pose), everything)
        turn = Rotation.from_rotvec(twist[3:] * dt)
        pose = pose * RigidTransform.from_components(twist[:3] * dt, turn)
        if controller.done:
            break
    assert controller.done
    gap = GOAL.inv() * pose
    assert np.linalg.norm(gap.translation) < 1e-5
    assert gap.rotation.magnitude() < 1e-5
    assert np.isnan(controller.report.w)


def test_three_points_are_a_feature_loss():
    valid = np.arange(len(POINTS)) < 3
    with pytest.raises(FeatureLoss, match="3 points"):
        servo().step(0.0, seen_from(RigidTransform.identity()), valid)


def test_an_image_that_no_pose_explains_is_a_divergence_or_stays_finite():
    pixels = np.full((len(POINTS), 2), [300.0, 200.0])
    with pytest.raises(Divergence):
        servo().step(0.0, pixels, np.ones(len(POINTS), dtype=np.bool_))
