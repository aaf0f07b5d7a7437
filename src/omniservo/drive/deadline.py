"""Until when a command counts."""

from omniservo.errors import ServoStop

COMMAND_LIFE = 0.15
"""A command counts for so long after it was given [s]: then the arm is braked, whatever its giver does."""


class DeadlinePassed(ServoStop):
    """No further command came before the last one's deadline: what leads the camera hangs or is too slow."""

    reason = "deadline"
