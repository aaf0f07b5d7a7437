"""Joint paths: on the camera's path, with true derivatives, on every branch, and failing where it is said."""

from math import comb

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.errors import InputError
from omniservo.planning import CameraPath
from omniservo.robots import follow_path
from omniservo.robots.arm import LENGTH_SCALE, SINGULAR_VALUE

FLANGE_T_CAMERA = RigidTransform.from_components([0.03, -0.02, 0.09], Rotation.from_rotvec([0.3, -0.8, 1.1]))
CURVE = CameraPath(
    [[0.02, 0.1, 0], [0.05, -0.1, 0], [0.1, 0.03, 0], [0, 0, 1]],
    [[0.05, -0.1, 0], [-0.1, 0.1, 0], [0, 0.1, 0]],
)
STARTS = {
    "rx60": [0.2, 0.6, -1.6, 0.1, 1.2, 0.0],
    "ur5e": [0.0, -1.5, 1.5, -1.5, -1.5, 0.1],
    "panda": np.array([0, -1, 0, -3, 0, 2, 1]) * np.pi / 4,
    "urdf of six": [0.3, -0.5, 0.8, 0.2, 0.9, 0.1],
    "urdf of seven": [0.3, -0.5, 0.8, 0.4, 0.2, 0.9, 0.1],
}


@pytest.fixture(scope="module")
def followed(any_arm):
    """The curve, begun where the arm has room; every branch."""
    q = STARTS[
        any_arm.name if any_arm.name in STARTS else f"urdf of {'six' if any_arm.dof == 6 else 'seven'}"
    ]
    base_T_initial = any_arm.base_T_flange(q) * FLANGE_T_CAMERA
    return any_arm, base_T_initial, follow_path(any_arm, CURVE, base_T_initial, FLANGE_T_CAMERA)


def camera_error(arm, base_T_initial, q, w, path=CURVE):
    base_T_wanted = base_T_initial.as_matrix() @ path(w).as_matrix()
    base_T_camera = arm.base_T_flange(q).as_matrix() @ FLANGE_T_CAMERA.as_matrix()
    off = np.linalg.solve(base_T_wanted, base_T_camera)
    return max(np.linalg.norm(off[:3, 3]), Rotation.from_matrix(off[:3, :3]).magnitude())


def long_enough(result):
    found = [branch for branch in result.branches if branch.w[-1] > 0.3]
    assert found
    return found


def scaled_jacobian(arm, q):
    jacobian = arm.camera_jacobian(q, FLANGE_T_CAMERA)
    jacobian[:3] /= LENGTH_SCALE
    return jacobian


class Stated:
    """A camera's way stated by a function of w and an order, as a `CameraPath` is called."""

    def __init__(self, path):
        self.path = path

    def __call__(self, w):
        return self.path(w)

    def sampled(self, w):
        return self.path(w).as_matrix(), np.stack([self.path(w, order) for order in (1, 2)], axis=1)


def straight(direction):
    """A path along a vector of the initial camera frame, without turning."""
    return CameraPath([[0.0], [0.0], [0.0], [1.0]], np.column_stack([direction, np.zeros(3)]))


def test_at_every_sample_the_camera_is_on_its_path(followed):
    arm, base_T_initial, result = followed
    for branch in result.branches:
        for w, q in zip(branch.w, branch.positions, strict=True):
            assert camera_error(arm, base_T_initial, q, w) < 1e-9


def test_between_samples_the_camera_stays_within_a_micrometre_and_a_microradian(followed):
    arm, base_T_initial, result = followed
    for branch in result.branches:
        for w in np.linspace(0.0, branch.w[-1], 40):
            assert camera_error(arm, base_T_initial, branch(w), w) < 1e-6


