"""An arm by RTDE, against the stand-in: joints by name, modes, stops, its own watchdog, losses, clocks."""

import re
import socket
import time

import numpy as np
import pytest
from tests.hardware.wall_clock_arm import PATIENCE, WallClockArm, wait_for

from omniservo.errors import ClockFault, ConnectionLost, InputError, NotInControl
from omniservo.hardware import ArmConnection, FaultyLine, LinkFaults
from omniservo.hardware.rtde import UR_JOINTS, RtdeArm
from omniservo.hardware.rtde.control_program import control_program
from omniservo.hardware.rtde.server import UrStandIn
from omniservo.robots import ArmMode

SPEEDS = np.array([0.01, -0.02, 0.03, 0.04, -0.05, 0.06])


@pytest.fixture
def stand_in():
    with UrStandIn(WallClockArm()) as server:
        server.arm = server._arm
        yield server


def opened(stand_in, names=UR_JOINTS, watchdog=1.0, **options):
    return RtdeArm(
        stand_in.address,
        names,
        watchdog=watchdog,
        patience=PATIENCE,
        script_port=stand_in.ports.scripts[0],
        dashboard_port=stand_in.ports.dashboard,
        **options,
    )


@pytest.fixture
def arm(stand_in):
    connection = opened(stand_in)
    yield connection
    connection.close()


def test_opening_gives_a_ready_arm_that_stands(stand_in, arm):
    state = arm.read()
    assert isinstance(arm, ArmConnection)
    assert (arm.joint_names, arm.watchdog, arm.notices) == (UR_JOINTS, 1.0, [])
    assert np.array_equal(state.joint_positions, stand_in.arm.joints)
    assert np.array_equal(state.joint_velocities, np.zeros(6))
    assert state.mode == ArmMode.READY
    assert np.array_equal(stand_in.arm.speeds, np.zeros(6))
    assert stand_in.refused == []


def test_joints_are_matched_by_name_whatever_their_order_and_prefix(stand_in):
    order = [3, 0, 5, 1, 4, 2]
    arm = opened(stand_in, [f"left_{UR_JOINTS[k]}_joint" for k in order])
    try:
        assert np.array_equal(arm.read().joint_positions, stand_in.arm.joints[order])
        arm.command(SPEEDS[order])
        wait_for(lambda: np.array_equal(stand_in.arm.speeds, SPEEDS), lambda: arm.command(SPEEDS[order]))
        wait_for(
            lambda: np.array_equal(arm.read().joint_velocities, SPEEDS[order]),
            lambda: arm.command(SPEEDS[order]),
        )
    finally:
        arm.close()


@pytest.mark.parametrize(
    "names",
    [
        [*UR_JOINTS[:5], "wrist_4"],
        UR_JOINTS[:5],
        [*UR_JOINTS[:5], "wrist_1"],
        [*UR_JOINTS[:5], "left_wrist_3"],
        [f"x{name}" for name in UR_JOINTS],
        [f"joint{k}" for k in range(6)],
    ],
)
def test_other_joints_are_refused_and_the_arms_are_listed(names):
    with pytest.raises(InputError, match=r"^joint_names .*: this arm has shoulder_pan, shoulder_lift, elbow"):
        RtdeArm("127.0.0.1:1", names)


def test_a_joint_that_the_arm_has_not_is_named_alone():
    with pytest.raises(InputError, match=r"^joint_names wrist_4_joint: this arm has .*robot file's joints"):
        RtdeArm("127.0.0.1:1", [*UR_JOINTS[:5], "wrist_4_joint"])


def test_commands_are_echoed_in_their_order_and_move_the_arm(stand_in, arm):
    arm.command(np.zeros(6))
    wait_for(lambda: arm.commands_acted_on == 1)
    for _ in range(5):
        arm.command(SPEEDS)
    wait_for(lambda: arm.commands_acted_on == arm.commands_sent)
    assert np.array_equal(stand_in.arm.speeds, SPEEDS)


@pytest.mark.parametrize("wrong", [[0.0] * 5, [0.0] * 5 + [np.nan], [np.inf] * 6, "fast"])
def test_a_wrong_command_is_refused_and_not_sent(stand_in, arm, wrong):
    with pytest.raises(InputError, match="joint_velocities"):
        arm.command(wrong)
    assert arm.commands_sent == 0


