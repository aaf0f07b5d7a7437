"""The supervisor on a clock that does not wait for it: durations, ages, modes."""

from dataclasses import replace

import numpy as np
import pytest

from omniservo.errors import ClockFault, InputError, NotInControl, ProtectiveStop, ServoStop, StaleJoints
from omniservo.robots import ArmMode
from omniservo.safety import SafetyOptions, Supervisor
from omniservo.safety.motion_history import Sent
from omniservo.safety.motion_limits import stopping_distance
from omniservo.safety.supervisor import TICK

SLOW = np.array([0.15, -0.1, 0.12, 0.2, -0.15, 0.25])


@pytest.fixture
def on_clock(arm, scene, written):
    """Make a supervisor whose waiting takes longer than it was asked for."""

    def make(late=0.0, **options):
        def wait(duration):
            written.advance(duration + late)

        return Supervisor(
            written, arm, scene.flange_T_camera, camera=written, wait=wait,
            clock=lambda: written.robot.time, options=SafetyOptions(**({"image_age": 1e6} | options)),
        )  # fmt: skip

    return make


def test_what_was_about_to_be_sent_when_the_process_slept_is_not_sent(on_clock, written, monkeypatch):
    supervisor = on_clock()
    supervisor.command(SLOW)
    supervisor.wait(0.1)
    check, count = supervisor._following.check, len(written.commands)
    monkeypatch.setattr(
        supervisor._following, "check", lambda history: (check(history), written.advance(0.5))
    )
    with pytest.raises(StaleJoints):
        supervisor.wait(0.1)
    assert (len(written.commands), written.stops) == (count, 1)


def test_a_process_that_slept_while_it_braked_does_not_go_on_braking_from_where_the_arm_no_longer_is(
    on_clock, written
):
    supervisor = on_clock()
    supervisor.command(SLOW)
    supervisor.wait(0.3)
    count, advance = len(written.commands), written.advance
    written.advance = lambda duration: advance(duration + (0.5 if len(written.commands) > count else 0.0))
    supervisor.stop()
    assert (len(written.commands), written.stops) == (count + 1, 1)


def test_what_was_held_before_braking_is_not_braked_for_at_one_stroke(on_clock, written, arm):
    supervisor, fast = on_clock(), np.array([1.5, 0.0, 0.0, 0.0, 0.0, 3.0])
    supervisor.command(fast)
    supervisor.wait(0.3)
    written.advance(0.05)
    count = len(written.commands)
    supervisor.stop()
    held, first = (np.asarray(written.commands[k][1]) for k in (count - 1, count))
    assert (np.abs(held - first) < arm.joint_acceleration * TICK + 1e-6).all()


@pytest.mark.parametrize("late", [0.0, 0.01, 0.04])  # [s] at every tick: within the reaction time
def test_joints_brake_within_their_stopping_distance_however_late_the_ticks_of_braking_are(
    on_clock, written, arm, late
):
    supervisor, fast = on_clock(), np.array([1.5, 0.0, 0.0, 0.0, 0.0, 3.0])
    supervisor.command(fast)
    supervisor.wait(0.3)
    advance, begin = written.advance, written.robot.read().joint_positions
    written.advance = lambda duration: advance(duration + late)
    supervisor.stop()
    advance(0.3)
    turned = written.robot.read().joint_positions - begin
    assert (
        turned < stopping_distance(fast, arm.joint_acceleration, supervisor.options.reaction) + 1e-3
    ).all()


def test_a_clock_that_jumps_while_joints_brake_does_not_halt_them_at_once(guard, written, arm):
    supervisor, reaction = guard(reaction=0.02), 0.02
    supervisor.command([0, 0, 0, 0, 0, 2.0])
    supervisor.wait(0.1)
    written.broken, count = {"time": written.robot.time + 10.0}, len(written.commands)
    supervisor.stop()
    speeds = [2.0, *(v[5] for _, v in written.commands[count:])]
    assert speeds[-1] == 0.0
    assert -np.diff(speeds).min() <= arm.joint_acceleration[5] * reaction + 1e-9


