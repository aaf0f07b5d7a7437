"""The drive process over real processes: what it follows, what stops it, and that nothing moves it then."""

import os
import pickle
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from tests.drive.faulty_arm import MOUNT, Clockwork, FaultyArm, Nowhere, Renamed, Staying, Unwatched, log_of

from omniservo.drive import ArmOpener, DeadlinePassed, DriveClient, Phase
from omniservo.drive.messages import DriveCommand
from omniservo.errors import (
    ClockFault,
    ConnectionLost,
    InputError,
    InvalidData,
    NotFinite,
    ServoStop,
    StaleImage,
)
from omniservo.robots import Arm, CameraImage
from omniservo.safety import SafetyOptions

SIDEWAYS = np.array([0.03, 0.0, 0.0, 0.0, 0.0, 0.0])
PATIENT = {"joint_age": 2.0, "reaction": 2.0, "image_age": 5.0}
"""for machines that do much besides; that the limits hold is shown in simulated time"""


def until(condition, seconds=60.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(2e-3)


@pytest.fixture
def opened(tmp_path):
    clients = []

    def make(kind=FaultyArm, camera=None, *, options=None, **others):
        arguments = {"address": "nowhere:1"} if kind is Nowhere else {"folder": str(tmp_path)}
        clients.append(
            DriveClient(
                ArmOpener(kind, arguments), Arm.rx60(), MOUNT, camera=camera or Clockwork(),
                options=SafetyOptions(**(PATIENT | (options or {}))), **({"command_life": 1.0} | others),
            )
        )  # fmt: skip
        return clients[-1]

    yield make
    for client in clients:
        client.close()


def lead(client, seconds, twist=SIDEWAYS):
    """Lead the camera on for so long."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        client.image()
        client.carry(twist)
        client.wait(0.02)


def led_until_stopped(client, seconds=60.0):
    with pytest.raises(ServoStop) as stop:
        lead(client, seconds)
    until(lambda: client.status.phase is Phase.STOPPED)
    return stop.value


def stays_stopped(client, tmp_path):
    """Nothing but zeros and stops reach the arm from here on, whatever is asked for."""
    count = len(log_of(tmp_path))
    reason = client.stopped.reason
    for _ in range(3):
        with pytest.raises(ServoStop, match="stopped before"):
            client.carry(SIDEWAYS)
        with pytest.raises(ServoStop, match="stopped before"):
            client.command(np.full(6, 0.1))
    with pytest.raises(ServoStop, match="stopped before"):
        client.enable()
    until(lambda before=client.status.time: client.status.time > before + 0.1)
    later = log_of(tmp_path)[count:]
    assert not any(any(numbers) for _, what, numbers in later if what == "command")
    assert client.stopped.reason == reason


def test_it_listens_is_armed_moves_and_brakes(opened, tmp_path):
    client = opened()
    assert client.status.phase is Phase.LISTENING
    assert [what for _, what, _ in log_of(tmp_path)] == ["open"]
    with pytest.raises(InputError, match="enable"):
        client.carry(SIDEWAYS)
    client.enable()
    zeros = [numbers for _, what, numbers in log_of(tmp_path) if what == "command"]
    assert len(zeros) > 3
    assert not np.any(zeros)
    begin = client.read()
    lead(client, 0.5)
    assert client.status.phase is Phase.MOVING
    state = client.read()
    moved = client.arm.base_T_flange(begin.joint_positions) * MOUNT
    now = client.arm.base_T_flange(state.joint_positions) * MOUNT
    gone = (moved.inv() * now).translation
    assert gone[0] > 5e-3
    assert np.abs(gone[1:]).max() < 0.1 * gone[0]
    client.stop()
    assert client.status.phase is Phase.ARMED
    lead(client, 0.1)
    client.stop()
    client.close()
    stopped, closed = log_of(tmp_path)[-2:]
    assert (stopped[1], closed[1]) == ("stop", "close")
    assert np.abs(closed[2]).max() < 2e-3


@pytest.mark.slow
def test_a_file_of_the_working_folder_is_no_part_of_the_drive_process(opened, tmp_path, monkeypatch):
    (tmp_path / "pickle.py").write_text("raise RuntimeError('not yours')")
    monkeypatch.chdir(tmp_path)
    assert opened().status.phase is Phase.LISTENING


@pytest.mark.slow
def test_an_arm_that_does_not_stand_by_zeros_is_not_armed(opened, tmp_path):
    (tmp_path / "fault").write_text("second_commander")
    client = opened(patience=20.0)
    with pytest.raises(ServoStop):
        client.enable()
    assert client.status.phase not in (Phase.ARMED, Phase.MOVING)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "error", "words"), [(Unwatched, InputError, "watchdog"), (Nowhere, ConnectionLost, "nowhere:1")]
)
def test_what_cannot_be_driven_is_refused_before_anything_moves(opened, tmp_path, kind, error, words):
    with pytest.raises(error, match=words):
        opened(kind)
    if kind is not Nowhere:
        assert [what for _, what, _ in log_of(tmp_path)] == ["open", "close"]


def test_an_arm_of_other_joints_is_closed_and_refused(tmp_path):
    with pytest.raises(InputError, match="joint_names"):
        ArmOpener(Renamed, {"folder": str(tmp_path)}).open(Arm.rx60())
    assert [what for _, what, _ in log_of(tmp_path)] == ["open", "close"]


def test_a_watchdog_may_be_stated(tmp_path):
    ArmOpener(Unwatched, {"folder": str(tmp_path)}, watchdog=0.2).open(Arm.rx60()).close()


def test_what_another_process_cannot_be_told_is_no_opener():
    with pytest.raises(InputError, match="opener"):
        ArmOpener(lambda: None)


@pytest.mark.slow
def test_the_drive_process_loads_nothing_that_reads_images_or_draws():
    code = (
        "import sys, omniservo.drive.main\n"
        "print([m for m in ('cv2', 'matplotlib', 'PIL', 'omniservo.perception') if m in sys.modules])"
    )
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert told.stdout.strip() == "[]"


@pytest.mark.slow
@pytest.mark.parametrize("kind", [signal.SIGKILL, signal.SIGTERM])
def test_a_drive_process_that_ends_is_a_lost_connection(opened, kind):
    client = opened()
    client.enable()
    lead(client, 0.2)
    os.kill(client.process_id, kind)
    with pytest.raises(ConnectionLost):
        lead(client, 60.0)
    with pytest.raises(ConnectionLost):
        client.carry(SIDEWAYS)


@pytest.mark.slow
def test_a_new_connection_leaves_the_workspace_where_it_was(opened, tmp_path):
    client = opened(Staying, options={"workspace": np.array([[-0.05] * 3, [0.05] * 3]), "reaction": 0.5})

    def camera():
        return client.arm.base_T_flange(client.read().joint_positions) * MOUNT

    begin = camera()
    client.enable()
    lead(client, 0.7)
    (tmp_path / "fault").write_text("lost")
    assert led_until_stopped(client).reason == "connection"
    with pytest.raises(ConnectionLost, match="the cable is out"):  # as it still is
        client.release("connection")
    (tmp_path / "fault").unlink()
    client.release("connection")
    client.enable()
    assert led_until_stopped(client).reason == "workspace"
    assert 0.025 < (begin.inv() * camera()).translation[0] < 0.05


@pytest.fixture
def leader(tmp_path):
    """A process that leads, and the id of its drive process."""
    env = os.environ | {"PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    process = subprocess.Popen(
        [sys.executable, "-m", "tests.drive.leader", str(tmp_path)],
        stdout=subprocess.PIPE,
        env=env,
        text=True,
    )
    for _ in range(10):
        words = process.stdout.readline().split()
        assert words[0] == "moving"
    yield process, int(words[1])
    process.kill()
    process.wait()
    process.stdout.close()


def came_to_rest(tmp_path):
    """Return whether the arm is led down to rest and let go of, by the log alone."""
    entries = log_of(tmp_path)
    return entries[-1][1] == "close"


@pytest.mark.slow
@pytest.mark.parametrize("kind", [signal.SIGKILL, signal.SIGSTOP, signal.SIGTERM])
def test_a_leader_that_is_gone_or_hangs_leaves_an_arm_at_rest(leader, tmp_path, kind):
    process, _ = leader
    moving = [numbers for _, what, numbers in log_of(tmp_path) if what == "command"][-1]
    assert np.any(moving)
    process.send_signal(kind)
    if kind is signal.SIGSTOP:
        until(lambda: any(what == "stop" for _, what, _ in log_of(tmp_path)))
        process.send_signal(signal.SIGCONT)  # its late commands are not followed
        assert process.wait(60.0) != 0
    until(lambda: came_to_rest(tmp_path))
    entries = log_of(tmp_path)
    first = next(k for k, (_, what, _) in enumerate(entries) if what == "stop")
    assert not any(np.any(numbers) for _, what, numbers in entries[first:] if what == "command")
    last = np.array([numbers for _, what, numbers in entries if what == "command"][-2:])
    assert not last[-1].any()
    assert np.abs(entries[-1][2]).max() < 2e-3


@pytest.mark.slow
def test_a_drive_that_slept_does_not_go_on(leader, tmp_path):
    process, drive = leader
    os.kill(drive, signal.SIGSTOP)
    process.wait(60.0)  # its commands are not answered
    count = len(log_of(tmp_path))
    os.kill(drive, signal.SIGCONT)
    until(lambda: came_to_rest(tmp_path))
    later = log_of(tmp_path)[count:]
    sent = [np.abs(numbers).max() for _, what, numbers in later if what == "command"]
    assert (np.diff([1e9, *sent]) <= 0.0).all()
    moves = [what for _, what, numbers in later if what == "stop" or (what == "command" and np.any(numbers))]
    last = moves[-1]
    assert last == "stop"  # whatever was on its way when it slept, rest came after it


def test_an_arm_is_told_of_by_its_file():
    arm = pickle.loads(pickle.dumps(Arm.rx60()))  # noqa: S301
    assert arm.joint_names == Arm.rx60().joint_names
    joints = np.full(6, 0.3)
    there = Arm.rx60().base_T_flange(joints).as_matrix()
    np.testing.assert_array_equal(arm.base_T_flange(joints).as_matrix(), there)
    assert ClockFault.reason == "clock_fault"


@pytest.fixture(scope="module")
def camera():
    return Clockwork()


@pytest.fixture(scope="module")
def kept(tmp_path_factory, camera):
    """A drive for all tests after which it can go on, and its arm's folder.

    They stand last: a process starts in seconds, and listens as long as this module has tests.
    """
    folder = tmp_path_factory.mktemp("kept")
    client = DriveClient(
        ArmOpener(FaultyArm, {"folder": str(folder)}), Arm.rx60(), MOUNT, camera=camera,
        options=SafetyOptions(**(PATIENT | {"joint_age": 1.5})), command_life=2.0,
    )  # fmt: skip
    yield client, folder
    client.close()


@pytest.fixture
def listening(kept):
    """It listens, before and after each test."""
    client, folder = kept
    assert client.status.phase is Phase.LISTENING
    yield client, folder
    (folder / "fault").unlink(missing_ok=True)
    client.stop(ServoStop("the next test"))
    client.release(client.stopped.reason)


@pytest.mark.slow
def test_what_was_measured_and_sent_is_known_here_too(listening):
    client, _ = listening
    client.enable()
    lead(client, 0.5)
    client.stop()
    q, sent, _ = client.history.at(np.array([client.history.time - 0.2, client.history.time]))
    np.testing.assert_allclose(q[1], client.read().joint_positions, atol=2e-3)
    assert np.abs(sent[1] - sent[0]).max() > 0.0
    assert client.history.time <= time.monotonic()


def test_joint_velocities_too_and_what_became_of_them_is_told(listening):
    client, _ = listening
    client.enable()
    passed = client.command([0, 0, 0, 0, 0, 100.0])
    assert passed.wanted[5] == 100.0
    assert "joint_speed" in passed.limits
    assert 0.0 < passed.target[5] < 100.0
    until(lambda: client.status.joints[2, 5] > 0.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "reason"),
    [
        ("frozen", "stale_joints"),
        ("nan", "not_finite"),
        ("short", "invalid_data"),
        ("timeless", "invalid_data"),
        ("other_mode", "invalid_data"),
        ("reordered", "not_following"),
        ("clock_back", "clock_fault"),
        ("clock_ahead", "clock_fault"),
        ("clock_set", "clock_fault"),
        ("protective_stop", "protective_stop"),
        ("emergency_stop", "protective_stop"),
        ("not_in_control", "not_in_control"),
        ("lost", "connection"),
        ("second_commander", "not_following"),
    ],
)
def test_a_fault_of_the_arm_is_a_stop_by_its_name_that_nothing_goes_past(listening, fault, reason):
    client, folder = listening
    client.enable()
    lead(client, 0.3)
    (folder / "fault").write_text(fault)
    assert led_until_stopped(client).reason == reason
    assert np.isfinite(client.history.at(np.array([client.time]))).all()
    stays_stopped(client, folder)
    (folder / "fault").unlink()  # data that are fresh again resume nothing
    stays_stopped(client, folder)
    with pytest.raises(InputError, match=reason):
        client.release("something")
    client.release(reason)
    assert client.status.phase is Phase.LISTENING
    with pytest.raises(InputError, match="enable"):
        client.carry(SIDEWAYS)
    client.enable()
    lead(client, 0.2)


@pytest.mark.parametrize("bad", [[np.nan, 0, 0, 0, 0, 0], [0.0] * 5])
def test_what_is_no_command_brakes(listening, bad):
    client, _ = listening
    client.enable()
    lead(client, 0.2)
    with pytest.raises(InputError):
        client.carry(bad)
    assert client.status.phase is Phase.ARMED
    lead(client, 0.1)
    with pytest.raises(NotFinite if len(bad) == 6 else InputError):
        client.command(bad)


def forced(client):
    """Send a command past the client's own refusal; the drive has dealt with it on return."""
    client.image()
    now = time.monotonic()
    number = client.status.number + 1
    client._send(DriveCommand(number, now, now, now + 30.0, SIDEWAYS, None).packed())
    until(lambda: client.status.number >= number)
    until(lambda before=client.status.time: client.status.time > before + 0.1)


def test_the_drive_itself_moves_nothing_before_it_is_armed_and_after_it_was_released(listening):
    client, folder = listening
    forced(client)
    assert client.status.phase is Phase.LISTENING
    client.enable()
    lead(client, 0.2)
    client.stop(ServoStop("enough"))
    count = len(log_of(folder))
    forced(client)
    client.release("stopped")
    forced(client)
    assert client.status.phase is Phase.LISTENING
    later = [numbers for _, what, numbers in log_of(folder)[count:] if what == "command"]
    assert not np.any(later)


@pytest.mark.slow
def test_a_command_that_none_follows_expires(listening):
    client, folder = listening
    client.enable()
    client.image()
    client.carry(SIDEWAYS)
    until(lambda: client.status.phase is Phase.STOPPED)
    assert isinstance(client.stopped, DeadlinePassed)
    with pytest.raises(DeadlinePassed):
        client.read()
    client.read()  # told once
    stays_stopped(client, folder)


def test_what_stops_a_fast_arm_is_told_once_it_stands(listening, monkeypatch):
    client, _ = listening
    client.enable()
    fast = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 2.0])
    client.image()
    client.command(fast)
    until(lambda: client.status.joints[2, 5] > 1.9)
    monkeypatch.setattr(client, "_life", -1.0)
    with pytest.raises(DeadlinePassed):
        client.command(fast)
    assert client.status.phase is Phase.STOPPED
    assert not client.status.joints[2].any()