def test_silence_while_moving_stops_the_arm_for_good(stand_in):
    arm = opened(stand_in, watchdog=0.1)
    try:
        arm.command(SPEEDS)
        wait_for(lambda: arm.read().mode == ArmMode.NOT_IN_CONTROL)
        assert not stand_in.program_runs
        assert np.array_equal(stand_in.arm.speeds, np.zeros(6))
        reason = arm.read().mode_reason
        gap = re.fullmatch(
            r".*program stopped; longest gap between commands ([\d.]+) s, watchdog 0.1 s(: .* too busy)?",
            reason,
        )
        assert gap is not None, reason
        assert float(gap[1]) >= 0.099
        assert gap[2] or float(gap[1]) <= 0.1
        count = stand_in.arm.commands
        for _ in range(20):
            arm.command(SPEEDS)
        newest = arm.read().time
        wait_for(lambda: arm.read().time > newest + 0.02)
        assert stand_in.arm.commands == count
        assert arm.read().mode_reason == reason
    finally:
        arm.close()


def test_after_a_stop_silence_is_no_fault_and_commands_move_again(stand_in):
    arm = opened(stand_in, watchdog=0.1)
    try:
        wait_for(lambda: np.array_equal(stand_in.arm.speeds, SPEEDS), lambda: arm.command(SPEEDS))
        arm.stop()
        wait_for(lambda: np.array_equal(arm.read().joint_velocities, np.zeros(6)))
        newest = arm.read().time
        wait_for(lambda: arm.read().time > newest + 0.3)
        assert arm.read().mode == ArmMode.READY
        wait_for(lambda: np.array_equal(stand_in.arm.speeds, SPEEDS), lambda: arm.command(SPEEDS))
    finally:
        arm.close()


@pytest.mark.parametrize("mode", [m for m in ArmMode if m != ArmMode.READY])
def test_what_stops_the_controller_is_the_states_mode(stand_in, arm, mode):
    stand_in.arm.mode = mode
    wait_for(lambda: arm.read().mode == mode)
    stand_in.arm.mode = ArmMode.READY
    wait_for(lambda: arm.read().mode == ArmMode.NOT_IN_CONTROL)
    assert not stand_in.program_runs


@pytest.mark.parametrize("mode", [m for m in ArmMode if m != ArmMode.READY])
def test_a_stopped_arm_is_read_and_gets_no_program(stand_in, mode):
    stand_in.arm.mode = mode
    arm = opened(stand_in)
    try:
        assert arm.read().mode == mode
        (notice,) = arm.notices
        assert notice.startswith("the program was not sent: robot ")
        assert not stand_in.program_runs
    finally:
        arm.close()


def test_a_lost_connection_is_known_and_stays_lost(stand_in, arm):
    stand_in.close()

    def lost():
        try:
            arm.read()
        except ConnectionLost as error:
            return str(error)
        return None

    words = wait_for(lost)
    assert words == f"{stand_in.address}: the controller closed the connection"
    for call in (arm.stop, lambda: arm.command(SPEEDS), arm.read):
        with pytest.raises(ConnectionLost):
            call()


@pytest.mark.parametrize("speeds", [SPEEDS, np.zeros(6)])
def test_closing_stops_the_arm_and_ends_the_program(stand_in, speeds):
    """Also where it stands, and no watchdog would end it."""
    arm = opened(stand_in)
    wait_for(lambda: np.array_equal(stand_in.arm.speeds, SPEEDS), lambda: arm.command(SPEEDS))
    if not speeds.any():
        arm.stop()
        wait_for(lambda: arm.commands_acted_on == 0)
    arm.close()
    arm.close()
    wait_for(lambda: not stand_in.program_runs)
    assert np.array_equal(stand_in.arm.speeds, np.zeros(6))
    with pytest.raises(ConnectionLost, match=": closed$"):
        arm.read()


def test_a_second_commander_is_refused_by_name(stand_in, arm):
    with pytest.raises(
        NotInControl, match="another client of RTDE commands: it writes input_int_register_24"
    ):
        opened(stand_in)
    arm.command(SPEEDS)
    wait_for(lambda: arm.commands_acted_on == 1)


def send_program(stand_in, text):
    line = socket.create_connection(("127.0.0.1", stand_in.ports.scripts[0]))
    line.sendall(text.encode())
    wait_for(lambda: stand_in.program_runs)
    return line


def test_another_program_that_runs_is_not_ended(stand_in):
    with send_program(stand_in, "def rtde_control():\nend\n"):
        with pytest.raises(NotInControl, match="another program runs; stop it on the pendant"):
            opened(stand_in)
        assert stand_in.program_runs


