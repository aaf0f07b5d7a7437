"""What an RTDE client hears that is not as agreed is refused by name, at opening and later; nothing hangs."""

import math
import socket
import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.hardware.false_controller import FalseController, data
from tests.hardware.wall_clock_arm import WallClockArm, wait_for

from omniservo.errors import ConnectionLost, InputError, NotFinite, OmniservoError, ServoStop
from omniservo.hardware.listener import Listener
from omniservo.hardware.rtde import RtdeArm
from omniservo.hardware.rtde.packets import PacketKind, packet
from omniservo.hardware.rtde.rtde_stream import RtdeStream
from omniservo.hardware.rtde.server import UrStandIn
from omniservo.robots import ArmMode


@pytest.fixture(scope="module")
def any_stand_in():
    with UrStandIn(WallClockArm()) as server:
        yield server


def refusal(address, patience=5.0):
    with pytest.raises(OmniservoError) as raised:
        RtdeArm(address, patience=patience, send_program=False).close()
    assert "\n" not in str(raised.value)
    return raised.value


def test_an_address_where_nobody_listens_is_one_message():
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    assert str(refusal(f"127.0.0.1:{port}")).startswith(f"127.0.0.1:{port}: no connection by RTDE: ")


@pytest.mark.parametrize(
    "address", ["", "robot:", "robot:0", "robot:70000", "robot:x", "two words", ":30004", "robot:٣"]
)
def test_what_is_no_address_is_refused(address):
    assert "address" in str(refusal(address))


def test_a_silent_port_is_one_message():
    with socket.create_server(("127.0.0.1", 0)) as silent:
        error = refusal(f"127.0.0.1:{silent.getsockname()[1]}", patience=0.2)
    assert isinstance(error, InputError)
    assert "no answer in 0.2 s when asked for version by RTDE" in str(error)


@pytest.mark.parametrize(
    ("greeting", "words"),
    [
        (b"HTTP/1.1 400 Bad Request\r\n\r\n", "answers, but not by RTDE: a packet of unknown kind 84"),
        (struct.pack(">iB", 80, 16) + bytes(75), "answers, but not by RTDE: a packet of 0 bytes"),
        (b"Connected: Universal Robots Dashboard Server\n", "not by RTDE: a packet of unknown kind 110"),
    ],
)
def test_another_protocol_is_one_message(greeting, words):
    with FalseController(greeting=greeting) as controller:
        assert words in str(refusal(controller.address))


def test_who_never_answers_but_talks_is_left():
    def chatter(line):
        while True:
            line.sendall(packet(PacketKind.TEXT, b"\5hello\0\3"))

    listener = Listener("127.0.0.1", 0, chatter)
    try:
        assert "no answer in 0.3 s" in str(refusal(f"127.0.0.1:{listener.port}", patience=0.3))
    finally:
        listener.close()


@pytest.mark.parametrize(
    ("kind", "answer", "words"),
    [
        (PacketKind.VERSION, packet(PacketKind.VERSION, b"\0"), "does not speak version 2 of RTDE"),
        (PacketKind.CONTROLLER, packet(PacketKind.CONTROLLER, b"\0\1"), "version of 2 bytes; RTDE has 16"),
        (PacketKind.OUTPUTS, packet(PacketKind.OUTPUTS, b"\1DOUBLE"), "1 types for 10 outputs"),
        (
            PacketKind.OUTPUTS,
            packet(PacketKind.OUTPUTS, b"\0" + b",".join([b"DOUBLE"] * 9 + [b"NOT_FOUND"])),
            "software 5.12.0 has no outputs output_int_register_25",
        ),
        (
            PacketKind.OUTPUTS,
            packet(PacketKind.OUTPUTS, b"\1" + b",".join([b"MATRIX"] * 10)),
            "unknown type 'MATRIX'",
        ),
        (
            PacketKind.INPUTS,
            packet(PacketKind.INPUTS, b"\0" + b",".join([b"INT32"] + [b"IN_USE"] * 6)),
            "another client of RTDE commands: it writes input_double_register_24",
        ),
        (PacketKind.INPUTS, packet(PacketKind.INPUTS), "1 types for 7 inputs"),
        (PacketKind.START, packet(PacketKind.START, b"\0"), "does not start to send"),
        (PacketKind.START, packet(PacketKind.START, b"\1"), "no joint state in 0.5 s"),
    ],
)
def test_an_answer_that_is_not_as_the_protocol_has_it_is_named(kind, answer, words):
    with FalseController({kind: answer}) as controller:
        assert words in str(refusal(controller.address, patience=0.5))


