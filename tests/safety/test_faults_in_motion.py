"""What breaks while the arm moves is a stop by its name, and latches."""

import itertools
from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
from tests.safety.test_closed_loop import run  # noqa: F401
from tests.safety.test_supervisor import SLOW, stands_still

from omniservo.errors import (
    ClockFault,
    InputError,
    InvalidData,
    NotFinite,
    NotFollowing,
    RobotLost,
    ServoStop,
    StaleImage,
)
from omniservo.robots import RobotState, load_arm
from omniservo.safety import SafetyOptions, image_watch
from omniservo.safety.following_watch import FollowingWatch
from omniservo.safety.motion_history import MotionHistory

LINES = ("read", "image", "command")


def down(*_):
    raise ConnectionError("the line is down")


def go_on(supervisor, seconds, velocities=SLOW):
    """Command the same for a while, as a loop does."""
    for _ in range(round(seconds / 0.033)):
        supervisor.command(velocities)
        supervisor.wait(0.033)


def after(written, time, change, name="read"):
    """Let what a method of the robot returns be changed from a time on."""
    sound = getattr(written, name)
    setattr(written, name, lambda *a: change(sound(*a)) if written.robot.time >= time else sound(*a))


@pytest.mark.parametrize("line", LINES)
def test_a_robot_that_does_not_answer_in_mid_motion_is_a_named_stop_and_is_braked_as_far_as_it_hears(
    guard, written, line
):
    supervisor = guard()
    go_on(supervisor, 0.2)
    setattr(written, line, down)
    with pytest.raises(RobotLost, match=f"robot's {line} failed: ConnectionError: the line is down") as lost:
        supervisor.image()
        supervisor.command(SLOW)
    assert isinstance(lost.value.__cause__, ConnectionError)
    assert written.stops >= 1
    written.robot.advance(0.3)
    assert np.abs(written.robot.read().joint_velocities).max() < 1e-2
    assert supervisor.stopped is lost.value


def test_a_robot_that_is_gone_altogether_is_told_to_stop_all_the_same(guard, written):
    supervisor = guard()
    go_on(supervisor, 0.2)
    tried = []
    for line in LINES:
        setattr(written, line, down)
    written.stop = lambda: tried.append(1) or down()
    with pytest.raises(RobotLost) as lost:
        supervisor.command(SLOW)
    assert tried
    assert any("stop failed" in note for note in lost.value.__notes__)
    with pytest.raises(RobotLost):
        supervisor.stop()


def test_a_clock_that_lets_time_pass_and_breaks_is_a_stop_too(guard, written):
    supervisor = guard()
    supervisor.command(SLOW)
    advance, written.robot.advance = written.robot.advance, down
    with pytest.raises(RobotLost, match="wait failed"):
        supervisor.wait(0.01)
    written.robot.advance = advance
    assert stands_still(written)


@pytest.mark.parametrize(
    ("answer", "kind"),
    [
        (lambda s: RobotState(s.time, s.joint_positions[:5], s.joint_velocities[:5]), InvalidData),
        (lambda s: RobotState(s.time, s.joint_positions, s.joint_velocities[:5]), InvalidData),
        (lambda s: None, InvalidData),
        (lambda s: RobotState("noon", s.joint_positions, s.joint_velocities), InvalidData),
        (lambda s: replace(s, time=s.time - 0.05), ClockFault),
        (lambda s: replace(s, time=np.nan), NotFinite),
    ],
)
def test_a_reading_that_is_none_is_a_named_stop(guard, written, answer, kind):
    supervisor = guard()
    go_on(supervisor, 0.2)
    after(written, written.robot.time, answer)
    with pytest.raises(kind):
        supervisor.command(SLOW)
    del written.read
    assert stands_still(written)
    assert supervisor.stopped.reason == kind.reason


def test_a_robot_of_another_number_of_joints_is_a_wrong_call_before_it_moves(guard, written):
    written.broken = {"joint_positions": np.zeros(7), "joint_velocities": np.zeros(7)}
    with pytest.raises(InputError, match="the arm has 6"):
        guard()


