import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.errors import InputError
from omniservo.servoing import BearingFeatures, VirtualPlaneFeatures, feature_named

BEARING = BearingFeatures()
PLANE = VirtualPlaneFeatures()


def moved(points, twist, time):
    """Camera coordinates of standing points after the camera moved with ``twist`` for ``time``."""
    before_T_after = RigidTransform.from_exp_coords(np.concatenate((twist[3:], twist[:3])) * time)
    return before_T_after.inv().apply(points)


def difference_quotient(feature, points):
    """∂s/∂twist by central differences of a rigid motion, (n, k, 6)."""
    step = 1e-6
    columns = []
    for axis in np.eye(6):
        after = feature.value(moved(points, axis, step))[0]
        before = feature.value(moved(points, axis, -step))[0]
        columns.append((after - before) / (2 * step))
    return np.stack(columns, axis=-1)


def points_around(rng, count):
    directions = rng.standard_normal((count, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    return directions * rng.uniform(0.1, 3.0, (count, 1))


def test_bearing_interaction_is_the_derivative_in_every_direction():
    points = points_around(np.random.default_rng(1), 200)
    interaction, valid = BEARING.interaction(points)
    assert valid.all()
    np.testing.assert_allclose(interaction, difference_quotient(BEARING, points), atol=2e-8)


@pytest.mark.parametrize(
    "point", [(0, 0, 1), (0, 0, -1), (1, 0, 0), (0, -1, 0), (0.3, 0.4, 0), (1e-3, 0, 1e-9), (0, 0, -1e-2)]
)
def test_bearing_interaction_holds_on_the_axis_behind_the_camera_and_close_to_it(point):
    points = np.array([point], dtype=float)
    interaction, valid = BEARING.interaction(points)
    assert valid.all()
    expected = difference_quotient(BEARING, points)
    np.testing.assert_allclose(interaction, expected, rtol=1e-5, atol=1e-6 * np.abs(expected).max())


def test_bearings_move_on_the_sphere():
    points = points_around(np.random.default_rng(2), 50)
    interaction, _ = BEARING.interaction(points)
    bearings, _ = BEARING.value(points)
    np.testing.assert_allclose(np.einsum("nk,nkj->nj", bearings, interaction), 0.0, atol=1e-14)


def test_virtual_plane_interaction_is_the_derivative_in_front_of_the_camera():
    rng = np.random.default_rng(3)
    points = np.column_stack((rng.uniform(-2, 2, (200, 2)), rng.uniform(0.2, 3, 200)))
    interaction, valid = PLANE.interaction(points)
    assert valid.all()
    expected = difference_quotient(PLANE, points)
    np.testing.assert_allclose(interaction, expected, rtol=1e-6, atol=1e-6)


def test_virtual_plane_interaction_still_holds_at_89_degrees():
    angle = np.radians(89.0)
    points = np.array([[np.sin(angle), 0.0, np.cos(angle)]])
    expected = difference_quotient(PLANE, points)
    np.testing.assert_allclose(PLANE.interaction(points)[0], expected, atol=1e-5 * np.abs(expected).max())


@pytest.mark.parametrize("z", [0.0, -1e-12, -1.0, 1e-12])
def test_virtual_plane_features_exist_only_in_front(z):
    for values, valid in (PLANE.value([[1.0, 0.0, z]]), PLANE.interaction([[1.0, 0.0, z]])):
        assert not valid[0]
        assert np.isnan(values).all()


def test_no_feature_exists_at_the_camera_centre():
    for feature in (BEARING, PLANE):
        assert not feature.value([[0.0, 0.0, 0.0]])[1][0]
        assert not feature.interaction([[0.0, 0.0, 0.0]])[1][0]


def test_bearing_value_is_the_unit_direction():
    points = points_around(np.random.default_rng(4), 20)
    value, valid = BEARING.value(points)
    assert valid.all()
    np.testing.assert_allclose(value, points / np.linalg.norm(points, axis=1)[:, None], atol=1e-15)


def test_bearing_interaction_turns_with_the_camera():
    rng = np.random.default_rng(5)
    points = points_around(rng, 10)
    turn = Rotation.from_rotvec([0.4, -1.1, 0.3])
    matrix = turn.as_matrix()
    both = np.kron(np.eye(2), matrix)
    turned, _ = BEARING.interaction(turn.apply(points))
    plain, _ = BEARING.interaction(points)
    np.testing.assert_allclose(turned, matrix @ plain @ both.T, atol=1e-12)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_points_that_are_not_finite_are_refused(bad):
    for feature in (BEARING, PLANE):
        with pytest.raises(InputError, match="points"):
            feature.interaction([[0.0, bad, 1.0]])
        with pytest.raises(InputError, match="bearings"):
            feature.value([[0.0, bad, 1.0]])


def test_an_unknown_feature_names_the_legal_ones():
    with pytest.raises(InputError, match="legal: bearing, virtual-plane"):
        feature_named("corner")
    assert feature_named("bearing").width == 3
    assert feature_named("virtual-plane").width == 2