def test_velocities_and_accelerations_equal_finite_differences_of_the_joints(followed):
    """Of six joints, from poses alone: the neighbours are solved for anew."""
    arm, base_T_initial, result = followed
    step = 1e-4
    for branch in long_enough(result)[::3] if arm.dof == 6 else ():
        for i in range(2, len(branch.w) - 2, 6):
            if branch.singular_values[i] > 0.1:
                goals = [
                    base_T_initial * CURVE(branch.w[i] + s) * FLANGE_T_CAMERA.inv() for s in (-step, 0, step)
                ]
                behind, here, ahead = (nearest(arm, goal, branch.positions[i]) for goal in goals)
                np.testing.assert_allclose((ahead - behind) / (2 * step), branch.velocities[i], atol=1e-5)
                bend = (ahead - 2 * here + behind) / step**2
                np.testing.assert_allclose(bend, branch.accelerations[i], atol=1e-3)


def test_accelerations_are_the_derivative_of_the_flow_that_gives_the_velocities(followed):
    arm, _, result = followed
    flow, step = flow_of(arm), 1e-6
    for branch in result.branches:
        for i in range(0, len(branch.w), 5):
            w, q, slope = branch.w[i], branch.positions[i], branch.velocities[i]
            np.testing.assert_allclose(flow(w, q), slope, atol=1e-8)
            along = (flow(w + step, q + step * slope) - flow(w - step, q - step * slope)) / (2 * step)
            if branch.singular_values[i] > 0.1:
                np.testing.assert_allclose(along, branch.accelerations[i], atol=1e-5)


def flow_of(arm):
    """q′(w, q) as `follow_path` states it, by pseudo-inverse: least motion, and a push off the limits."""
    middle, half = arm.joint_range.mean(axis=1), 0.5 * np.diff(arm.joint_range, axis=1)[:, 0]
    scale = np.array([1 / LENGTH_SCALE] * 3 + [1] * 3)
    ways = np.linalg.norm(scale * CURVE(np.linspace(0, 1, 33), 1), axis=1)
    strength = ways.mean() if arm.dof == 7 else 0.0

    def flow(w, q):
        jacobian = scaled_jacobian(arm, q)
        push = -strength * half * ((q - middle) / half) ** 5
        return push + np.linalg.pinv(jacobian) @ (scale * CURVE(w, 1) - jacobian @ push)

    return flow


def test_seven_joints_go_where_an_ode_solver_takes_the_flow(load):
    arm = load("panda")
    base_T_initial = arm.base_T_flange(STARTS["panda"]) * FLANGE_T_CAMERA
    for branch in follow_path(arm, CURVE, base_T_initial, FLANGE_T_CAMERA).branches[::3]:
        solved = solve_ivp(
            flow_of(arm), (0, 1), branch.positions[0], "DOP853", t_eval=branch.w, rtol=1e-9, atol=1e-11
        )
        np.testing.assert_allclose(branch.positions, solved.y.T, atol=1e-6)


def nearest(arm, goal, q):
    """Newton's iteration with a Jacobian by differences: knows nothing of the arm's own."""
    for _ in range(6):

        def off(joints):
            change = arm.base_T_flange(joints).inv() * goal
            return np.array([*change.translation, *change.rotation.as_rotvec()])

        here = off(q)
        slopes = [(off(q + s) - off(q - s)) / 2e-6 for s in 1e-6 * np.eye(6)]
        q = q - np.linalg.solve(np.transpose(slopes), here)
    return q


def test_joint_speeds_move_the_camera_with_the_paths_twist(followed):
    arm, _, result = followed
    for branch in result.branches:
        for w, q, slope in zip(branch.w, branch.positions, branch.velocities, strict=True):
            found = arm.camera_jacobian(q, FLANGE_T_CAMERA) @ slope
            np.testing.assert_allclose(found, CURVE(w, 1), atol=1e-8)


def test_singular_values_margins_and_travel_are_those_of_the_samples(followed):
    arm, _, result = followed
    for branch in result.branches:
        low, high = arm.joint_range.T
        for q, value, margin in zip(
            branch.positions, branch.singular_values, branch.limit_margins, strict=True
        ):
            least = np.linalg.svd(scaled_jacobian(arm, q), compute_uv=False)[-1]
            assert value == pytest.approx(least, abs=1e-9)
            np.testing.assert_allclose(margin, np.minimum(q - low, high - q), atol=1e-12)
        fine = branch(np.linspace(0, branch.w[-1], 400))
        way = np.abs(np.diff(fine, axis=0)).sum(axis=0)
        assert branch.travel == pytest.approx((way / arm.joint_speed).max(), rel=1e-3)


