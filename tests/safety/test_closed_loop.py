"""The loop on the simulated arm, with controllers and images that fail: it stops, says why, stands still."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from omniservo.errors import Divergence
from omniservo.safety import SafetyOptions, VisibilityFilter, servo
from omniservo.safety.closed_loop import POSTURE_GAIN


class Points:
    """The target's true projections: a tracker that cannot fail, so that the loop alone is looked at."""

    def __init__(self, written, scene):
        self._robot, self._scene = written.robot, scene
        self.seen = np.ones(9, dtype=bool)

    def update(self, image, predicted):
        place = self._robot.world_T_camera(self._robot.image().time)
        pixels, _ = self._scene.camera.project(place.inv().apply(self._scene.dots.centers))
        return np.where(self.seen[:, None], pixels, np.nan), self.seen


class Commanding:
    """A controller that commands what it is told to."""

    def __init__(self, written, scene, twist):
        self._robot, self._twist, self._count = written.robot, twist, 0
        self._start = scene.world_T_camera(scene.start_joints)
        self.points = self._start.inv().apply(scene.dots.centers)
        self.report, self.done = None, False
        self.error_px = 1.0
        self.flow = 0.0

    def predict(self, time):
        """Where all points move to the right."""
        return np.tile([self.flow * time, 0.0], (9, 1)), np.ones(9, dtype=bool)

    def step(self, time, pixels, valid, acts_at=None):
        self._count += 1
        pose = self._start.inv() * self._robot.world_T_camera(self._robot.image().time)
        self.report = SimpleNamespace(
            initial_T_camera=pose, error_px=self.error_px, goal_error_px=1.0, w=0.0, reference_pixels=pixels
        )
        return self._twist(self._count)


@pytest.fixture
def run(guard, written, scene):
    """Servo with a controller's twists (a function of the step's number); return the stop and the steps."""

    def go(twist, *, time_limit=5.0, prepare=lambda controller, features: None, **options):
        options = {"image_age": 0.25} | options
        controller, features = Commanding(written, scene, twist), Points(written, scene)
        prepare(controller, features)
        steps = []
        stop = servo(
            guard(**options), controller, features,
            VisibilityFilter(scene.camera, delay=0.02, options=SafetyOptions(**options)),
            on_step=steps.append, time_limit=time_limit,
        )  # fmt: skip
        assert np.abs(written.robot.read().joint_velocities).max() < 1e-3
        return stop, steps

    return go


def test_a_controller_that_gives_nan_stops_the_arm_and_nothing_of_it_leaves(run, written):
    stop, steps = run(lambda k: np.full(6, np.nan if k == 4 else 0.02))
    assert stop.reason == "not_finite"
    assert "controller" in str(stop)
    assert len(steps) == 3
    assert all(np.isfinite(v).all() for _, v in written.commands)
    assert any(v.any() for _, v in written.commands)


def test_six_joints_too_are_told_where_they_are_planned_to_be(guard, written, scene, monkeypatch):
    supervisor, wishes = guard(image_age=0.25), []
    carry = supervisor.carry
    monkeypatch.setattr(supervisor, "carry", lambda twist, wish: wishes.append(wish) or carry(twist, wish))
    controller, features = Commanding(written, scene, lambda k: np.zeros(6)), Points(written, scene)
    there, speeds = scene.start_joints + 0.1, np.full(6, 0.01)
    servo(
        supervisor, controller, features, VisibilityFilter(scene.camera, delay=0.02),
        on_step=lambda step: None, time_limit=0.1, posture=lambda time: (there, speeds),
    )  # fmt: skip
    wanted = wishes[0](supervisor.read())
    np.testing.assert_allclose(wanted, speeds + POSTURE_GAIN * 0.1, atol=1e-6)


def test_a_twist_that_no_joints_follow_for_want_of_image_points_is_not_sent(run):
    def lose(controller, features):
        features.seen = np.arange(9) < 3

    stop, steps = run(lambda k: np.zeros(6), prepare=lose)
    assert (stop.reason, len(steps)) == ("feature_loss", 0)


@pytest.mark.slow
def test_points_lost_while_they_move_far_in_an_exposure_stop_by_the_name_of_motion_blur(run):
    def lose(flow):
        def prepare(controller, features):
            features.seen, controller.flow = np.arange(9) < 3, flow

        return prepare

    fast, _ = run(lambda k: np.zeros(6), prepare=lose(400.0), exposure=0.03)
    assert fast.reason == "motion_blur"
    assert str(fast).startswith("motion blur: 12 px during the exposure of 30 ms; 3 of 9 points are seen")
    slow, _ = run(lambda k: np.zeros(6), prepare=lose(60.0), exposure=0.03)
    assert slow.reason == "feature_loss"


