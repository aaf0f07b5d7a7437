"""What the ROS 2 adapter is made of: reference motion, trajectories, joint names, networks."""

import time

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicHermiteSpline

from omniservo.errors import InputError, NotFinite
from omniservo.hardware.ros2.commands import HOLD, TrajectoryCommands
from omniservo.hardware.ros2.endpoints import FOREVER, Endpoint, why_apart
from omniservo.hardware.ros2.joint_states import JointStates
from omniservo.hardware.ros2.network import DdsNetwork
from omniservo.hardware.ros2.reference_motion import ReferenceMotion
from omniservo.hardware.ros2.trajectory_follower import TrajectoryFollower
from omniservo.ros_messages.messages import (
    DurationMessage,
    HeaderMessage,
    JointStateMessage,
    JointTrajectoryMessage,
    JointTrajectoryPointMessage,
    TimeMessage,
)

NAMES = ("a", "b", "c")
speeds = st.lists(st.floats(-3, 3), min_size=3, max_size=3).map(np.array)
limits = st.lists(st.floats(0.2, 20), min_size=3, max_size=3).map(np.array)


@settings(max_examples=100, deadline=None)
@given(speeds, limits, st.sampled_from([0.0, HOLD]))
def test_a_reference_keeps_its_velocity_then_rests_within_the_accelerations(v, a, hold):
    motion = ReferenceMotion(10.0, np.array([0.1, 0.2, 0.3]), v, hold, a)
    times = np.linspace(10.0, motion.end + 0.1, 400)
    positions, velocities = (np.array(rows) for rows in zip(*(motion.at(t) for t in times), strict=True))
    assert np.allclose(velocities[times < 10.0 + hold], v)
    assert np.abs(velocities[times > motion.end]).max() < 1e-12
    step = times[1] - times[0]
    assert (np.abs(np.diff(velocities, axis=0)) <= a * step * (1 + 1e-6) + 1e-9).all()
    between = 0.5 * (velocities[1:] + velocities[:-1]) * step
    assert np.allclose(np.diff(positions, axis=0), between, atol=a.max() * step**2)
    assert np.allclose(positions[0], [0.1, 0.2, 0.3])
    if np.abs(v).max() > 1e-3:  # one joint brakes as fast as it may
        assert (np.abs(v) / motion.braking >= a * (1 - 1e-9)).any()


@settings(max_examples=60, deadline=None)
@given(speeds, limits, st.sampled_from([0.0, HOLD]), st.floats(0.0, 1.0))
@example(np.array([0.0, 0.0, 0.591796875]), np.array([1.0, 1.0, 11.15625]), 0.0, 0.0031308)
def test_a_trajectory_is_the_rest_of_the_motion_between_its_points_too(v, a, hold, since):
    """Cubics through the points are what a controller makes of them."""
    motion = ReferenceMotion(10.0, np.zeros(3), v, hold, a)
    now = 10.0 + since
    message = TrajectoryCommands().message(motion, now, 77.5, np.zeros(3), NAMES)
    assert message.joint_names == list(NAMES)
    assert message.header.stamp.seconds == (77.5 if hold else 0.0)  # a stop begins on arrival
    times = np.array([point.time_from_start.seconds for point in message.points])
    assert (np.diff(times) > 0).all()
    assert times[0] == 0.0
    assert times[-1] >= HOLD - 1e-9
    assert not message.points[-1].velocities.any()
    curve = CubicHermiteSpline(
        times, *([getattr(p, n) for p in message.points] for n in ("positions", "velocities"))
    )
    for t in np.linspace(0.0, min(times[-1], max(motion.end - now, 0.0)), 9):
        # where rest begins within 0.1 ms of another point it has none of its own
        assert np.allclose(curve(t), motion.at(now + t)[0], atol=2e-5)


def test_trajectories_without_stamps_begin_on_arrival():
    motion = ReferenceMotion(10.0, np.zeros(3), np.ones(3), HOLD, np.ones(3))
    message = TrajectoryCommands(stamped=False).message(motion, 10.0, 77.5, np.zeros(3), NAMES)
    assert message.header.stamp.seconds == 0.0


def trajectory(times, positions, velocities, names=NAMES):
    points = [
        JointTrajectoryPointMessage(np.array(p), np.array(v), time_from_start=DurationMessage.of(t))
        for t, p, v in zip(times, positions, velocities, strict=True)
    ]
    return JointTrajectoryMessage(HeaderMessage(), list(names), points)