def test_feasible_branches_keep_limits_and_singular_values_between_samples_and_come_first(followed):
    arm, _, result = followed
    order = [branch.feasible for branch in result.branches]
    assert order == sorted(order, reverse=True)
    feasible = [branch for branch in result.branches if branch.feasible]
    assert [b.travel for b in feasible] == sorted(b.travel for b in feasible)
    for branch in feasible:
        assert branch.w[-1] == 1.0
        for q in branch(np.linspace(0.0, 1.0, 200)):
            assert arm.within_limits(q)
            assert np.linalg.svd(scaled_jacobian(arm, q), compute_uv=False)[-1] >= SINGULAR_VALUE


@pytest.mark.parametrize("name", ["rx60", "ur5e"])
def test_all_branches_of_the_start_are_tried_and_stay_apart(load, name):
    arm = load(name)
    base_T_initial = arm.base_T_flange(STARTS[name]) * FLANGE_T_CAMERA
    result = follow_path(arm, CURVE, base_T_initial, FLANGE_T_CAMERA)
    assert result.all_tried
    assert len(result.branches) == 8
    begun = np.array([branch.positions[0] for branch in result.branches])
    every = arm.branches(arm.base_T_flange(STARTS[name]))
    for q in every:
        assert np.abs(np.sin(0.5 * (begun - q))).max(axis=1).min() < 1e-9
    assert result.best.feasible


@pytest.mark.parametrize("name", ["urdf of six", "panda"])
def test_a_search_says_that_it_may_miss_branches(load, name):
    arm = load(name)
    base_T_initial = arm.base_T_flange(STARTS[name]) * FLANGE_T_CAMERA
    assert not follow_path(arm, CURVE, base_T_initial, FLANGE_T_CAMERA).all_tried


def test_panda_starts_apart_and_comes_away_from_its_limits(load):
    """Joints that start within 0.2 rad of a limit are farther off in the end, on average."""
    arm = load("panda")
    q = STARTS["panda"].copy()
    base_T_initial = arm.base_T_flange(q) * FLANGE_T_CAMERA
    result = follow_path(arm, CURVE, base_T_initial, FLANGE_T_CAMERA)
    assert len(result.branches) == 8
    nearest_limit = [
        (b.limit_margins[0].min(), b.limit_margins[-1, b.limit_margins[0].argmin()]) for b in result.branches
    ]
    tight = [(first, last) for first, last in nearest_limit if first < 0.2]
    assert tight
    assert np.mean([last - first for first, last in tight]) > 0.0


def test_stated_start_is_where_the_only_branch_begins_with_its_full_turns(followed):
    arm, base_T_initial, _ = followed
    stand = np.array(arm.inverse(base_T_initial * FLANGE_T_CAMERA.inv())[-1])
    result = follow_path(arm, CURVE, base_T_initial, FLANGE_T_CAMERA, start=stand)
    (branch,) = result.branches
    assert not result.all_tried
    np.testing.assert_allclose(branch.positions[0], stand, atol=1e-8)
    assert camera_error(arm, base_T_initial, branch(branch.w[-1]), branch.w[-1]) < 1e-6


def test_start_off_the_path_is_refused_with_its_distance(load):
    arm = load("ur5e")
    base_T_initial = arm.base_T_flange(STARTS["ur5e"]) * FLANGE_T_CAMERA
    aside = STARTS["ur5e"] + np.array([0.01, 0, 0, 0, 0, 0])
    with pytest.raises(InputError, match=r"start: [\d.]+ mm and 0.573 deg from the path's start"):
        follow_path(arm, CURVE, base_T_initial, FLANGE_T_CAMERA, start=aside)
    with pytest.raises(InputError, match="start: shape"):
        follow_path(arm, CURVE, base_T_initial, FLANGE_T_CAMERA, start=aside[:5])