def test_our_program_of_an_earlier_client_is_replaced(stand_in):
    with send_program(stand_in, control_program(0.5, 1.0)):
        earlier = stand_in._program
        arm = opened(stand_in, watchdog=0.2)
        assert stand_in._program is not earlier
        wait_for(lambda: stand_in._program.watched, lambda: arm.command(SPEEDS))
        assert stand_in._program.watched == ("input_int_register_24", pytest.approx(0.2))
        arm.close()


def test_a_program_that_takes_over_is_seen(stand_in, arm):
    with send_program(stand_in, "def rtde_control():\nend\n"):
        wait_for(lambda: arm.read().mode == ArmMode.NOT_IN_CONTROL)


def test_a_slider_that_does_not_stand_at_its_end_is_a_notice(stand_in):
    stand_in.speed_fraction = 0.5
    arm = opened(stand_in)
    assert arm.notices == ["the pendant's speed slider stands at 50%: it may scale commands"]
    arm.close()


def test_numbers_of_commands_begin_anew_after_the_largest(stand_in, arm):
    arm._number = 2**31 - 2
    for number in (2**31 - 1, 1, 2):
        arm.command(SPEEDS)
        assert arm.commands_sent == number
    wait_for(lambda: arm.commands_acted_on == 2)
    assert np.array_equal(stand_in.arm.speeds, SPEEDS)


def test_local_control_is_said(stand_in):
    stand_in.remote_control = False
    with pytest.raises(InputError, match=r"does not run in 0\.5 s: .* switch it to Remote Control"):
        RtdeArm(
            stand_in.address,
            patience=0.5,
            script_port=stand_in.ports.scripts[0],
            dashboard_port=stand_in.ports.dashboard,
        )


def test_a_program_that_the_pendant_runs_is_waited_for_nowhere(stand_in):
    arm = opened(stand_in, send_program=False)
    try:
        assert arm.read().mode == ArmMode.NOT_IN_CONTROL
        with send_program(stand_in, control_program(1.0, 1.0)):
            wait_for(lambda: arm.read().mode == ArmMode.READY)
            arm.command(SPEEDS)
            wait_for(lambda: np.array_equal(stand_in.arm.speeds, SPEEDS))
    finally:
        arm.close()
    assert stand_in.program_runs


def test_the_controllers_clock_is_mapped_to_ours():
    faults = LinkFaults(clock_offset=-1234.5, drift_ppm=100.0)
    with UrStandIn(WallClockArm(np.zeros(6)), faults=faults) as stand_in:
        arm = opened(stand_in)
        try:
            arm.command(SPEEDS)
            wait_for(lambda: arm.read().joint_velocities.any(), lambda: arm.command(SPEEDS))
            true = stand_in._arm.read()
            begin = true.time - true.joint_positions[0] / SPEEDS[0]
            states = [arm.read()]
            while states[-1].time < states[0].time + 0.5:
                arm.command(SPEEDS)
                time.sleep(0.01)
                states.append(arm.read())
            now = time.monotonic()
            late = [state.time - begin - state.joint_positions[0] / SPEEDS[0] for state in states]
            assert arm.clock.offset == pytest.approx(1234.5, abs=0.1)
            assert min(late) > -0.001
            assert np.median(late) < 0.05
            assert states[-1].time <= now
        finally:
            arm.close()


@pytest.mark.slow
def test_an_arm_is_braked_although_its_controllers_clock_was_set(stand_in):
    """It does not wait for the watchdog, nor does that end the program."""
    arm = opened(stand_in)
    try:
        begin = arm.read().time
        wait_for(lambda: arm.read().time > begin + 1.2, lambda: arm.command(SPEEDS))
        stand_in._clock = FaultyLine(LinkFaults(clock_offset=1.0), stand_in._begin)
        with pytest.raises(ClockFault):
            wait_for(lambda: False, lambda: arm.command(SPEEDS))
        assert stand_in.arm.speeds.any()
        with pytest.raises(ClockFault):
            arm.stop()
        wait_for(lambda: not stand_in.arm.speeds.any())
        assert stand_in.program_runs
    finally:
        arm.close()


def test_states_and_commands_that_are_lost_are_made_up_by_later_ones():
    with UrStandIn(WallClockArm(), faults=LinkFaults(latency=0.02, jitter=0.02, loss=0.3)) as stand_in:
        arm = opened(stand_in)
        try:
            wait_for(lambda: np.array_equal(stand_in._arm.speeds, SPEEDS), lambda: arm.command(SPEEDS))
            wait_for(lambda: np.array_equal(arm.read().joint_velocities, SPEEDS), lambda: arm.command(SPEEDS))
        finally:
            arm.close()
