import numpy as np
import pytest
from kinematic_loop import Path, bent_path
from scipy.spatial.transform import Rotation

from omniservo.tracking.path_state import path_state


def state(path, w):
    pose, twist = np.empty(7), np.empty(6)
    path_state(np.ascontiguousarray(path.rotation), np.ascontiguousarray(path.translation), w, pose, twist)
    return pose, twist


def random_path(rng, rotation_degree, translation_degree):
    rotation = 0.3 * rng.standard_normal((4, rotation_degree + 1))
    rotation[3, -1] += 2.0
    return Path(rotation, rng.standard_normal((3, translation_degree + 1)))


@pytest.mark.parametrize("degrees", [(1, 1), (2, 2), (3, 1), (1, 4), (6, 5)])
def test_pose_is_the_polynomial_and_twist_its_derivative(degrees):
    rng = np.random.default_rng(sum(degrees))
    for _ in range(10):
        path = random_path(rng, *degrees)
        for w in (0.0, 0.31, 1.0):
            pose, twist = state(path, w)
            expected = path(w)
            np.testing.assert_allclose(pose[4:], expected.translation, atol=1e-14)
            assert (Rotation.from_quat(pose[:4]).inv() * expected.rotation).magnitude() < 1e-14
            np.testing.assert_allclose(twist, path.twist(w), rtol=1e-7, atol=1e-7)


def test_the_length_of_the_quaternion_changes_nothing():
    path = bent_path()
    stretched = Path(7.0 * path.rotation, path.translation)
    for w in np.linspace(0, 1, 5):
        for one, other in zip(state(path, w), state(stretched, w), strict=True):
            np.testing.assert_allclose(one, other, atol=1e-14)