@pytest.mark.parametrize("q5", [3e-7, 1e-6, 3e-6])
def test_start_on_whose_path_a_straight_wrist_would_leap_is_singular_at_once(load, q5):
    """Half a micrometre off the path, joints 4 and 6 turn by more than 0.1 rad to get onto it."""
    arm, random = load("rx60"), np.random.default_rng(5)
    for _ in range(20):
        stand = random.uniform(-1.0, 1.0, 6) + 1.5 * np.eye(6)[2]
        stand[4] = q5
        off = RigidTransform.from_exp_coords(1e-7 * random.standard_normal(6))
        begin = arm.base_T_flange(stand) * FLANGE_T_CAMERA * off
        (branch,) = follow_path(arm, CURVE, begin, FLANGE_T_CAMERA, start=stand).branches
        failure = branch.failures[-1]
        assert (failure.kind, failure.w, len(branch.w)) == ("singular", 0.0, 1)
        values = np.linalg.svd(scaled_jacobian(arm, branch.positions[0]), compute_uv=False)
        assert branch.singular_values[0] == pytest.approx(values[-1], abs=1e-6)


def test_joint_limit_is_named_with_joint_place_and_amount(load):
    """The camera on a circle about axis 1, by 2.4 rad from 1 rad on; joint 1 of the RX60 ends at 160 deg."""
    arm = load("rx60")
    q = np.array([1.0, 0.6, -1.6, 0.1, 1.2, 0.0])
    half = np.linspace(0, 1, 9) * 0.5 * 2.4
    quaternions = np.stack([0 * half, 0 * half, np.sin(half), np.cos(half)])
    turned = [
        np.polyfit(np.linspace(0, 1, 9), row, 8) for row in quaternions
    ]  # of the base: joint 1 by 2.4 rad
    about_base = CameraPath(turned, np.zeros((3, 1)))
    reference = arm.base_T_flange(q) * FLANGE_T_CAMERA

    @Stated
    def path(w, order=0):
        if order == 0:
            return about_base(w) * reference
        twist = about_base(w, order)  # of the base's frame as it turns; the camera is carried along
        angular = reference.rotation.inv().apply(twist[..., 3:])
        carried = reference.rotation.inv().apply(np.cross(twist[..., 3:], reference.translation))
        return np.concatenate([carried, angular], axis=-1)

    result = follow_path(arm, path, RigidTransform.identity(), FLANGE_T_CAMERA)
    own = min(result.branches, key=lambda b: np.abs(np.sin(0.5 * (b.positions[0] - q))).max())
    failure = own.failures[0]
    assert not own.feasible
    assert (failure.kind, failure.joint) == ("limit", "j1")
    limit = np.deg2rad(160)
    assert failure.w == pytest.approx((limit - 1.0) / 2.4, abs=2e-5)
    assert failure.amount == pytest.approx(3.4 - limit, abs=1e-6)
    assert failure.worst_w == 1.0
    assert own(failure.w)[0] == pytest.approx(limit, abs=1e-4)
    assert "j1 passes its limit from w = 0.74" in str(failure)
    np.testing.assert_allclose(own(1.0)[1:], q[1:], atol=1e-6)


@pytest.mark.parametrize("name", ["ur5e", "panda"])
def test_a_path_that_sways_all_the_way_is_followed_in_short_steps_to_its_end(load, name):
    """Six millimetres to and fro ten times: no step half as long as usual will do anywhere."""
    arm, turns = load(name), 20.0 * np.pi
    base_T_initial = arm.base_T_flange(STARTS[name]) * FLANGE_T_CAMERA

    @Stated
    def path(w, order=0):
        w = np.asarray(w, dtype=float)
        sway = 0.006 * turns**order * (np.sin, np.cos, lambda x: -np.sin(x))[order](turns * w)
        along = np.multiply.outer(sway, [1.0, 0.0, 0.0])
        return RigidTransform.from_translation(along) if order == 0 else np.pad(along, [(0, 0), (0, 3)])

    start = STARTS[name]
    branch = follow_path(arm, path, base_T_initial, FLANGE_T_CAMERA, start=start).best
    assert branch.feasible
    assert np.diff(branch.w).max() < 1 / 30
    for w in np.linspace(0.0, 1.0, 301):
        assert camera_error(arm, base_T_initial, branch(w), w, path) < 1e-6


