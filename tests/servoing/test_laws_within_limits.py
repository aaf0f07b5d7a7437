"""Time laws within joint limits and image speed: kept at every millisecond, and as fast as they can be."""

import numpy as np
import pytest
from scipy.interpolate import BPoly
from scipy.optimize import linprog
from scipy.spatial.transform import RigidTransform

from omniservo.cameras import PRESETS, preset
from omniservo.errors import InputError
from omniservo.planning import CameraPath
from omniservo.servoing import PathLimits, RestToRestLaw, TimeOptimalLaw, image_speed

SPEEDS, ACCELERATIONS = np.array([1.0, 2.0, 1.5]), np.array([4.0, 3.0, 5.0])


def quintics(seed, joints=3, pieces=5):
    """A random joint path of the kind that `follow_path` gives."""
    rng = np.random.default_rng(seed)
    w = np.linspace(0.0, 1.0, pieces + 1)
    w[1:-1] += rng.uniform(-0.05, 0.05, pieces - 1)
    ends = rng.normal(size=(len(w), 3, joints)) * np.array([0.1, 1.0, 2.0])[None, :, None]
    spline = BPoly.from_derivatives(w, ends)
    return lambda at, order=0: spline(at, order)


def limited(joints, speed=None):
    path_speed = None if speed is None else lambda w: speed / (1.0 + np.sin(9.0 * w) ** 2)
    return PathLimits(joints, SPEEDS, ACCELERATIONS, path_speed)


def executed(law, joints):
    """q̇ and q̈ of the joints as executed, each millisecond; differences over 1 µs know nothing of the law."""
    times, step = np.arange(0.0, law.duration, 1e-3), 1e-6
    ahead, here, behind = (np.array([law(t + s) for t in times]) for s in (step, 0.0, -step))
    change = (ahead[:, 1] - behind[:, 1]) / (2.0 * step)
    first, second = joints(here[:, 0], 1), joints(here[:, 0], 2)
    return (
        here,
        first * here[:, 1:],
        second * here[:, 1:] ** 2 + first * change[:, None],
    )


@pytest.mark.parametrize("kind", [RestToRestLaw.for_limits, TimeOptimalLaw])
@pytest.mark.parametrize("seed", range(8))
def test_no_limit_is_exceeded_at_any_millisecond_and_one_is_met(kind, seed):
    joints = quintics(seed)
    limits = limited(joints, speed=0.6 if seed % 2 else None)
    law = kind(limits)
    here, speed, acceleration = executed(law, joints)
    shares = [(np.abs(speed) / SPEEDS).max(), (np.abs(acceleration) / ACCELERATIONS).max()]
    if seed % 2:
        shares.append((here[:, 1] / limits.top_path_speed(here[:, 0])).max())
    assert max(shares) <= 1.0
    assert max(shares) > 0.995


@pytest.mark.parametrize("seed", range(8))
def test_time_optimal_law_meets_a_limit_nearly_all_the_time(seed):
    """Bang-bang: at almost every moment some speed or acceleration is at its limit."""
    joints = quintics(seed)
    law = TimeOptimalLaw(limited(joints))
    _, speed, acceleration = executed(law, joints)
    at_limit = np.maximum(
        (np.abs(speed) / SPEEDS).max(axis=1), (np.abs(acceleration) / ACCELERATIONS).max(axis=1)
    )
    assert np.mean(at_limit > 0.9) > 0.95


@pytest.mark.parametrize("seed", [0, 3, 5])
def test_time_optimal_law_is_within_three_percent_of_a_linear_programmes_bound(seed):
    """∫dw/ẇ is least where every ẇ² is greatest: the greatest sum of x = ẇ² within limits at 300 places."""
    joints, n = quintics(seed), 300
    w = np.linspace(0.0, 1.0, n + 1)
    h = w[1]
    rows, bounds = [], []
    for i in range(n + 1):
        step = min(i, n - 1)  # ẅ of the step that begins here, of the last: that ends
        for q1, q2, top in zip(joints(w[i], 1), joints(w[i], 2), ACCELERATIONS, strict=True):
            row = np.zeros(n + 1)
            row[step] -= 0.5 * q1 / h
            row[step + 1] += 0.5 * q1 / h
            row[i] += q2
            rows += [row, -row]
            bounds += [top, top]
    top = ((SPEEDS / np.abs(joints(w, 1))).min(axis=1)) ** 2
    top[[0, -1]] = 0.0
    best = linprog(-np.ones(n + 1), rows, bounds, bounds=np.column_stack([0.0 * top, top]))
    assert best.success
    least = (2.0 * h / (np.sqrt(best.x[:-1]) + np.sqrt(best.x[1:]))).sum()
    assert TimeOptimalLaw(limited(joints)).duration < 1.03 * least
    assert TimeOptimalLaw(limited(joints)).duration > 0.97 * least


