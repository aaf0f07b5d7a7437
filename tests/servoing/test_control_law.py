import numpy as np
import pytest

from omniservo.errors import InputError, SingularInteraction
from omniservo.servoing import BearingFeatures, VirtualPlaneFeatures, camera_twist, limited_twist
from omniservo.servoing.control_law import LEAST_CONDITIONING, solve_twist

TARGET = np.array([[0.08 * i, 0.06 * k - 0.05, 0.4 - 0.07 * abs(i)] for k in (-1, 0, 1) for i in (-1, 0, 1)])


@pytest.mark.parametrize("feature", [BearingFeatures(), VirtualPlaneFeatures()])
def test_twist_is_the_pseudo_inverse_solution(feature):
    rng = np.random.default_rng(1)
    interaction, _ = feature.interaction(TARGET)
    error = 0.01 * rng.standard_normal(interaction.shape[:2])
    flow = 0.1 * rng.standard_normal(interaction.shape[:2])
    inverse = np.linalg.pinv(interaction.reshape(-1, 6))
    expected = inverse @ (flow - 2.5 * error).ravel()
    np.testing.assert_allclose(camera_twist(error, interaction, flow, 2.5), expected, rtol=1e-10)


def test_without_feed_forward_the_reference_stands_still():
    interaction, _ = BearingFeatures().interaction(TARGET)
    error = np.full((9, 3), 0.01)
    np.testing.assert_array_equal(
        camera_twist(error, interaction, None, 1.0),
        camera_twist(error, interaction, np.zeros((9, 3)), 1.0),
    )


def test_feed_forward_of_a_motion_gives_that_motion_back():
    interaction, _ = BearingFeatures().interaction(TARGET)
    twist = np.array([0.1, -0.2, 0.3, 0.2, -0.1, 0.5])
    np.testing.assert_allclose(
        camera_twist(np.zeros((9, 3)), interaction, interaction @ twist, 3.0), twist, atol=1e-13
    )


@pytest.mark.parametrize("feature", [BearingFeatures(), VirtualPlaneFeatures()])
@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_points_on_one_line_are_singular_at_every_scale(feature, scale):
    line = scale * np.array([[0.1 * i, 0.02 * i, 1.0 + 0.03 * i] for i in range(-3, 4)])
    interaction, _ = feature.interaction(line)
    with pytest.raises(SingularInteraction, match="7 features do not determine"):
        camera_twist(np.zeros(interaction.shape[:2]), interaction, None, 1.0)


def test_two_points_are_singular_and_three_are_not():
    interaction, _ = BearingFeatures().interaction(TARGET)
    corners = interaction[[0, 2, 7]]
    camera_twist(np.zeros((3, 3)), corners, None, 1.0)
    with pytest.raises(SingularInteraction):
        camera_twist(np.zeros((2, 3)), corners[:2], None, 1.0)


def test_an_interaction_of_zeros_is_singular():
    with pytest.raises(SingularInteraction):
        camera_twist(np.zeros((4, 2)), np.zeros((4, 2, 6)), None, 1.0)


def conditioning(points):
    rows, _ = BearingFeatures().interaction(points)
    return solve_twist(np.ascontiguousarray(rows.reshape(-1, 6)), np.zeros(rows.size // 6), np.empty(6))


def test_conditioning_bounds_the_smallest_singular_value():
    rng = np.random.default_rng(2)
    for _ in range(50):
        points = rng.standard_normal((6, 3))
        rows = BearingFeatures().interaction(points)[0].reshape(-1, 6)
        halves = rows / np.repeat([np.linalg.norm(rows[:, :3]), np.linalg.norm(rows[:, 3:])], 3)
        smallest = np.linalg.svd(halves)[1][-1]
        assert smallest / np.sqrt(6) * (1 - 1e-9) <= conditioning(points) <= smallest * (1 + 1e-9)


def test_conditioning_does_not_depend_on_the_unit_of_length():
    assert conditioning(TARGET) == pytest.approx(conditioning(1000 * TARGET), rel=1e-9)


def test_threshold_lies_between_small_targets_and_lines():
    grid = np.array([[i, k, 0.0] for i in (-1, 0, 1) for k in (-1, 0, 1)])
    assert conditioning(0.03 * grid + [0, 0, 1]) > LEAST_CONDITIONING
    assert conditioning(0.01 * grid + [0, 0, 1]) < LEAST_CONDITIONING
    assert conditioning(0.01 * grid[:3] + [0, 0, 1]) < 1e-3 * LEAST_CONDITIONING


def test_speed_limits_scale_the_whole_twist():
    twist = np.array([0.3, 0.0, 0.4, 0.0, 2.0, 0.0])
    limited, factor = limited_twist(twist, 0.25, 10.0)
    assert factor == 0.5
    np.testing.assert_allclose(limited, 0.5 * twist)
    limited, factor = limited_twist(twist, 0.25, 0.2)
    assert np.linalg.norm(limited[3:]) == pytest.approx(0.2)
    np.testing.assert_allclose(limited, factor * twist)
    unlimited, factor = limited_twist(twist, 1.0, 3.0)
    assert factor == 1.0
    np.testing.assert_array_equal(unlimited, twist)


def test_zero_twist_stays_zero():
    limited, factor = limited_twist(np.zeros(6), 1.0, 1.0)
    assert factor == 1.0
    assert not limited.any()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"error": np.full((9, 3), np.nan)}, "error"),
        ({"interaction": np.zeros((9, 2, 6))}, "interaction"),
        ({"feed_forward": np.zeros((9, 2))}, "feed_forward"),
        ({"gain": -1.0}, "gain"),
        ({"gain": np.nan}, "gain"),
    ],
)
def test_wrong_calls_are_named(change, message):
    call = {
        "error": np.zeros((9, 3)),
        "interaction": BearingFeatures().interaction(TARGET)[0],
        "feed_forward": None,
        "gain": 1.0,
    }
    with pytest.raises(InputError, match=message):
        camera_twist(**{**call, **change})


@pytest.mark.parametrize("limit", [0.0, -1.0, np.nan])
def test_a_speed_limit_must_be_positive(limit):
    with pytest.raises(InputError, match="max_angular_speed"):
        limited_twist(np.zeros(6), 1.0, limit)
