"""The path as a function: pose, twist and its derivative."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.errors import InputError
from omniservo.planning import CameraPath


def some_path(sigma: int = 3, tau: int = 2) -> CameraPath:
    rng = np.random.default_rng(sigma + 7 * tau)
    rotation, translation = rng.normal(size=(4, sigma + 1)) * 0.3, rng.normal(size=(3, tau + 1)) * 0.2
    rotation[:, -1], translation[:, -1] = [0, 0, 0, 1], 0.0
    return CameraPath(rotation, translation)


def relative_twist(path: CameraPath, w: float, step: float) -> np.ndarray:
    """Central difference of the pose, as a twist in the camera frame at w."""
    before, after = path(w - step), path(w + step)
    at = path(w)
    linear = at.rotation.inv().apply(after.translation - before.translation)
    angular = (before.rotation.inv() * after.rotation).as_rotvec()
    return np.concatenate([linear, angular]) / (2.0 * step)


@pytest.mark.parametrize("degrees", [(1, 1), (2, 2), (3, 2), (5, 4)])
def test_twist_is_the_derivative_of_the_pose(degrees):
    path = some_path(*degrees)
    for w in (0.0, 0.3, 0.77, 1.0):
        assert np.allclose(path(w, 1), relative_twist(path, w, 1e-6), atol=1e-8)


@pytest.mark.parametrize("degrees", [(1, 1), (2, 2), (3, 2), (5, 4)])
def test_the_twists_derivative_is_its_difference(degrees):
    path = some_path(*degrees)
    for w in (0.0, 0.3, 0.77, 1.0):
        difference = (path(w + 1e-6, 1) - path(w - 1e-6, 1)) / 2e-6
        assert np.allclose(path(w, 2), difference, atol=1e-7)


def test_the_length_of_the_quaternion_changes_nothing():
    path = some_path()
    longer = CameraPath(path.rotation * 3.0, path.translation)
    for order in (1, 2):
        assert np.allclose(path(0.4, order), longer(0.4, order))
    assert np.allclose(path(0.4).as_matrix(), longer(0.4).as_matrix())


def test_any_shape_of_w_is_kept():
    path = some_path()
    w = np.linspace(0.0, 1.0, 6).reshape(2, 3)
    assert path(w).translation.shape == (2, 3, 3)
    assert path(w, 1).shape == path(w, 2).shape == (2, 3, 6)
    for i in range(2):
        for j in range(3):
            assert np.allclose(path(w).as_matrix()[i, j], path(w[i, j]).as_matrix())
            assert np.allclose(path(w, 2)[i, j], path(w[i, j], 2))
    assert path(0.5).translation.shape == (3,)
    assert path(0.5, 1).shape == (6,)
    assert path(np.zeros(0), 1).shape == (0, 6)


def test_the_pose_is_the_polynomial_of_23():
    path, w = some_path(2, 2), 0.37
    phi = path.rotation @ [w * w, w, 1.0]
    assert np.allclose(path(w).rotation.as_matrix(), Rotation.from_quat(phi).as_matrix())
    assert np.allclose(path(w).translation, path.translation @ [w * w, w, 1.0])
    assert path.degrees == (2, 2)


@pytest.mark.parametrize("order", [-1, 3, 1.5, "1"])
def test_another_order_is_refused(order):
    with pytest.raises(InputError, match="order"):
        some_path()(0.5, order)


def test_what_is_not_a_path_is_refused():
    good = some_path()
    with pytest.raises(InputError, match=r"path.rotation: shape \(3, 4\) given"):
        CameraPath(good.rotation[:3], good.translation)
    with pytest.raises(InputError, match="path.translation: nan"):
        CameraPath(good.rotation, np.full((3, 3), np.nan))
    for of in (good, good.positions):
        with pytest.raises(InputError, match="w: nan"):
            of(np.nan)
    with pytest.raises(ValueError, match="read-only"):
        good.rotation[0, 0] = 1.0


@pytest.mark.parametrize("degrees", [(1, 1), (3, 2), (5, 4)])
def test_a_part_and_another_frame_are_the_same_motion(degrees):
    path, s = some_path(*degrees), np.linspace(0.0, 1.0, 7)
    part = path.part(0.3, 0.8)
    assert np.allclose(part(s).as_matrix(), path(0.3 + 0.5 * s).as_matrix(), atol=1e-12)
    assert np.allclose(part(s, 1), 0.5 * path(0.3 + 0.5 * s, 1), atol=1e-12)
    there = RigidTransform.from_components([0.1, -0.2, 0.3], Rotation.from_rotvec([0.4, 1.0, -2.0]))
    assert np.allclose(path.seen_in(there)(s).as_matrix(), (there * path(s)).as_matrix(), atol=1e-12)
    with pytest.raises(InputError, match="end"):
        path.part(0.1, np.nan)
