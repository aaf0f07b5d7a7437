"""Interoperation with Fast DDS, an independent DDS and the one that ROS 2 runs by default.

Needs `apt-get install libfastrtps-dev fastddsgen` (Debian 12: Fast DDS 2.9) and a C++ compiler. The peer is
compiled once, into the cache.
"""

import hashlib
import os
import shutil
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest
from tests.hardware.served_arm import NAMES

from omniservo.errors import InputError
from omniservo.hardware.ros2.network import DdsNetwork
from omniservo.hardware.ros2.ros2_arm import Ros2Arm
from omniservo.hardware.ros2.ros2_camera import Ros2Camera

pytest.importorskip("cyclonedds", reason="no wheel of Cyclone DDS for this platform")
if shutil.which("fastddsgen") is None or shutil.which("g++") is None:
    pytest.skip("no fastddsgen or no g++ here", allow_module_level=True)

SOURCES = Path(__file__).parent / "fast_dds"
DOMAIN = 1 + (os.getpid() + 50) % 200
HERE = DdsNetwork.localhost(DOMAIN)
PATIENCE = 30.0


def compiled():
    """Return the peer, compiled into the cache for these sources."""
    text = b"".join(path.read_bytes() for path in sorted(SOURCES.iterdir()))
    cache = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "omniservo-tests"
    peer = cache / f"fast-dds-peer-{hashlib.sha256(text).hexdigest()[:16]}"
    if not peer.exists():
        work = cache / f"build-{os.getpid()}"
        work.mkdir(parents=True)
        for path in SOURCES.iterdir():
            shutil.copy(path, work)
        subprocess.run(["fastddsgen", "-replace", "messages.idl"], cwd=work, check=True, capture_output=True)
        made = sorted(path.name for path in work.glob("messages*.cxx"))
        line = ["g++", "-O1", "-std=c++14", "peer.cpp", *made, "-lfastrtps", "-lfastcdr", "-o", "peer"]
        subprocess.run(line, cwd=work, check=True, capture_output=True)
        (work / "peer").rename(peer)
        shutil.rmtree(work)
    return peer


class Peer:
    def __init__(self):
        self.process = subprocess.Popen(
            [compiled(), str(DOMAIN)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        assert self.process.stdout.readline() == "served\n"

    def tell(self):
        """Return commands heard, images sent, and the first joint [rad]."""
        self.process.stdin.write("\n")
        self.process.stdin.flush()
        commands, images, first = self.process.stdout.readline().split()
        return int(commands), int(images), float(first)


@pytest.fixture(scope="module")
def peer():
    made = Peer()
    yield made
    made.process.stdin.close()
    made.process.stdout.close()
    made.process.wait(30)


def test_an_arm_by_fast_dds_goes_as_commanded_and_rests_when_commands_end(peer):
    order = [4, 0, 1, 2, 3, 5]
    arm = Ros2Arm([NAMES[i] for i in order], np.full(6, 2.0), network=HERE, patience=PATIENCE)
    try:
        begin, end = arm.read().joint_positions[1], time.monotonic() + PATIENCE
        sent = 0
        while arm.read().joint_positions[1] < begin + 0.1:
            assert time.monotonic() < end
            arm.command([0.0, 0.2, 0.0, 0.0, 0.0, 0.0])
            sent += 1
            time.sleep(0.005)
        assert peer.tell()[0] >= sent  # and the zeros before them: none was lost
        assert arm.read().joint_velocities[1] == pytest.approx(0.2, abs=0.02)
        while np.abs(arm.read().joint_velocities).max() > 0.0:
            assert time.monotonic() < end
            time.sleep(0.005)
        at_rest = peer.tell()
        assert at_rest[2] > begin + 0.1
        assert peer.tell()[2] == at_rest[2]
        assert np.abs(np.delete(arm.read().joint_positions, 1) - 0.5).max() < 1e-6
    finally:
        arm.close()


def test_images_by_fast_dds_arrive_whole_and_in_time(peer):
    camera = Ros2Camera("/camera/image_raw", network=HERE, patience=PATIENCE)
    try:
        seen, end, ages = {}, time.monotonic() + PATIENCE, []
        while len(seen) < 20:
            assert time.monotonic() < end
            image = camera.image()
            if image.time not in seen:
                ages.append(time.monotonic() - image.time)
                assert image.pixels.shape == (1024, 1024)
                assert image.pixels.min() == image.pixels.max()
                seen[image.time] = int(image.pixels[0, 0])
            time.sleep(0.001)
        counts = np.unwrap(np.array(list(seen.values())), period=256)
        assert (np.diff(counts) >= 1).all()
        assert min(ages) >= 0.0
    finally:
        camera.close()


def test_an_incompatible_quality_of_service_is_named(peer):
    with pytest.raises(InputError, match="this program requests reliable, the publisher offers best effort"):
        Ros2Camera("/camera/image_raw", network=HERE, patience=2.0, reliable=True)