def test_before_the_first_image_nothing_moves_and_that_is_said(listening, camera, monkeypatch):
    client, folder = listening
    monkeypatch.setattr(camera, "image", lambda: None)
    monkeypatch.setattr(client, "_seen_at", -np.inf)
    client.enable()
    with pytest.raises(StaleImage, match="no image came yet"):
        client.carry(SIDEWAYS)
    stays_stopped(client, folder)


@pytest.mark.slow
def test_a_drive_that_hangs_gives_no_joints(listening):
    """Else who waits for images by the time of the joints would wait for ever."""
    client, _ = listening
    os.kill(client.process_id, signal.SIGSTOP)
    try:
        with pytest.raises(ConnectionLost, match="does not read a joint within 1 s"):
            until(lambda: client.read() is None)
    finally:
        os.kill(client.process_id, signal.SIGCONT)
    assert client.read() is not None


def test_a_drive_that_hangs_is_a_lost_connection_to_who_only_looks(listening, camera, monkeypatch):
    client, _ = listening
    empty = np.zeros((2, 2), dtype=np.uint8)
    monkeypatch.setattr(camera, "image", lambda: CameraImage(time.monotonic(), empty))
    os.kill(client.process_id, signal.SIGSTOP)
    try:
        with pytest.raises(ConnectionLost, match="hangs"):
            for _ in range(10_000):
                client.image()
    finally:
        os.kill(client.process_id, signal.SIGCONT)
    until(lambda before=client.status.time: client.status.time > before)


