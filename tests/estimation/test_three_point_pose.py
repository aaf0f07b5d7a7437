import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from omniservo.estimation.minimal_solvers.three_point_pose import three_point_poses

FIRST_THREE = np.arange(3)


def solve(bearings, points):
    rotations, translations = np.empty((4, 3, 3)), np.empty((4, 3))
    count = three_point_poses(bearings, points, FIRST_THREE, rotations, translations)
    return [(rotations[i], translations[i]) for i in range(count)]


def seen(points, rotation, translation):
    c = (points - translation) @ rotation
    return c / np.linalg.norm(c, axis=1)[:, None]


def apart(pose, rotation, translation):
    return np.abs(pose[0] - rotation).max() + np.abs(pose[1] - translation).max()


def test_the_true_pose_is_among_the_solutions_for_bearings_of_any_direction():
    rng = np.random.default_rng(1)
    worst = 0.0
    for _ in range(2000):
        points, rotation = rng.normal(size=(3, 3)), Rotation.random(rng=rng).as_matrix()
        translation = rng.normal(size=3) * rng.choice([0.3, 2.0, 10.0])
        poses = solve(seen(points, rotation, translation), points)
        worst = max(worst, min(apart(pose, rotation, translation) for pose in poses))
    assert worst < 1e-7


def test_in_front_of_the_camera_every_solution_of_opencv_is_found():
    rng = np.random.default_rng(2)
    found = 0
    for _ in range(300):
        points, rotation = rng.normal(size=(3, 3)), Rotation.from_rotvec(rng.normal(size=3)).as_matrix()
        translation = points.mean(axis=0) - rotation @ np.array([0.0, 0.0, rng.uniform(3, 8)])
        bearings = seen(points, rotation, translation)
        if (bearings[:, 2] < 0.1).any():
            continue
        plane = (bearings[:, :2] / bearings[:, 2:]).reshape(3, 1, 2)
        _, turns, shifts = cv2.solveP3P(points.reshape(3, 1, 3), plane, np.eye(3), None, cv2.SOLVEPNP_AP3P)
        poses = solve(bearings, points)
        for turn, shift in zip(turns, shifts, strict=True):
            other = cv2.Rodrigues(turn)[0].T
            place = -other @ shift.ravel()
            # OpenCV also gives poses that do not have these pixels, or have points behind the camera.
            if np.abs(seen(points, other, place) - bearings).max() < 1e-9:
                found += 1
                assert min(apart(pose, other, place) for pose in poses) < 1e-5
    assert found > 300


def test_solutions_have_the_bearings_they_were_made_of():
    rng = np.random.default_rng(3)
    errors = []
    for _ in range(500):
        points, bearings = rng.normal(size=(3, 3)), rng.normal(size=(3, 3))
        bearings /= np.linalg.norm(bearings, axis=1)[:, None]
        errors += [np.abs(seen(points, *pose) - bearings).max() for pose in solve(bearings, points)]
        for rotation, _ in solve(bearings, points):
            np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
            assert np.linalg.det(rotation) > 0
    assert len(errors) > 200
    # nearly double solutions are kept although they are no exact ones: noise makes such pairs
    assert np.mean(np.array(errors) < 1e-9) > 0.97


def test_points_on_a_line_or_at_one_place_have_no_solution():
    bearings = np.array([[0.1, 0.0, 1.0], [0.0, 0.1, 1.0], [-0.1, 0.0, 1.0]])
    bearings /= np.linalg.norm(bearings, axis=1)[:, None]
    assert solve(bearings, np.outer([0.0, 1.0, 3.0], [1.0, 2.0, 3.0])) == []
    assert solve(bearings, np.array([[0.0, 0, 0], [0, 0, 0], [1, 0, 0]])) == []
    assert solve(bearings, np.zeros((3, 3))) == []