def test_what_a_controller_says_in_words_is_passed_on():
    words = b"controller is busy"
    text = packet(PacketKind.TEXT, bytes([len(words)]) + words + b"\0\1")
    with FalseController({PacketKind.OUTPUTS: text}) as controller:
        assert "it said 'controller is busy'" in str(refusal(controller.address, patience=0.3))


@pytest.mark.slow
@given(
    kind=st.sampled_from([k for k in PacketKind if k not in (PacketKind.DATA, PacketKind.PAUSE)]),
    garbage=st.one_of(
        st.binary(max_size=60), st.binary(max_size=60).map(lambda b: packet(PacketKind.DATA, b))
    ),
    wrapped=st.booleans(),
)
@settings(max_examples=60, deadline=None, derandomize=True)
def test_any_answer_leads_to_an_arm_or_to_one_message(kind, garbage, wrapped):
    answer = packet(kind, garbage) if wrapped else garbage
    with FalseController({kind: answer}) as controller:
        words = controller.address
        try:
            RtdeArm(controller.address, patience=0.05, send_program=False).close()
        except OmniservoError as error:
            words = str(error)
        assert words.startswith(controller.address)
        assert "\n" not in words


@pytest.fixture
def running():
    with FalseController() as controller:
        arm = RtdeArm(controller.address, send_program=False)
        yield controller, arm
        arm.close()


def fault_of(arm):
    def heard():
        try:
            arm.read()
        except ServoStop as fault:
            return fault
        return None

    return wait_for(heard)


@pytest.mark.parametrize(
    ("stream", "words"),
    [
        (packet(PacketKind.DATA, b"\1" + bytes(20)), "data of 21 bytes; agreed were"),
        (packet(PacketKind.DATA, b"\1" + bytes(60000)), "data of 60001 bytes"),
        (data()[:3] + b"\7" + data()[4:], "data of recipe 7; agreed was 1"),
        (b"\0\1U", "a packet of 1 bytes"),
        (b"GET / HTTP", "unknown kind 84"),
    ],
)
def test_malformed_data_ends_the_connection_by_name(running, stream, words):
    controller, arm = running
    controller.say(stream)
    fault = fault_of(arm)
    assert isinstance(fault, ConnectionLost)
    assert words in str(fault)


@pytest.mark.parametrize("name", ["actual_q", "actual_qd"])
@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_joints_that_are_no_numbers_are_a_fault(running, name, value):
    controller, arm = running
    controller.say(data(timestamp=100.1, **{name: [0.0] * 5 + [value]}))
    assert isinstance(fault_of(arm), NotFinite)


def test_a_stamp_that_is_no_number_is_a_fault(running):
    controller, arm = running
    controller.say(data(timestamp=math.nan))
    assert isinstance(fault_of(arm), NotFinite)


@pytest.mark.slow
def test_a_controller_that_falls_silent_is_lost(running):
    _, arm = running
    assert "silent for 2.0 s" in str(fault_of(arm))


@pytest.mark.parametrize(
    ("says", "mode"),
    [
        ({"safety_mode": 3}, ArmMode.PROTECTIVE_STOP),
        ({"safety_status_bits": 0b101}, ArmMode.PROTECTIVE_STOP),
        ({"safety_mode": 5}, ArmMode.PROTECTIVE_STOP),
        ({"safety_mode": 9}, ArmMode.PROTECTIVE_STOP),
        ({"safety_mode": 99}, ArmMode.PROTECTIVE_STOP),
        ({"safety_mode": 6}, ArmMode.EMERGENCY_STOP),
        ({"safety_mode": 7}, ArmMode.EMERGENCY_STOP),
        ({"safety_status_bits": 0b1000_0001}, ArmMode.EMERGENCY_STOP),
        ({"robot_mode": 5}, ArmMode.NOT_IN_CONTROL),
        ({"runtime_state": 4}, ArmMode.NOT_IN_CONTROL),
        ({"safety_mode": 2, "safety_status_bits": 0b10}, ArmMode.READY),
        ({}, ArmMode.READY),
    ],
)
def test_every_state_of_the_controller_has_its_mode(running, says, mode):
    """The program's steps go on all the while."""
    controller, arm = running
    for k in range(1, 4):
        controller.say(data(timestamp=100.0 + k, **{"runtime_state": 2, "output_int_register_25": k} | says))
    newest = wait_for(lambda: arm.read() if arm.clock._newest == 103.0 else None)
    assert newest.mode == mode