@pytest.mark.parametrize(
    ("answer", "kind"),
    [
        (lambda image: replace(image, time=np.nan), NotFinite),
        (lambda image: replace(image, time_sigma=np.inf), NotFinite),
        (lambda image: replace(image, time_sigma=-0.001), InvalidData),
        (lambda image: replace(image, pixels=np.zeros((3, 4), np.uint8)), InvalidData),
        (lambda image: replace(image, pixels=image.pixels.astype(float)), InvalidData),
        (lambda image: "a picture", InvalidData),
    ],
)
def test_an_image_that_is_none_is_a_named_stop(guard, written, answer, kind):
    written.robot.advance(0.03)
    supervisor = guard()
    assert supervisor.image() is not None
    supervisor.command(SLOW)
    supervisor.wait(0.05)
    after(written, 0.0, answer, "image")
    with pytest.raises(kind):
        supervisor.image()
    assert stands_still(written)


def test_a_stop_latches_until_it_is_released_by_its_name(guard, written):
    supervisor = guard()
    go_on(supervisor, 0.1)
    with pytest.raises(NotFinite):
        supervisor.command(SLOW * np.nan)
    for again in (supervisor.command, lambda v: supervisor.carry(0.1 * v)):
        with pytest.raises(NotFinite, match=r"stopped before: .*release\('not_finite'\)"):
            again(SLOW)
    supervisor.wait(0.1)
    assert stands_still(written)
    for wrong in ("stale_image", "", None):
        with pytest.raises(InputError, match="legal: 'not_finite'"):
            supervisor.release(wrong)
    supervisor.release("not_finite")
    go_on(supervisor, 0.2)
    np.testing.assert_allclose(written.robot.read().joint_velocities, SLOW, atol=2e-3)
    with pytest.raises(InputError, match="is not stopped"):
        supervisor.release("not_finite")


def test_a_wrong_call_latches_as_well_and_a_plain_stop_does_not(guard, written):
    supervisor = guard()
    supervisor.command(SLOW)
    supervisor.stop()
    supervisor.command(SLOW)
    with pytest.raises(InputError):
        supervisor.command(np.zeros(5))
    with pytest.raises(InvalidData, match="stopped before"):
        supervisor.command(SLOW)
    supervisor.release("invalid_data")
    supervisor.command(SLOW)


def test_what_a_robot_was_stopped_for_first_stays_the_reason(guard, written):
    supervisor = guard()
    go_on(supervisor, 0.1)
    with pytest.raises(NotFinite):
        supervisor.command(SLOW * np.nan)
    written.read = down
    with pytest.raises(RobotLost):
        supervisor.read()
    assert supervisor.stopped.reason == "not_finite"


def test_a_robot_that_still_reports_nonsense_is_not_released(guard, written):
    supervisor = guard()
    written.broken = {"joint_positions": np.full(6, np.nan)}
    with pytest.raises(NotFinite):
        supervisor.read()
    with pytest.raises(NotFinite):
        supervisor.release("not_finite")
    with pytest.raises(NotFinite, match="nan"):
        supervisor.command(SLOW)


def stuck(joint, gain):
    """A drive that turns a share of what it is told."""

    def told(written):
        command = written.robot.command
        written.command = lambda v: command(np.where(np.arange(6) == joint, gain * np.asarray(v), v))

    return told


def frozen(written):
    state = written.robot.read()
    written.read = lambda: replace(state, time=written.robot.time)


@pytest.mark.parametrize(
    "fault", [stuck(0, 0.0), stuck(1, 0.5), stuck(2, 2.0), stuck(3, -1.0), stuck(4, 0.0), frozen]
)
def test_joints_that_do_not_do_what_they_are_told_are_stopped_within_a_few_degrees(guard, written, fault):
    supervisor = guard()
    go_on(supervisor, 0.5)
    fault(written)
    begin, sent = written.robot.time, written.robot.read().joint_positions
    with pytest.raises(NotFollowing, match=r"j\d turned by"):
        go_on(supervisor, 1.0)
    assert written.robot.time - begin < 0.3 + 0.2  # and braked
    assert np.abs(written.robot.read().joint_positions - sent).max() < np.deg2rad(8.0)