def test_words_that_are_no_unicode_stop_all_the_same(listening):
    """Such as the name of a file that another system wrote."""
    client, folder = listening
    client.enable()
    lead(client, 0.2)
    client.stop(ServoStop("no file \udcff.png"))
    assert client.status.phase is Phase.STOPPED
    assert str(client.stopped) == "no file ?.png"
    stays_stopped(client, folder)


def test_a_command_that_comes_after_its_deadline_is_said_not_to_be_followed(listening, monkeypatch):
    client, folder = listening
    client.enable()
    client.image()
    monkeypatch.setattr(client, "_life", -0.01)
    with pytest.raises(DeadlinePassed, match="after its deadline"):
        client.carry(SIDEWAYS)
    stays_stopped(client, folder)


@pytest.mark.slow
def test_images_that_stand_still_stop_it(listening, camera):
    client, folder = listening
    client.enable()
    lead(client, 0.2)
    camera.standing = True
    assert led_until_stopped(client).reason == "stale_image"
    camera.standing = False
    stays_stopped(client, folder)


def test_a_frame_that_is_none_stops_it_from_this_process(listening, camera, monkeypatch):
    client, folder = listening
    client.enable()
    lead(client, 0.2)
    monkeypatch.setattr(camera, "image", lambda: "a picture")
    with pytest.raises(InvalidData):
        client.image()
    assert client.status.phase is Phase.STOPPED
    stays_stopped(client, folder)