def test_the_stand_in_goes_by_the_cubics_between_points_and_from_where_it_was():
    times, p = [0.5, 1.0, 2.0], np.array([[0.1, 0.2, 0.3], [0.3, 0.1, 0.5], [0.4, 0.0, 0.2]])
    v = np.array([[0.2, -0.1, 0.3], [0.5, -0.2, -0.2], [0.0, 0.0, 0.0]])
    follower = TrajectoryFollower(NAMES)
    assert follower.at(3.0) is None
    here, going = np.array([0.0, 0.3, 0.2]), np.array([0.1, 0.0, 0.1])
    order = [2, 0, 1]
    shuffled = trajectory(times, p[:, order], v[:, order], [NAMES[i] for i in order])
    assert follower.take(shuffled, 100.0, 100.0, here, going) == ""
    curve = CubicHermiteSpline([0.0, *times], [here, *p], [going, *v])
    for t in np.linspace(0.0, 2.0, 41):
        positions, velocities = follower.at(100.0 + t)
        assert np.allclose(positions, curve(t))
        assert np.allclose(velocities, curve(t, 1), atol=1e-9)
    assert np.array_equal(follower.at(102.5)[0], p[-1])
    assert not follower.at(102.5)[1].any()


Z, ONE = [0.0, 0.0, 0.0], [1.0, 1.0, 1.0]


@pytest.mark.parametrize(
    ("message", "words"),
    [
        (trajectory([1], [Z], [Z], "abd"), "joints"),
        (trajectory([1], [Z], [ONE]), "does not end at rest"),
        (trajectory([1, 1], [Z, Z], [Z, Z]), "do not increase"),
        (trajectory([1], [[np.nan, 0, 0]], [Z]), "not finite"),
        (trajectory([1], [[0, 0]], [Z]), "not all of 3"),
        (trajectory([], [], []), "0 points"),
        (trajectory([-2], [Z], [Z]), r"ended 2\.000 s ago"),
    ],
)
def test_the_stand_in_refuses_what_the_controller_does_and_keeps_its_trajectory(message, words):
    follower = TrajectoryFollower(NAMES)
    follower.take(trajectory([1], [ONE], [Z]), 100.0, 100.0, np.zeros(3), np.zeros(3))
    assert pytest.importorskip("re").search(
        words, follower.take(message, 100.0, 100.0, np.zeros(3), np.zeros(3))
    )
    assert np.array_equal(follower.at(101.0)[0], ONE)


def state(stamp, names="cab", position=(3.0, 1.0, 2.0), velocity=(30.0, 10.0, 20.0)):
    header = HeaderMessage(TimeMessage.of(stamp))
    return JointStateMessage(header, list(names), np.array(position), np.array(velocity))


def test_states_are_ordered_by_name_and_by_stamp():
    states = JointStates(NAMES)
    first = states.take(state(5.0), 105.0)
    assert first.time == 105.0
    assert first.joint_positions.tolist() == [1.0, 2.0, 3.0]
    assert first.joint_velocities.tolist() == [10.0, 20.0, 30.0]
    assert states.take(state(4.99), 105.01) is None
    again = states.take(state(5.02, "xbac", (9.0, 2.0, 1.0, 3.0), ()), 105.02)
    assert again is None  # velocities are differences, of two at least
    third = states.take(state(5.03, "xbac", (9.0, 2.1, 1.0, 3.0), ()), 105.03)
    assert third.joint_velocities == pytest.approx([0.0, 10.0, 0.0])
    assert third.time == pytest.approx(105.03, abs=1e-6)


def test_messages_without_names_are_nobodys():
    states = JointStates(NAMES)
    assert states.take(state(5.0, "", (), ()), 105.0) is None
    assert states.take(state(5.01, "", (), ()), 105.01) is None
    assert states.take(state(5.02, velocity=()), 105.02) is None
    assert states.take(state(5.03, velocity=()), 105.03).joint_positions.tolist() == [1.0, 2.0, 3.0]


def test_velocities_that_are_all_nan_are_none():
    """joint_state_broadcaster says so of joints whose hardware has positions alone."""
    states, none = JointStates(NAMES), (np.nan, np.nan, np.nan)
    assert states.take(state(5.0, velocity=none), 105.0) is None
    moved = states.take(state(5.01, position=(3.0, 1.0, 2.1), velocity=none), 105.01)
    assert moved.joint_velocities == pytest.approx([0.0, 10.0, 0.0])
    with pytest.raises(NotFinite, match="'c' is at 3.0 rad, turning by nan rad/s"):
        states.take(state(5.02, velocity=(np.nan, 10.0, 20.0)), 105.02)