def test_frozen_joint_readings_do_not_let_a_joint_be_driven_to_its_end(guard, written, arm):
    """They stand from the start: what moves the arm is told apart only once its lag is over."""
    supervisor = guard()
    frozen(written)
    with pytest.raises(NotFollowing):
        go_on(supervisor, 3.0, np.array([0.6, 0, 0, 0, 0, 0]))
    assert written.robot.time < 0.25 + 0.3 + 0.2
    assert stands_still(written) or np.abs(written.robot.read().joint_velocities).max() < 1e-2


class Late:
    """Joint readings of some time ago, under the time of now."""

    def __init__(self, written, late):
        self.written, self.late, self.past = written, late, [written.robot.read()]
        self.sound = written.read

    def __call__(self):
        state = self.sound()
        self.past.append(state)
        then = [s for s in self.past if s.time <= state.time - self.late]
        return replace(then[-1] if then else self.past[0], time=state.time)


def test_a_reading_that_jumps_along_a_fast_motion_is_stopped_by_the_next_look(guard, written):
    """Over 0.1 s a drive of the largest gain would turn as far."""
    supervisor = guard()
    fast = np.array([1.6, 0, 0, 0, 0, 0])
    go_on(supervisor, 0.5, fast)
    begin, jump = written.robot.time, np.deg2rad([5.0, 0, 0, 0, 0, 0])
    after(written, begin, lambda s: replace(s, joint_positions=s.joint_positions + jump))
    with pytest.raises(NotFollowing, match=r"j1 turned by"):
        go_on(supervisor, 1.0, fast)
    assert written.robot.time - begin < 0.04 + 0.5  # and braked


def test_a_clock_that_stands_still_while_the_arm_moves_is_a_stop(guard, written):
    supervisor = guard()
    go_on(supervisor, 0.2)
    begin = written.robot.time
    after(written, begin, lambda state: replace(state, time=begin))
    with pytest.raises(ClockFault, match=r"stands still at .* 0.06\d s were waited"):
        go_on(supervisor, 1.0)
    assert written.robot.time - begin < 0.07 + 0.2  # and braked


def test_a_robot_that_reports_its_joints_twenty_times_a_second_is_sound(guard, written):
    supervisor = guard()
    sound, last = written.read, [written.read()]

    def seldom():
        state = sound()
        if state.time - last[0].time >= 0.05 - 1e-9:
            last[0] = state
        return last[0]

    written.read = seldom
    for velocities in (SLOW, -np.asarray(SLOW)):
        go_on(supervisor, 0.3, velocities)
    supervisor.stop()
    assert supervisor.stopped is None


@pytest.mark.parametrize("gain", [0.75, 1.3])
def test_a_drive_that_gets_another_gain_is_stopped_though_a_sound_one_may_have_it(guard, written, gain):
    supervisor = guard()
    go_on(supervisor, 1.0)
    command = written.robot.command
    written.command = lambda v: command(gain * np.asarray(v))
    begin = written.robot.time
    with pytest.raises(NotFollowing, match="its drive being what it was"):
        go_on(supervisor, 1.0)
    assert written.robot.time - begin < 0.3 + 0.2  # and braked


def test_what_a_drive_was_two_seconds_ago_is_forgotten_and_sooner_not(guard, written):
    command = written.robot.command
    for rest, kinds in ((2.2, ()), (1.2, (NotFollowing,))):
        written.command = command
        supervisor = guard()
        go_on(supervisor, 0.7)
        supervisor.stop()
        supervisor.wait(rest)
        written.command = lambda v: command(0.75 * np.asarray(v))
        with pytest.raises(kinds) if kinds else nullcontext():
            go_on(supervisor, 0.7, -np.asarray(SLOW))
        supervisor.stop()
        written.robot.advance(0.3)