def test_path_into_the_stretched_elbow_is_named_with_joint_place_and_value(load):
    arm = load("ur5e")
    base_T_initial = arm.base_T_flange(STARTS["ur5e"]) * FLANGE_T_CAMERA
    outwards = base_T_initial.rotation.inv().apply([-1.0, 0.0, 0.0])
    result = follow_path(arm, straight(outwards), base_T_initial, FLANGE_T_CAMERA)
    stopped = [b.failures[-1] for b in result.branches]
    assert not any(b.feasible for b in result.branches)
    assert {f.kind for f in stopped} == {"singular"}
    assert "elbow" in {f.joint for f in stopped}
    for branch, failure in zip(result.branches, stopped, strict=True):
        assert 0.0 < failure.amount < 5e-3  # of the last step, in which the value falls steeply
        assert branch.singular_values[-1] == pytest.approx(SINGULAR_VALUE, abs=5e-3)
        assert 0.0 < failure.w - branch.w[-1] < 1e-4
        assert "singular at w = " in str(failure)


def test_wrist_that_swings_through_straight_between_samples_is_seen(load):
    """A motion that joint 5 alone makes is smooth through q5 = 0; the singular value dips there for a
    moment, half way between two of the longest steps, w = 7/16 and 8/16: both of these are regular."""
    arm, rate = load("rx60"), 3.2
    q = np.array([0.2, 0.6, -1.6, 0.0, rate * 7.5 / 16.0, 0.0])
    axis = np.array([0.0, 1.0, 0.0])  # of joint 5 in the flange's frame, as q6 = 0

    @Stated
    def path(w, order=0):
        w = np.asarray(w, dtype=float)
        back = RigidTransform.from_translation([0, 0, -0.065])  # from the flange to the wrist's centre
        if order == 0:
            turn = RigidTransform.from_rotation(Rotation.from_rotvec(-rate * w[..., None] * axis))
            return back * turn * back.inv()
        twist = np.concatenate([np.cross(-rate * axis, [0, 0, 0.065]), -rate * axis])
        return np.broadcast_to(twist if order == 1 else 0 * twist, (*w.shape, 6))

    result = follow_path(arm, path, arm.base_T_flange(q), RigidTransform.identity())
    own = min(result.branches, key=lambda b: np.abs(np.sin(0.5 * (b.positions[0] - q))).max())
    failure = own.failures[-1]
    assert failure.kind == "singular"
    assert failure.joint in ("j4", "j6")
    assert 7.0 / 16.0 < failure.w < 7.5 / 16.0
    assert own.singular_values.min() >= SINGULAR_VALUE


def test_path_that_jumps_is_named_where_it_does(load):
    arm = load("ur5e")
    base_T_initial = arm.base_T_flange(STARTS["ur5e"]) * FLANGE_T_CAMERA

    @Stated
    def path(w, order=0):
        if order == 0:
            return RigidTransform.from_translation(
                np.multiply.outer(np.where(np.asarray(w) > 0.6, 0.05, 0), [1, 0, 0])
            )
        return np.zeros((*np.shape(w), 6))

    for branch in follow_path(arm, path, base_T_initial, FLANGE_T_CAMERA).branches:
        (failure,) = branch.failures
        assert failure.kind == "jump"
        assert failure.w == pytest.approx(0.6, abs=1e-4)
        goal = base_T_initial * path(1.0) * FLANGE_T_CAMERA.inv()
        there = arm.inverse_near(goal, branch.positions[-1])
        assert failure.amount == pytest.approx(np.abs(there - branch.positions[-1]).max(), rel=0.5)
        assert "would jump" in str(failure)


