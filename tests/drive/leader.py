"""A process that leads the arm until it is killed: ``python leader.py FOLDER``."""

import sys

import numpy as np
from tests.drive.faulty_arm import MOUNT, Clockwork, FaultyArm

from omniservo.drive import ArmOpener, DriveClient
from omniservo.robots import Arm
from omniservo.safety import SafetyOptions


def main():
    options = SafetyOptions(joint_age=1.0, reaction=1.0, image_age=2.0)
    client = DriveClient(
        ArmOpener(FaultyArm, {"folder": sys.argv[1]}), Arm.rx60(), MOUNT, camera=Clockwork(), options=options,
        command_life=0.5,
    )  # fmt: skip
    client.enable()
    for k in range(3000):
        client.image()
        client.carry(0.02 * np.array([1.0, 0, 0, 0, 0, 0]) * np.cos(0.05 * k))
        print("moving", client.process_id, flush=True)  # noqa: T201
        client.wait(0.03)


if __name__ == "__main__":
    main()