def test_a_drive_that_is_mended_and_released_may_be_another_at_once(guard, written):
    supervisor = guard()
    command = written.robot.command
    go_on(supervisor, 0.7)
    written.command = lambda v: command(0.75 * np.asarray(v))
    with pytest.raises(NotFollowing):
        go_on(supervisor, 1.0)
    written.robot.advance(1.2)
    supervisor.release("not_following")
    go_on(supervisor, 0.7, -np.asarray(SLOW))


@pytest.mark.parametrize("late", [0.0, 0.2])
@pytest.mark.parametrize("gain", [0.8, 1.0, 1.2, 1.5])
def test_sound_drives_of_other_gains_and_late_readings_are_not_stopped(guard, written, gain, late):
    supervisor = guard()
    command = written.robot.command
    written.command = lambda v: command(gain * np.asarray(v))
    written.read = Late(written, late)
    random = np.random.default_rng(3)
    for _ in range(8):
        go_on(supervisor, 0.2, random.uniform(-0.5, 0.5, 6))
    supervisor.stop()
    supervisor.wait(0.3)


class Drive:
    """A joint of every arm's kind: dead time, time constant, gain; it is watched every 5 ms."""

    def __init__(self, delay=0.0, constant=0.005, gain=1.0, arm="ur5e"):
        self.delay, self.constant, self.gain = round(delay / 1e-3), constant, gain
        arm = load_arm(arm)
        self.most = 1e-3 * arm.joint_acceleration
        self.n = arm.dof
        self.q, self.v = np.zeros((2, self.n))
        self.sent = [np.zeros(self.n)] * (self.delay + 1)
        self.history = MotionHistory(self.state(0.0), 0.5 * arm.joint_acceleration)
        self.watch = FollowingWatch(arm, SafetyOptions())

    def state(self, time):
        return RobotState(time, self.q.copy(), self.v.copy())

    def follow(self, velocity, until, dead=np.inf, readings=5e-3):
        """Return when the watch tells that it does not follow; infinity: never."""
        for k in range(1, round(until / 1e-3)):
            time = 1e-3 * k
            wanted = self.gain * self.sent[-1 - self.delay] if time < dead else np.zeros(self.n)
            change = (wanted - self.v) * min(1.0, 1e-3 / self.constant)
            self.v = self.v + np.clip(change, -self.most, self.most)
            self.q = self.q + 1e-3 * self.v
            if k % 5 == 0:
                if k % round(readings / 1e-3) == 0:
                    self.history.measured(self.state(time))
                try:
                    self.watch.check(self.history)
                except NotFollowing:
                    return time
                self.history.sent(np.full(self.n, velocity(time)), time)
            self.sent.append(np.full(self.n, velocity(time)))
        return np.inf


def swing(time):
    """A speed that grows to 0.9 rad/s and back, again and again."""
    return 0.9 * np.sin(np.pi * time / 1.5)


@pytest.mark.parametrize("gain", [0.8, 1.0, 1.45])
@pytest.mark.parametrize(
    ("delay", "constant"), [(0.0, 0.02), (0.0, 0.1), (0.0, 0.2), (0.1, 0.1), (0.2, 0.03)]
)
def test_a_sound_drive_may_have_any_dead_time_and_time_constant_within_the_lag(delay, constant, gain):
    assert Drive(delay, constant, gain).follow(swing, 4.0) == np.inf


@pytest.mark.parametrize(("arm", "hertz", "amplitude"), [("panda", 2.0, 1.0), ("ur5e", 4.0, 0.6)])
def test_a_drive_that_cannot_accelerate_as_fast_as_it_is_sent_to_is_sound(arm, hertz, amplitude):
    """Within a window it stays behind and catches up: at its end the bounds alone have met again."""

    def back_and_forth(time):
        return 0.3 + amplitude * np.sign(np.sin(2.0 * np.pi * hertz * time) + 0.3 * np.sin(9.1 * time))

    assert Drive(gain=1.5, arm=arm).follow(back_and_forth, 3.0) == np.inf