def test_the_history_is_told_when_each_command_was_sent_and_not_when_the_arm_has_taken_it(on_clock, written):
    supervisor, read = on_clock(), written.read
    taking, command, stop = 0.003, written.command, written.stop
    sending = []

    def slowly(send):
        def sent(*velocities):
            sending.append(written.robot.time)
            send(*velocities)
            written.advance(taking)

        return sent

    def old():  # the readings, too, have another time
        state = read()
        written.advance(0.001)
        return state

    written.read, written.command, written.stop = old, slowly(command), slowly(stop)
    supervisor.history.told = (news := []).append
    supervisor.command(SLOW)
    supervisor.wait(0.1)
    supervisor.stop()
    told = [one.time for one in news if isinstance(one, Sent)]
    assert len(told) > 10
    assert told == sending


def test_durations_are_measured_and_not_counted(on_clock, written):
    supervisor, begin = on_clock(late=3 * TICK), written.robot.time
    supervisor.command(0.1 * SLOW)
    passed = supervisor.wait(0.1)
    assert passed == pytest.approx(written.robot.time - begin)
    assert 0.1 <= passed <= 0.1 + 4 * TICK


def test_without_a_clock_what_is_waited_for_passes(guard):
    supervisor = guard()
    assert supervisor.wait(0.1) == pytest.approx(0.1)


@pytest.mark.parametrize("period", [0.0, 0.01, 0.02])
def test_joints_speed_up_and_slow_down_as_fast_however_seldom_they_are_read(on_clock, written, arm, period):
    """Controllers of 100 states a second are common; the arm is led on at every tick all the same."""
    robot, newest = written.robot, [written.robot.read()]

    def read():
        if robot.time - newest[0].time > period - 1e-9:
            newest[0] = robot.read()
        return newest[0]

    written.read = read
    supervisor, fast = on_clock(), 2.0
    needed = fast / arm.joint_acceleration[5]
    for target, since in ((fast, 0.0), (0.0, fast)):
        begin, count = robot.time, len(written.commands)
        supervisor.command([0, 0, 0, 0, 0, target])
        supervisor.wait(needed + 4 * TICK)
        ramp = [(t - begin, v[5]) for t, v in written.commands[count:]]
        assert abs(ramp[0][1] - since) <= arm.joint_acceleration[5] * TICK + 1e-9  # no jump after a rest
        assert ramp[-1][1] == pytest.approx(target)
        assert next(t for t, v in ramp if v == pytest.approx(target)) <= needed + 2 * TICK


def test_joints_that_grow_old_stop_the_moving_robot(on_clock, written):
    supervisor = on_clock(joint_age=0.05)
    supervisor.command(SLOW)
    supervisor.wait(0.1)
    frozen = written.robot.read()
    written.broken = {k: getattr(frozen, k) for k in ("time", "joint_positions", "joint_velocities")}
    with pytest.raises(StaleJoints, match=r"0\.05"):
        supervisor.wait(1.0)
    assert written.robot.time - frozen.time < 0.05 + 2 * TICK + 0.2
    assert not written.commands[-1][1].any()
    assert written.stops == 1


def test_a_younger_limit_stops_sooner(on_clock, written):
    times = []
    for age in (0.03, 0.2):
        supervisor = on_clock(joint_age=age, reaction=1.0)
        supervisor.command(0.1 * SLOW)
        written.broken = {"time": written.robot.time}
        begin = written.robot.time
        with pytest.raises(StaleJoints):
            supervisor.wait(1.0)
        times.append(written.robot.time - begin)
        written.broken = {}
    assert times[1] - times[0] == pytest.approx(0.17, abs=2 * TICK)


