"""The newest frame of any reader: never an older one; what becomes of wrong stamps and of failures."""

import time
from threading import Event

import numpy as np
import pytest
from tests.hardware.wall_clock_arm import PATIENCE, wait_for

from omniservo.errors import ClockFault, InvalidData
from omniservo.hardware.camera_sources import NewestFrame, newest_frame
from omniservo.hardware.camera_sources.frame_reader import Frame, FrameLoss, StampClock


class BeatingReader:
    """Frames at 50 Hz, stamped with their instant plus `shift`, which may be set."""

    def __init__(self, clock=StampClock.SENDER, is_live=True):
        self.clock, self.is_live, self.shift, self.count, self.failure = clock, is_live, 0.0, 0, None
        self.begin, self.ended = time.monotonic(), Event()

    def read(self):
        self.count += 1
        due = self.begin + self.count / 50.0
        if self.ended.wait(max(due - time.monotonic(), 0.0)):
            raise FrameLoss("closed")
        if self.failure is not None:
            raise self.failure
        return Frame(np.zeros((2, 2), np.uint8), due + self.shift, max(due, time.monotonic()))

    def hang_up(self):
        self.ended.set()

    def close(self):
        pass


@pytest.fixture
def opened():
    cameras = []

    def make(reader):
        cameras.append(NewestFrame("beat", lambda: reader, patience=PATIENCE))
        return cameras[-1]

    yield make
    for camera in cameras:
        camera.close()


def fault_of(camera, kind):
    def heard():
        try:
            camera.image()
        except kind as fault:
            return str(fault)
        return None

    return wait_for(heard)


def test_a_frame_of_an_earlier_instant_is_not_shown(opened):
    reader = BeatingReader(StampClock.OWN, is_live=False)
    camera = opened(reader)
    reader.shift = -0.5
    count = reader.count
    wait_for(lambda: reader.count > count + 5)
    shown = camera.image()
    wait_for(lambda: reader.count > count + 10)
    assert camera.image() is shown
    reader.shift = 0.0
    wait_for(lambda: camera.image().time > shown.time)


@pytest.mark.slow
@pytest.mark.parametrize("step", [3.0, -30.0])
def test_stamps_that_prove_to_be_none_soon_after_opening_are_left_aside(opened, monkeypatch, step):
    monkeypatch.setattr(newest_frame, "TRIAL", 1e9)
    reader = BeatingReader()
    camera = opened(reader)
    assert camera.notice.startswith("exposure is the sender's time stamp")
    wait_for(lambda: reader.count > 60)  # the clock's map has settled
    reader.shift = step
    wait_for(lambda: "time stamps that do not keep time are left aside" in camera.notice)
    before = camera.image().time
    wait_for(lambda: camera.image().time > before)
    assert camera.image().time <= time.monotonic()


@pytest.mark.slow
def test_a_clock_that_is_set_later_is_a_fault(opened, monkeypatch):
    monkeypatch.setattr(newest_frame, "TRIAL", 0.0)
    reader = BeatingReader()
    camera = opened(reader)
    wait_for(lambda: reader.count > 60)
    reader.shift = 3.0
    assert fault_of(camera, ClockFault).startswith("beat: ")


def test_what_a_reader_does_unforeseen_is_a_fault_and_named(opened):
    reader = BeatingReader()
    camera = opened(reader)
    reader.failure = RuntimeError("the driver crashed")
    assert fault_of(camera, InvalidData) == "beat: RuntimeError('the driver crashed')"