def test_a_drive_whose_joints_are_reported_rarely_is_sound_however_violently_it_is_sent_to_and_fro():
    drive, random = Drive(constant=0.02), np.random.default_rng(4)
    steps = random.uniform(-1.0, 1.0, 1000)
    assert drive.follow(lambda time: steps[int(time / 0.03)], 6.0, readings=0.02) == np.inf


@pytest.mark.parametrize("dead", [1.6, 1.7, 2.25])
def test_a_joint_that_dies_while_it_speeds_up_is_told_at_once(dead):
    """A drive whose lag may be anything at any time would explain a joint that stays behind."""
    assert Drive().follow(swing, 4.0, dead) - dead < 0.08


def test_a_robot_that_moves_on_a_little_after_braking_may_be_commanded_again(guard, written):
    supervisor = guard()
    for _ in range(3):
        go_on(supervisor, 0.3, 2.0 * SLOW)
        supervisor.stop()
        go_on(supervisor, 0.1, -2.0 * SLOW)


def test_the_history_holds_everything_that_was_sent_braking_too(guard, written):
    supervisor = guard()
    go_on(supervisor, 0.3, 3.0 * SLOW)
    supervisor.stop()
    supervisor.wait(0.1)
    go_on(supervisor, 0.1)
    times = np.array([time for time, _ in written.commands])
    velocities = np.array([u for _, u in written.commands])
    sent = (velocities[:-1] * np.diff(times)[:, None]).sum(axis=0)
    np.testing.assert_allclose(supervisor.history.at(times[-1:])[1][0], sent, atol=1e-9)


def test_nan_in_a_valid_row_and_features_of_another_number_are_named_stops(run):  # noqa: F811
    for broken, reason in (
        (lambda p: np.where(np.arange(9)[:, None] == 4, np.nan, p), "not_finite"),
        (lambda p: np.where(np.arange(9)[:, None] == 4, np.inf, p), "not_finite"),
        (lambda p: p[:8], "invalid_data"),
    ):

        def spoil(controller, features, broken=broken):
            update, count = features.update, []

            def spoilt(image, predicted):
                count.append(1)
                pixels, seen = update(image, predicted)
                return (broken(pixels), seen) if len(count) > 5 else (pixels, seen)

            features.update = spoilt

        stop, steps = run(lambda k: np.array([0.02, 0, 0, 0, 0, 0]), prepare=spoil)
        assert (stop.reason, len(steps)) == (reason, 5)


def test_an_input_error_of_anybody_in_mid_motion_is_a_named_stop_and_before_it_a_wrong_call(run):  # noqa: F811
    def refuse(at):
        def twist(k):
            if k == at:
                raise InputError("virtual plane: Z <= 0")
            return np.array([0.02, 0, 0, 0, 0, 0])

        return twist

    stop, _ = run(refuse(5))
    assert (stop.reason, str(stop)) == ("invalid_data", "InputError: virtual plane: Z <= 0")
    with pytest.raises(InputError, match="virtual plane"):
        run(refuse(1))


def test_what_stops_a_servo_latches(guard, written, scene):
    from tests.safety.test_closed_loop import Commanding, Points

    from omniservo.safety import VisibilityFilter, servo

    supervisor = guard()
    controller = Commanding(written, scene, lambda k: np.array([0.02, 0, 0, 0, 0, 0]))
    stop = servo(
        supervisor, controller, Points(written, scene), VisibilityFilter(scene.camera),
        on_step=lambda step: None, time_limit=0.2,
    )  # fmt: skip
    assert stop.reason == "time_limit"
    with pytest.raises(ServoStop) as again:
        supervisor.command(SLOW)
    assert again.value.reason == "time_limit"
    supervisor.release("time_limit")
    supervisor.command(SLOW)


def test_a_robot_lost_in_a_servo_is_returned_by_its_name(run, written):  # noqa: F811
    def lose(k):
        if k == 5:
            written.command = down
        return np.array([0.02, 0, 0, 0, 0, 0])

    stop, steps = run(lose)
    assert stop.reason == "robot_lost"
    assert 4 <= len(steps) <= 5


