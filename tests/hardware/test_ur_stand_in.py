"""The stand-in of a UR controller passes the compiled clients of `ur_rtde`, which know nothing of ours."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from tests.hardware.wall_clock_arm import WallClockArm

from omniservo.hardware.rtde.server import UrPorts, UrStandIn

JUDGE = Path(__file__).with_name("ur_rtde_judge.py")


def own_address():
    """Return an address of the loop-back device that no other process of these tests takes."""
    number = os.getpid()
    return f"127.{number >> 16 & 0x7F}.{number >> 8 & 0xFF}.{2 + (number & 0xFF) % 250}"


@pytest.mark.slow
@pytest.mark.parametrize("registers", ["lower", "upper"])
@pytest.mark.skipif(sys.platform != "linux", reason="other systems have one address of the loop-back device")
def test_ur_rtde_reads_moves_stops_and_is_watched(registers):
    pytest.importorskip("rtde_control", reason="ur-rtde has no wheel for this system")
    arm, host = WallClockArm(), own_address()
    with UrStandIn(arm, host, UrPorts()) as stand_in:
        done = subprocess.run(
            [sys.executable, str(JUDGE), host, registers],
            capture_output=True,
            text=True,
            timeout=300,
            check=False,
        )
        assert (done.returncode, done.stderr) == (0, "")
        seen = json.loads(done.stdout)
        assert stand_in.refused == []
    assert seen.pop("joints") == [0.0, -1.5, 1.5, -1.5, -1.5, 0.0]
    assert seen.pop("modes") == [7, 1, 1]
    assert seen.pop("bits") == [1, 1]
    assert seen.pop("speeds") == [0.1, -0.2, 0.3, 0.0, 0.0, -0.1]
    assert len(seen) == 9
    assert all(value is True for value in seen.values()), seen
    assert np.array_equal(arm.speeds, np.zeros(6))
