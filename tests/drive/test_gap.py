"""A gap in the images, over two processes on the wall's clock: the drive is told to stand, and goes on."""

import time
from types import SimpleNamespace

import numpy as np
import pytest
from tests.drive.faulty_arm import MOUNT, START, Clockwork, FaultyArm, log_of, scene

from omniservo.drive import ArmOpener, DriveClient, Phase
from omniservo.planning import CameraPath
from omniservo.safety import SafetyOptions, VisibilityFilter, servo
from omniservo.servoing import RestToRestLaw
from omniservo.tracking import PathTracker, TrackerOptions

OPTIONS = SafetyOptions(joint_age=1.0, reaction=1.0, image_age=1.0, patience=60.0, blind_room=0.01)
TARGETS = np.array([[0.62, y, z] for y in (-0.2, -0.1, 0.0) for z in (0.4, 0.5, 0.6)])
ALONG = np.array([0.03, -0.04, 0.02])
BUSY = ("deadline", "connection", "stale_joints", "stale_image", "slow_loop")
"""what a process that waits a second for a processor is stopped for"""


class Points:
    """Where the joints, as they were read, have the points in the newest image."""

    def __init__(self, client, camera):
        self._client, self._camera, self._scene = client, camera, scene()

    def update(self, image, predicted):
        joints = self._client.history.at(np.array([self._camera.given]))[0][0]
        place = self._scene.world_T_camera(joints)
        return self._scene.camera.project(place.inv().apply(TARGETS))


class Gapped(Clockwork):
    """Thirty images a second, but for two seconds after the camera has moved for a while."""

    def __init__(self):
        super().__init__()
        self.given, self.silence = None, (np.inf, np.inf)

    def image(self):
        self.standing = self.silence[0] <= time.monotonic() < self.silence[1]
        image = super().image()
        self.given = image.time
        return image


@pytest.fixture
def driven(tmp_path):
    """Servo along a straight path through the drive process, with a gap of two seconds in mid motion."""
    clients = []

    def go(on_wait):
        for number in range(3):
            folder = tmp_path / str(number)
            folder.mkdir()
            client, tracker, camera, stop = once(on_wait, folder)
            if stop is None or stop.reason not in BUSY:
                break
        return folder, client, tracker, camera, stop

    def once(on_wait, folder):
        camera = Gapped()
        opener = ArmOpener(FaultyArm, {"folder": str(folder)})
        client = DriveClient(opener, scene().arm, MOUNT, camera=camera, options=OPTIONS, command_life=1.0)
        clients.append(client)
        client.enable()
        points = scene().world_T_camera(START).inv().apply(TARGETS)
        still = np.array([[0.0], [0.0], [0.0], [1.0]])
        path = CameraPath(np.hstack((np.zeros((4, 1)), still)), np.column_stack((ALONG, np.zeros(3))))
        plan = SimpleNamespace(path=path, problem=SimpleNamespace(points=points), status="certified")
        tracker = PathTracker(
            plan, scene().camera, options=TrackerOptions(tolerance_px=2.0, settled_frames=3),
            time_law=RestToRestLaw(4.0),
        )  # fmt: skip

        def after(step):
            if tracker.report.w > 0.3 and camera.silence[0] == np.inf:
                now = time.monotonic()
                camera.silence = (now, now + 2.0)

        visibility = VisibilityFilter(scene().camera, options=OPTIONS)
        stop = servo(
            client, tracker, Points(client, camera), visibility, time_limit=120.0, on_step=after,
            on_wait=lambda waiting: on_wait(folder, waiting),
        )  # fmt: skip
        return client, tracker, camera, stop

    yield go
    for client in clients:
        client.close()


@pytest.mark.slow
def test_it_stands_by_commands_while_images_are_missing_and_reaches_the_goal(driven):
    waits = []
    folder, client, tracker, camera, stop = driven(
        lambda _, waiting: waits.append((time.monotonic(), waiting))
    )
    assert stop is None
    (_, stands), (over, _) = [each for each in waits if each[0] > camera.silence[0]][:2]
    assert stands.why.startswith("no new image")
    sent = [(t, np.abs(v).max()) for t, what, v in log_of(folder) if what == "command"]
    assert max(v for t, v in sent if t < camera.silence[0]) > 0.01
    begin, end = camera.silence[0] + 1.2, camera.silence[1]  # older than image_age by then
    resting = [v for t, v in sent if begin < t < end]
    assert len(resting) > 20
    assert max(resting) == 0.0
    assert max(v for t, v in sent if t > over) > 0.01
    assert not any(what == "stop" for t, what, _ in log_of(folder) if t < over)
    assert tracker.report.w == pytest.approx(1.0)
    assert client.stopped is None


@pytest.mark.slow
def test_what_stops_the_arm_while_it_waits_stays(driven):
    def fail(folder, waiting):
        if np.isnan(waiting.until):
            (folder / "fault").write_text("protective_stop")

    folder, client, _, camera, stop = driven(fail)
    assert stop.reason == "protective_stop"
    assert client.status.phase is Phase.STOPPED
    (folder / "fault").unlink()
    end = time.monotonic() + 60.0
    while time.monotonic() < camera.silence[1] + 0.2:
        assert time.monotonic() < end
        client.image()
    assert client.status.phase is Phase.STOPPED
    first = next(t for t, what, _ in log_of(folder) if what == "stop")
    assert not any(np.any(v) for t, what, v in log_of(folder) if what == "command" and t > first)