MOVING = np.array([0.06, 0.03, 0.0, 0.0, 0.0, 0.1])
"""a twist with which the dots move in the image by some 50 px/s"""


def pictured(broken):
    """Let what is found in the image be changed after fifteen images."""

    def spoil(controller, features):
        update, seen_before = features.update, []

        def spoilt(image, predicted):
            pixels, seen = update(image, predicted)
            seen_before.append(pixels)
            return (broken(pixels, seen_before[14]), seen) if len(seen_before) > 15 else (pixels, seen)

        features.update = spoilt

    return spoil


def frozen_under_noise(p, before):
    return before + 0.3 * np.sin(1e3 * p)


@pytest.mark.parametrize(
    "broken",
    [
        lambda p, before: before,
        frozen_under_noise,
        lambda p, before: p + np.array([20.0, 0.0]),
        lambda p, before: p + np.where(np.arange(9)[:, None] < 4, [15.0, 10.0], 0.0),
        lambda p, before: p[::-1],
    ],
    ids=["frozen", "frozen with noise", "all off", "half off", "swapped"],
)
def test_pictures_that_do_not_move_as_the_joints_move_the_camera_are_a_named_stop(run, broken):  # noqa: F811
    stop, steps = run(lambda k: MOVING, prepare=pictured(broken), time_limit=2.0)
    assert stop.reason == "inconsistent_image"
    assert "did not move with the camera" in str(stop)
    assert len(steps) < 15 + 14


def test_how_far_time_stamps_are_off_is_known_from_the_images_before(run):  # noqa: F811
    """A picture 0.25 s late would stand still as well: the arm begins to move again as it freezes."""
    speed = [3.0] * 9 + [0.2] * 6 + [-3.0] * 40
    stop, steps = run(lambda k: speed[k] * MOVING, prepare=pictured(frozen_under_noise), time_limit=2.0)
    assert stop.reason == "inconsistent_image"
    assert len(steps) < 15 + 11


def test_points_that_jump_are_told_by_the_second_image_that_shows_it(run):  # noqa: F811
    stop, steps = run(lambda k: MOVING, prepare=pictured(lambda p, before: p + 20.0), time_limit=2.0)
    assert (stop.reason, len(steps)) == ("inconsistent_image", 15 + 1)


def test_a_single_odd_image_is_no_reference_for_the_next(run):  # noqa: F811
    def once(p, before):
        odd = not once.seen
        once.seen = True
        return p + 20.0 if odd else p

    once.seen = False
    stop, _ = run(lambda k: MOVING, prepare=pictured(once), time_limit=1.0)
    assert once.seen
    assert stop.reason == "time_limit"


def test_one_image_of_four_that_disagrees_is_none_and_two_in_a_row_are(run, monkeypatch):  # noqa: F811
    for many, reason in ((1, "time_limit"), (2, "inconsistent_image")):

        def disagreement(watch, before, now, points, many=many):
            return np.full(image_watch.OFFSETS, round(30 * now.time) % 4 < many), "odd"

        monkeypatch.setattr(image_watch.ImageWatch, "_disagreement", disagreement)
        stop, _ = run(lambda k: np.zeros(6), time_limit=0.5)
        assert stop.reason == reason


ROUND = np.array([0.09, 0.0, 0.0, 0.0, -0.12, 0.0])
"""a twist round the dots: they hardly move in the image"""


@pytest.mark.slow
def test_points_that_stand_still_are_told_from_a_motion_that_keeps_them_nearly_in_place(run):  # noqa: F811
    stop, steps = run(lambda k: ROUND, prepare=pictured(frozen_under_noise), time_limit=2.0)
    assert stop.reason == "inconsistent_image"
    assert len(steps) < 15 + 20
    stop, _ = run(lambda k: ROUND, time_limit=1.5)
    assert stop.reason == "time_limit"


