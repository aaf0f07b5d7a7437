"""The drive process: it alone commands the arm, at 200 Hz, with every twist's deadline kept."""

from omniservo.drive.arm_opener import ArmOpener
from omniservo.drive.deadline import COMMAND_LIFE, DeadlinePassed
from omniservo.drive.drive_client import DriveClient
from omniservo.drive.messages import Phase

__all__ = ["COMMAND_LIFE", "ArmOpener", "DeadlinePassed", "DriveClient", "Phase"]