def test_the_time_optimal_law_stands_before_it_begins_and_after_its_end():
    law = TimeOptimalLaw(PathLimits(straight, [1.0], [4.0]))
    for time, place in (
        (-1.0, 0.0),
        (-1e-9, 0.0),
        (0.0, 0.0),
        (law.duration, 1.0),
        (law.duration + 1.0, 1.0),
    ):
        assert law(time) == (place, 0.0)


def test_motion_of_the_time_optimal_law_at_many_times_is_that_at_each():
    law = TimeOptimalLaw(PathLimits(straight, [1.0], [4.0]))
    times = np.linspace(0.0003, law.duration + 0.1, 223)
    w, rate, growth = law.motion(times)
    np.testing.assert_allclose(np.transpose([w, rate]), [law(time) for time in times], atol=1e-12)
    slopes = [(law(time + 1e-7)[1] - law(time - 1e-7)[1]) / 2e-7 for time in times]
    np.testing.assert_allclose(growth, slopes, atol=1e-5)


@pytest.mark.parametrize("size", [1e-2, 1e-3, 1e-4, 1e-6])
@pytest.mark.parametrize("seed", range(4))
def test_a_motion_of_milliradians_has_a_time_optimal_law_as_a_large_one_has(size, seed):
    """Within accelerations alone the least time goes with the root of the way."""
    joints = quintics(seed)
    large = PathLimits(joints, 1e3 * SPEEDS, ACCELERATIONS)
    small = PathLimits(lambda w, order: size * joints(w, order), 1e3 * SPEEDS, ACCELERATIONS)
    law = TimeOptimalLaw(small)
    assert law.duration == pytest.approx(np.sqrt(size) * TimeOptimalLaw(large).duration, rel=1e-2)
    assert small.excess(*law.motion(np.linspace(0.0, law.duration, 5001))) <= 1.0 + 1e-9


@pytest.mark.parametrize("order", [3, 5])
@pytest.mark.parametrize("side", [0.0, 1.0])
def test_joints_that_hardly_move_beside_an_end_take_no_longer_for_it(order, side):
    """q = u^order, u = w or 1 − w: one way with other names for its places, as in the closed form below."""

    def joints(w, derivative):
        factor = order if derivative == 1 else order * (order - 1)
        sign = 1.0 if derivative == 1 or side == 0.0 else -1.0
        return (sign * factor * np.abs(w - side) ** (order - derivative))[:, None]

    limits = PathLimits(joints, [100.0], [4.0])
    law = TimeOptimalLaw(limits)
    assert law.duration == pytest.approx(1.0, rel=0.04)
    assert limits.excess(*law.motion(np.linspace(0.0, law.duration, 5001))) <= 1.0 + 1e-3


def test_one_joint_that_only_accelerates_and_brakes_takes_the_closed_form():
    """Of a way of 1 within |q̈| ≤ a and a speed that is never reached: 2/√a."""
    law = TimeOptimalLaw(PathLimits(straight, [100.0], [4.0]))
    assert law.duration == pytest.approx(1.0, rel=1e-3)
    assert law(0.5 * law.duration) == (pytest.approx(0.5, abs=1e-5), pytest.approx(2.0, rel=1e-3))
    trapezoid = TimeOptimalLaw(PathLimits(straight, [1.0], [4.0]))
    assert trapezoid.duration == pytest.approx(1.0 + 1.0 / 4.0, rel=1e-3)


def test_a_path_speed_slows_the_time_optimal_law_down_where_it_asks_for_it_alone():
    """ẇ ≤ 0.25 on the last half, 1 before: a ramp of 1/4 s, a brake of 3/16 s, a slow half, a last brake."""
    limits = PathLimits(straight, [1.0], [4.0], lambda w: np.where(w < 0.5, 1.0, 0.25))
    fast = 1.0 / 4.0 + 0.75 / 4.0 + (0.5 - 1.0 / 8.0 - (1.0 - 0.0625) / 8.0)
    slow = 0.25 / 4.0 + (0.5 - 0.0625 / 8.0) / 0.25
    assert TimeOptimalLaw(limits).duration == pytest.approx(fast + slow, rel=2e-3)


def straight(w, order=0):
    return np.full((len(w), 1), 1.0 if order == 1 else 0.0)


