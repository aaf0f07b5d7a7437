"""Drives a controller by the compiled clients of `ur_rtde`, and prints what they saw as JSON.

A program of its own: the clients wait inside the interpreter's lock, where a server beside them starves.
"""

import json
import sys
import time

import rtde_control
import rtde_receive

PATIENCE = 30.0


def until(condition):
    end = time.monotonic() + PATIENCE
    while not condition():
        if time.monotonic() > end:
            return False
        time.sleep(1e-3)
    return True


def main(host, registers):
    receive = rtde_receive.RTDEReceiveInterface(host, 500.0)
    seen = {
        "joints": receive.getActualQ(),
        "modes": [receive.getRobotMode(), receive.getSafetyMode(), receive.getRuntimeState()],
        "bits": [receive.getRobotStatus(), receive.getSafetyStatusBits()],
    }
    first = receive.getTimestamp()
    seen["stamps go on"] = until(lambda: receive.getTimestamp() > first)
    flags = rtde_control.RTDEControlInterface.FLAG_UPLOAD_SCRIPT
    if registers == "upper":
        flags |= rtde_control.RTDEControlInterface.FLAG_UPPER_RANGE_REGISTERS
    control = rtde_control.RTDEControlInterface(host, 500.0, flags)
    seen["runs"] = control.isProgramRunning()
    before = receive.getActualQ()
    seen["speedJ"] = control.speedJ([0.1, -0.2, 0.3, 0.0, 0.0, -0.1], 5.0, 0.0)
    seen["moves"] = until(lambda: receive.getActualQ()[2] > before[2] + 0.02)
    seen["speeds"] = receive.getActualQd()
    seen["speedStop"] = control.speedStop(10.0)
    seen["stands"] = until(lambda: max(map(abs, receive.getActualQd())) == 0.0)
    seen["watchdog"] = control.setWatchdog(10.0)
    control.speedJ([0.1] * 6, 5.0, 0.0)
    until(lambda: receive.getActualQd()[0] > 0.0)
    seen["silence stops"] = until(lambda: max(map(abs, receive.getActualQd())) == 0.0)
    seen["silence ends the program"] = until(lambda: not control.isProgramRunning())
    sys.stdout.write(json.dumps(seen))
    receive.disconnect()
    control.disconnect()


main(*sys.argv[1:])