def test_what_is_missing_is_named_beside_what_is_there():
    states = JointStates(("shoulder", "elbow"))
    assert states.take(state(1.0, ("sholder", "elbow", "wrist")), 1.0) is None
    assert states.passed_over == "no 'shoulder' among ('sholder', 'elbow', 'wrist')"
    assert states.missing() == (
        "joint_names: the arm has no 'shoulder'; did you mean 'sholder'?; it has sholder, elbow, wrist"
    )
    assert states.take(state(2.0, ("shoulder", "x", "y")), 2.0) is None
    assert "never all in one message" in states.missing()


def endpoint(**given):
    fields = {"key": "1", "topic": "/t", "ros_type": "p/msg/T", "reliable": True, "transient": False}
    return Endpoint(**{**fields, "deadline": FOREVER, "type_hash": "", **given})


@pytest.mark.parametrize(
    ("their", "own", "role", "words"),
    [
        (endpoint(), endpoint(), "publishes", ""),
        (
            endpoint(reliable=False),
            endpoint(),
            "publishes",
            "this program requests reliable, the publisher offers best",
        ),
        (endpoint(), endpoint(reliable=False), "publishes", ""),
        (endpoint(transient=True), endpoint(), "publishes", ""),
        (endpoint(transient=True), endpoint(), "subscribes to", "the subscriber requests transient local"),
        (endpoint(), endpoint(transient=True), "publishes", "this program requests transient local"),
        (
            endpoint(deadline=10**8),
            endpoint(),
            "subscribes to",
            "the subscriber requests a deadline of 0.1 s",
        ),
        (endpoint(ros_type="p/msg/U"), endpoint(), "publishes", "/t is of p/msg/U, and not of p/msg/T"),
        (endpoint(type_hash="RIHS01_ab"), endpoint(), "publishes", ""),
        (
            endpoint(type_hash="RIHS01_ab"),
            endpoint(type_hash="RIHS01_cd"),
            "publishes",
            "p/msg/T is defined otherwise there: RIHS01_ab…, here RIHS01_cd…",
        ),
    ],
)
def test_why_two_do_not_find_together(their, own, role, words):
    said = why_apart("/t", "p/msg/T", own, [their], [their], role)
    assert said.startswith("/t") == bool(words)
    assert words in said


def test_what_is_wrong_with_a_network_is_named(monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", "17")
    assert DdsNetwork().domain_id == 17
    assert DdsNetwork(3).domain_id == 3
    for wrong, words in (({"domain": 233}, "domain: 233"), ({"domain": "x"}, "domain: 'x'")):
        with pytest.raises(InputError, match=words):
            DdsNetwork(**wrong)
    for wrong, words in (({"interface": 'lo"/>'}, "interface"), ({"peers": ("a b",)}, "peers")):
        with pytest.raises(InputError, match=words):
            DdsNetwork(**wrong)
    monkeypatch.setenv("ROS_DOMAIN_ID", "-1")
    with pytest.raises(InputError, match="ROS_DOMAIN_ID: '-1' given; legal: 0 to 232"):
        DdsNetwork()


def test_who_came_and_went_between_two_looks_is_not_there():
    pytest.importorskip("cyclonedds", reason="no wheel of Cyclone DDS for this platform")
    from omniservo.hardware.ros2.node import RosNode

    network = DdsNetwork.localhost(211)
    here = RosNode(network)
    stays, goes = here.publish("/t", JointStateMessage), RosNode(network)
    goes.publish("/t", JointStateMessage)
    goes.close()
    end = time.monotonic() + 30.0
    while here.endpoints.publishers("/t") == []:
        assert time.monotonic() < end
    (left,) = here.endpoints.publishers("/t")
    assert (left.key, left.type_hash) == (stays.key, JointStateMessage.type_hash)
    here.close()


def test_a_domain_is_configured_once_and_no_network_of_another_name_is_found():
    pytest.importorskip("cyclonedds", reason="no wheel of Cyclone DDS for this platform")
    from omniservo.errors import ConnectionLost
    from omniservo.hardware.ros2.node import RosNode

    RosNode(DdsNetwork.localhost(211)).close()
    RosNode(DdsNetwork.localhost(211)).close()
    with pytest.raises(
        InputError, match="domain 211 on lo: this program uses this domain with another interface"
    ):
        RosNode(DdsNetwork(211, "lo"))
    with pytest.raises((InputError, ConnectionLost), match="domain 212 on nowhere0"):
        RosNode(DdsNetwork(212, "nowhere0"))