@pytest.mark.slow
def test_points_that_stand_still_are_compared_with_the_oldest_image_that_shows_them_so(run):  # noqa: F811
    """Every fifth image is 2 px beside the first, not beside those after it: these still count."""
    seen = []

    def jolted(p, before):
        seen.append(1.2 * (len(seen) > 0) + np.array([1.9 * (len(seen) % 5 == 4), 0.0]))
        return before + seen[-1] + 0.3 * np.sin(1e3 * p)

    stop, steps = run(lambda k: ROUND if k >= 15 else np.zeros(6), prepare=pictured(jolted), time_limit=3.0)
    assert stop.reason == "inconsistent_image"
    assert len(steps) < 15 + 30


@pytest.mark.slow
@pytest.mark.parametrize(
    "broken",
    [
        lambda p, before: p,
        lambda p, before: p + 0.7 * np.sin(1e3 * p),
        lambda p, before: p + np.where(np.arange(9)[:, None] < 2, [15.0, 10.0], 0.0),
        lambda p, before: before + 1.05 * (p - before),
    ],
    ids=["sound", "noise", "two wrong matches", "calibration off by 5%"],
)
def test_sound_pictures_and_a_few_wrong_matches_are_none(run, broken):  # noqa: F811
    stop, _ = run(lambda k: MOVING, prepare=pictured(broken), time_limit=1.2)
    assert stop.reason == "time_limit"


@pytest.mark.slow
def test_points_nearer_than_they_were_taken_for_move_farther_but_not_aside(run):  # noqa: F811
    aside = np.array([[0.9, -0.45], [0.45, 0.9]])
    for change, reason in ((1.3 * np.eye(2), "time_limit"), (aside, "inconsistent_image")):
        broken = pictured(lambda p, before, change=change: before + (p - before) @ change.T)
        stop, _ = run(lambda k: np.array([0.1, 0, 0, 0, 0, 0]), prepare=broken, time_limit=1.6)
        assert stop.reason == reason


def test_a_principal_point_that_is_off_shows_where_the_camera_rolls_and_is_no_wrong_image(run):  # noqa: F811
    rolling, rate = 1.0, 30.0
    for off, reason in ((18.0, "time_limit"), (90.0, "inconsistent_image")):
        frames = itertools.count(1)

        def beside(p, before, off=off, frames=frames):
            angle = rolling * next(frames) / rate
            return p + off * np.array([1.0 - np.cos(angle), np.sin(angle)])

        stop, _ = run(lambda k: np.array([0, 0, 0, 0, 0, rolling]), prepare=pictured(beside), time_limit=1.5)
        assert stop.reason == reason


def test_time_stamps_off_by_a_fifth_of_a_second_are_not_inconsistent(run, written):  # noqa: F811
    written.read = Late(written, 0.2)
    stop, _ = run(lambda k: np.array([0.2, 0, 0, 0, 0, 0]), time_limit=0.7)
    assert stop.reason == "time_limit"


@pytest.mark.parametrize(
    ("sigma", "twist", "reason"),
    [
        (0.0, MOVING, "inconsistent_image"),
        (0.1, MOVING, "time_limit"),
        (0.1, np.zeros(6), "inconsistent_image"),
    ],
    ids=["known stamps", "uncertain stamps", "uncertain stamps at rest"],
)
def test_an_uncertain_stamp_explains_what_points_flow_in_that_time(run, written, sigma, twist, reason):  # noqa: F811
    after(written, 0.0, lambda image: image and replace(image, time_sigma=sigma), "image")
    off = pictured(lambda p, before: p + np.array([9.0, 9.0]))
    stop, _ = run(lambda k: twist, prepare=off, time_limit=1.2, image_age=1.0)
    assert stop.reason == reason


def test_a_future_time_stamp_beyond_the_age_allowed_stops(guard, written):
    supervisor = guard(image_age=0.25)
    written.robot.advance(0.05)
    after(written, 0.0, lambda image: replace(image, time=image.time + 1.0), "image")
    supervisor.image()
    with pytest.raises(StaleImage):
        supervisor.command(SLOW)