def test_parameter_runs_from_zero_to_one_without_a_step_back_and_its_rate_is_the_derivative():
    law = TimeOptimalLaw(limited(quintics(1)))
    times = np.linspace(-0.5, law.duration + 0.5, 4001)
    w, rate = np.array([law(t) for t in times]).T
    assert (np.diff(w) >= 0.0).all()
    assert (w[0], w[-1], rate[0], rate[-1]) == (0.0, 1.0, 0.0, 0.0)
    assert w.max() == 1.0
    np.testing.assert_allclose(np.diff(w) / np.diff(times), 0.5 * (rate[1:] + rate[:-1]), atol=3e-3)
    assert law.finished(law.duration)
    assert not law.finished(0.999 * law.duration)


def test_rest_to_rest_keeps_a_least_duration():
    assert RestToRestLaw.for_limits(PathLimits(straight, [9.0], [99.0]), least_duration=4.0).duration == 4.0


def still(w, order=0):
    return np.zeros((len(w), 2))


@pytest.mark.parametrize(
    ("limits", "message"),
    [
        (lambda: PathLimits(still, [1.0, 1.0], [1.0, 1.0]), "nothing moves"),
        (lambda: PathLimits(still, [1.0, 0.0], [1.0, 1.0]), r"limits.speeds: .* must be > 0"),
        (lambda: PathLimits(still, [1.0, 1.0], [np.nan, 1.0]), "limits.accelerations: nan"),
        (lambda: PathLimits(still, [1.0], [1.0, 1.0]), "1 speeds and 2 accelerations"),
        (lambda: PathLimits(still, [1.0], [1.0]), r"limits.joints\(w, 1\): shape"),
        (lambda: PathLimits(lambda w, order: still(w) + np.nan, [1.0, 1.0], [1.0, 1.0]), "nan"),
        (lambda: PathLimits(straight, [1.0], [1.0], lambda w: 0.0 * w), "limits.path_speed"),
        (lambda: PathLimits(straight, [1.0], [1.0], lambda w: np.nan * w), "limits.path_speed"),
        (lambda: PathLimits(straight, [1.0], [1.0], lambda w: np.ones(3)), "limits.path_speed"),
    ],
)
@pytest.mark.parametrize("kind", [RestToRestLaw.for_limits, TimeOptimalLaw])
def test_wrong_limits_are_named(kind, limits, message):
    with pytest.raises(InputError, match=message):
        kind(limits())


def test_times_that_are_not_finite_are_refused():
    law = TimeOptimalLaw(PathLimits(straight, [1.0], [1.0]))
    for bad in (np.nan, np.inf):
        with pytest.raises(InputError, match="time"):
            law(bad)


CURVE = CameraPath(
    [[0.02, 0.1, 0], [0.05, -0.1, 0], [0.1, 0.03, 0], [0, 0, 1]],
    [[0.05, -0.1, 0], [-0.1, 0.1, 0], [0, 0.1, 0]],
)
POINTS = np.random.default_rng(2).uniform([-0.3, -0.3, 0.4], [0.3, 0.3, 0.8], (9, 3))


@pytest.mark.parametrize("name", sorted(PRESETS))
def test_image_speed_is_what_differences_of_pixels_say(name):
    camera = preset(name)
    w, step = np.linspace(0.1, 0.9, 9), 1e-5

    def pixels(at):
        seen = np.stack([CURVE(at).inv().apply(p) for p in POINTS], axis=1)
        found, valid = camera.project(seen)
        return np.where(valid[..., None], found, np.nan)

    moved = np.linalg.norm(pixels(w + step) - pixels(w - step), axis=-1) / (2.0 * step)
    np.testing.assert_allclose(image_speed(camera, CURVE, POINTS, w), np.nanmax(moved, axis=1), rtol=1e-5)


def test_image_speed_of_no_points_and_of_a_path_to_nowhere_is_refused():
    camera = preset(sorted(PRESETS)[0])
    with pytest.raises(InputError, match="points: none"):
        image_speed(camera, CURVE, np.zeros((0, 3)), [0.5])
    with pytest.raises(InputError, match=r"path\(w, 1\): nan"):
        image_speed(
            camera,
            lambda w, order=0: RigidTransform.identity(len(w)) if not order else np.full((len(w), 6), np.nan),
            POINTS,
            [0.5],
        )


def test_a_bend_finer_than_the_first_steps_gets_finer_ones():
    """With 400 steps the whole law would be stretched by 8%."""

    def turning(w, order):
        x = np.clip((w - 0.5) / 0.003, -50.0, 50.0)
        bend = np.tanh(x) if order == 1 else 1.0 / np.cosh(x) ** 2 / 0.003
        return np.column_stack((bend, np.full_like(w, float(order == 1))))

    law = TimeOptimalLaw(PathLimits(turning, [1.0, 1.0], [2.0, 2.0]))
    assert 1.0 <= law.stretched <= 1.005
    assert law.duration < 2.05