def test_start_out_of_reach_is_one_message(load):
    far = RigidTransform.from_translation([3.0, 0, 0])
    for name in ("ur5e", "panda"):
        with pytest.raises(InputError, match="path: its start cannot be reached: .*reach"):
            follow_path(load(name), CURVE, far, FLANGE_T_CAMERA)


def test_path_and_poses_that_are_not_finite_are_refused(load):
    arm = load("ur5e")
    start = arm.base_T_flange(STARTS["ur5e"]) * FLANGE_T_CAMERA
    nowhere = RigidTransform.from_translation([np.nan, 0, 0])
    with pytest.raises(InputError, match="base_T_initial: nan"):
        follow_path(arm, CURVE, nowhere, FLANGE_T_CAMERA)
    with pytest.raises(InputError, match="flange_T_camera: nan"):
        follow_path(arm, CURVE, start, nowhere)
    astray = Stated(lambda w, order=0: CURVE(w, order) if not order else np.full((len(w), 6), np.nan))
    with pytest.raises(InputError, match="path: motions: nan"):
        follow_path(arm, astray, start, FLANGE_T_CAMERA)


def test_pieces_between_two_places_are_the_same_motion(followed):
    branch, random = max(followed[2].branches, key=lambda b: b.w[-1]), np.random.default_rng(1)
    for _ in range(20):
        begin, end = np.sort(random.uniform(0.0, branch.w[-1], 2))
        knots, pieces = branch.bernstein_pieces(begin, end)
        assert (knots[0], knots[-1]) == (begin, end)
        np.testing.assert_array_equal(knots[1:-1], branch.w[(branch.w > begin) & (branch.w < end)])
        for low, high, piece in zip(knots[:-1], knots[1:], pieces, strict=True):
            u = random.uniform(0.0, 1.0)
            value = sum(comb(5, k) * u**k * (1.0 - u) ** (5 - k) * piece[k] for k in range(6))
            np.testing.assert_allclose(value, branch((1.0 - u) * low + u * high), atol=1e-11)
    whole = branch.bernstein_pieces()
    for part, all_of_it in zip(branch.bernstein_pieces(0.0, 1.0), whole, strict=True):
        np.testing.assert_array_equal(part, all_of_it)


def test_a_part_without_length_stands_still_and_what_is_not_on_the_path_is_refused(followed):
    branch = max(followed[2].branches, key=lambda b: b.w[-1])
    last = branch.w[-1]
    for begin, end in ((last, last), (last, last + 1e-9), (-1.0, 0.0), (0.3 * last, 0.3 * last)):
        knots, pieces = branch.bernstein_pieces(begin, end)
        place = min(max(begin, 0.0), last) if begin >= 0.0 else 0.0
        assert knots.tolist() == [place, place]
        np.testing.assert_array_equal(pieces, np.tile(branch(place), (1, 6, 1)))
    for begin, end in ((0.5 * last, 0.2 * last), (last + 1.0, last + 2.0), (-2.0, -1.0), (np.nan, 1.0)):
        with pytest.raises(InputError, match="begin"):
            branch.bernstein_pieces(begin, end)


def test_joint_path_is_not_read_beyond_its_end(followed):
    branch = followed[2].best
    with pytest.raises(InputError, match="w: .* given"):
        branch(1.5)
    with pytest.raises(InputError, match="w: nan"):
        branch(np.nan)
    with pytest.raises(InputError, match="order"):
        branch(0.0, 3)
    np.testing.assert_allclose(branch([0.0, branch.w[-1]]), branch.positions[[0, -1]], atol=1e-12)
    np.testing.assert_allclose(branch(branch.w[:-1], 1), branch.velocities[:-1], atol=1e-9)
    np.testing.assert_allclose(branch(branch.w[:-1], 2), branch.accelerations[:-1], atol=1e-7)