def test_points_are_looked_for_at_their_rows_instants_and_led_back_to_the_time_stamp(run, scene):
    asked = []

    def prepare(controller, features):
        controller.flow, plain = 300.0, features.update
        features.update = lambda image, predicted: asked.append(predicted) or plain(image, predicted)

    _, steps = run(lambda k: np.zeros(6), prepare=prepare, time_limit=0.1, readout=0.03)
    height = scene.camera.height
    np.testing.assert_allclose(asked[0], np.tile([300.0 * (0.5 / height - 0.5) * 0.03, 0.0], (9, 1)))
    place = scene.world_T_camera(scene.start_joints)
    seen, _ = scene.camera.project(place.inv().apply(scene.dots.centers))
    late = ((seen[:, 1] + 0.5) / height - 0.5) * 0.03
    np.testing.assert_allclose(steps[0].pixels[:, 0], seen[:, 0] - 300.0 * late, atol=1e-6)
    assert np.ptp(late) > 0.004


def test_the_time_limit_stops(run):
    stop, _ = run(lambda k: np.zeros(6), time_limit=0.1)
    assert stop.reason == "time_limit"
    assert str(stop) == "not at the goal after 0.1 s: the points are 1.00 px (rms) off the goal image"


def test_what_a_controller_refuses_stops_the_arm_by_its_name(run):
    def refuse(k):
        raise Divergence("nowhere near")

    stop, _ = run(refuse)
    assert (stop.reason, str(stop)) == ("divergence", "nowhere near")


def test_an_error_of_another_kind_goes_on_with_the_arm_at_rest(run, written):
    def break_down(k):
        if k == 3:
            raise ZeroDivisionError
        return np.full(6, 0.03)

    with pytest.raises(ZeroDivisionError):
        run(break_down)
    assert np.abs(written.robot.read().joint_velocities).max() < 1e-3


def test_a_command_that_would_lose_the_points_is_followed_only_as_far_as_they_stay(run, scene):
    stop, steps = run(lambda k: np.array([0, 0, 0, 0.0, 1.5, 0.0]), time_limit=1.0)
    assert stop.reason in ("time_limit", "joint_limit")
    assert np.abs(steps[0].filtered.change).max() == 0.0
    assert np.abs(steps[-1].filtered.change).max() > 0.3
    for step in steps:
        assert scene.camera.in_image(step.pixels).all()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("off", "sigma", "reason"),
    [(0.05, 1e-3, "clock_fault"), (0.05, None, "time_limit"), (0.0, 1e-3, "time_limit")],
)
def test_images_whose_measured_offset_is_wrong_stop_by_the_name_of_the_clock(
    run, written, off, sigma, reason
):
    robot = written.robot
    written.robot.advance(0.1)  # a first frame is there
    written.image = lambda: replace(robot.image(), time=robot.image().time + off)

    def twist(k):
        return 0.06 * np.sin(2.0 * np.pi * k / 40.0) * np.array([1.0, -0.6, 0.2, 0.0, 0.0, 0.5])

    stop, _ = run(twist, time_limit=3.0, offset_sigma=sigma)
    assert stop.reason == reason, stop


class OnASpot(Commanding):
    """A controller whose path is where the camera begins."""

    def distance(self, place):
        return float(np.linalg.norm(place))

    def off_path(self, time, slowing):
        return 0.0

    def slow_down(self, time, slowing):
        return time + slowing

    def coast(self, time, acts_at):
        return np.zeros(6)

    def go_on(self, time, rising):
        pass


@pytest.mark.parametrize("room", [0.02, 0.022, 0.024])
def test_nothing_is_commanded_where_the_last_reading_has_the_camera_beside_its_path(
    guard, written, scene, room
):
    """The image is older than the reading."""
    controller = OnASpot(written, scene, lambda k: np.array([0.2, 0, 0, 0, 0, 0]))
    steps = []
    stop = servo(
        guard(path_room=room), controller, Points(written, scene), VisibilityFilter(scene.camera, delay=0.02),
        on_step=steps.append, time_limit=1.0,
    )  # fmt: skip
    assert stop.reason == "off_path"
    start = scene.world_T_camera(scene.start_joints).translation
    places = [scene.world_T_camera(step.state.joint_positions).translation for step in steps]
    beside = np.linalg.norm(np.array(places) - start, axis=1)
    assert 0.5 * room < beside.max() <= room