def test_joints_ahead_of_the_clock_are_a_clock_fault_and_do_not_count(on_clock, written):
    supervisor = on_clock()
    written.broken = {"time": written.robot.time + 1.0}
    with pytest.raises(ClockFault, match="ahead"):
        supervisor.command(SLOW)
    written.broken = {}
    supervisor.release("clock_fault")
    supervisor.command(0.1 * SLOW)


@pytest.mark.parametrize(
    ("mode", "kind"),
    [
        (ArmMode.PROTECTIVE_STOP, ProtectiveStop),
        (ArmMode.EMERGENCY_STOP, ProtectiveStop),
        (ArmMode.NOT_IN_CONTROL, NotInControl),
    ],
)
@pytest.mark.parametrize("make", ["guard", "on_clock"])
def test_an_arm_that_does_not_obey_is_sent_nothing_more(request, written, mode, kind, make):
    supervisor = request.getfixturevalue(make)()
    supervisor.command(SLOW)
    supervisor.wait(0.1)
    written.broken, count = {"mode": mode}, len(written.commands)
    with pytest.raises(kind):
        supervisor.wait(0.1)
    assert len(written.commands) == count
    assert written.stops == 1
    with pytest.raises(kind, match="stopped before"):
        supervisor.command(SLOW)
    assert len(written.commands) == count


def test_the_mode_is_passed_on(guard, written):
    supervisor = guard()
    written.broken = {"mode": ArmMode.NOT_IN_CONTROL}
    assert supervisor.read().mode is ArmMode.NOT_IN_CONTROL


def test_what_the_driver_knows_of_why_is_said_by_the_stop(guard, written):
    supervisor = guard()
    supervisor.command(SLOW)
    written.broken = {"mode": ArmMode.NOT_IN_CONTROL, "mode_reason": "the pendant commands"}
    with pytest.raises(NotInControl, match="takes no commands from this program: the pendant commands"):
        supervisor.wait(0.1)


def test_a_standing_robot_is_held_and_looked_at(guard, written):
    supervisor, count = guard(), len(written.commands)
    for _ in range(3):
        supervisor.hold()
    assert len(written.commands) == count + 3
    assert not any(v.any() for _, v in written.commands)
    written.broken = {"mode": ArmMode.PROTECTIVE_STOP}
    with pytest.raises(ProtectiveStop):
        supervisor.hold()
    with pytest.raises(ProtectiveStop, match="stopped before"):
        supervisor.hold()


def test_watch_leads_on_as_wait_does(guard, written):
    supervisor = guard()
    supervisor.watch()
    assert len(written.commands) == 1  # a standing robot is sent nothing
    supervisor.command(SLOW)
    for _ in range(100):
        written.advance(TICK)
        supervisor.watch()
    np.testing.assert_array_equal(supervisor.sent, SLOW)
    assert supervisor.moving
    supervisor.stop()
    assert not supervisor.moving


def test_what_was_measured_before_a_release_is_not_held_against_the_drives(guard, written):
    supervisor = guard()
    supervisor.command(SLOW)
    supervisor.wait(0.3)
    here = written.robot.read().joint_positions
    written.broken = {"joint_positions": here + 0.1}
    with pytest.raises(ServoStop) as stop:
        supervisor.wait(0.1)
    written.broken = {}
    written.advance(0.5)
    supervisor.release(stop.value.reason)
    supervisor.command(SLOW)
    supervisor.wait(0.5)


def test_joint_age_is_positive():
    with pytest.raises(InputError, match="joint_age"):
        replace(SafetyOptions(), joint_age=0.0)


def test_after_a_silence_the_arm_is_told_to_stop_and_not_led_to_rest(on_clock, written):
    supervisor = on_clock()
    supervisor.command(SLOW)
    supervisor.wait(0.2)
    written.robot.stop()
    written.advance(1.0)  # its own watchdog brought it to rest meanwhile
    count = len(written.commands)
    with pytest.raises(ServoStop) as stop:
        supervisor.watch()
    assert stop.value.reason == "slow_loop"
    assert len(written.commands) == count
    assert written.stops == 1