def test_a_program_whose_steps_stand_still_is_not_ours(running):
    controller, arm = running
    for k, stamp in ((1, 100.1), (2, 100.2), (2, 100.25)):
        controller.say(data(timestamp=stamp, runtime_state=2, output_int_register_25=k))
    wait_for(lambda: arm.read().mode == ArmMode.READY)
    controller.say(data(timestamp=100.35, runtime_state=2, output_int_register_25=2))
    wait_for(lambda: arm.read().mode == ArmMode.NOT_IN_CONTROL)


@given(
    packets=st.lists(
        st.one_of(
            st.binary(max_size=40),
            st.tuples(st.sampled_from(list(PacketKind)), st.binary(max_size=60)).map(
                lambda each: packet(*each)
            ),
        ),
        max_size=5,
    )
)
@settings(max_examples=60, deadline=None, derandomize=True)
def test_the_stand_in_outlives_whatever_clients_send(any_stand_in, packets):
    line = socket.create_connection(("127.0.0.1", any_stand_in.ports.rtde))
    line.sendall(b"".join(packets))
    line.close()


def test_and_serves_the_next_one(any_stand_in):
    with socket.create_connection(("127.0.0.1", any_stand_in.ports.rtde)) as line:
        line.sendall(packet(PacketKind.INPUTS, b"input_int_register_24"))
        assert line.recv(9) == packet(PacketKind.INPUTS, b"\1INT32")
        line.sendall(packet(PacketKind.DATA, b"\1\0"))
        said = line.recv(4096)
        assert said[2] == PacketKind.TEXT
        assert b"data of 2 bytes; agreed were 5" in said
        line.sendall(packet(PacketKind.OUTPUTS, struct.pack(">d", 600.0) + b"timestamp"))
        assert line.recv(4096) == packet(PacketKind.OUTPUTS, b"\0DOUBLE")


def test_opening_and_closing_write_standstill_and_nothing_else(running):
    controller, arm = running
    arm.close()
    standstill = b"\1" + bytes(4 + 6 * 8)
    wait_for(lambda: len(controller.inputs) >= 2)
    assert controller.inputs == [standstill] * 2


def test_steps_that_were_counted_before_are_none_of_a_program_that_runs_now():
    started = packet(PacketKind.START, b"\1") + data(runtime_state=2, output_int_register_25=5)
    with FalseController({PacketKind.START: started}) as controller:
        arm = RtdeArm(controller.address, send_program=False)
        assert arm.read().mode == ArmMode.NOT_IN_CONTROL
        arm.close()


def test_old_controllers_are_asked_for_what_they_can():
    version = packet(PacketKind.CONTROLLER, struct.pack(">4I", 3, 15, 0, 0))
    with FalseController({PacketKind.CONTROLLER: version}) as controller:
        stream = RtdeStream("127.0.0.1", controller.listener.port, 5.0)
        assert stream.rate == 125.0
        stream.close()


def test_a_controller_that_no_longer_reads_is_lost_and_not_waited_for():
    with FalseController() as controller:
        stream = RtdeStream("127.0.0.1", controller.listener.port, 5.0)
        controller.answers[PacketKind.DATA] = b"x" * 10_000  # it writes, is not read, and so reads no more
        with pytest.raises(ConnectionLost, match="no longer reads|temporarily unavailable"):
            for _ in range(100_000):
                stream.send(PacketKind.DATA, bytes(1000))
        stream.close()
