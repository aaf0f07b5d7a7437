"""Every exception that omniservo raises on purpose.

A wrong call raises; an unlucky computation returns a result with a status and its evidence.
"""

import difflib
import reprlib
from collections.abc import Iterable
from pathlib import Path

from omniservo.renamed import renamed

TERMINATED = 143
"""exit status of a process that SIGTERM ended, as `SystemExit` has it"""

_SHORT = reprlib.Repr()
_SHORT.maxlevel, _SHORT.maxlist, _SHORT.maxtuple, _SHORT.maxdict = 4, 6, 6, 3
_SHORT.maxstring = _SHORT.maxlong = _SHORT.maxother = 50


def spelled(value: object) -> str:
    """Return a given value for a message: one line of at most 60 printable characters, whatever it is."""
    text = _SHORT.repr(value)
    text = text if text.isprintable() else ascii(text)
    return text if len(text) <= 60 else text[:57] + "..."


def spelled_name(name: object) -> str:
    """Return a given field's name for a message, bare where it can be."""
    text = str(name)[:41]
    return text if len(text) <= 40 and text.isprintable() else spelled(text)


def did_you_mean(given: object, legal: Iterable[str]) -> str:
    """Return "; did you mean 'clearance'?" where a legal name is much like the given one, else nothing."""
    close = difflib.get_close_matches(str(given)[:64], list(legal), n=1)
    return f"; did you mean {close[0]!r}?" if close else ""


class OmniservoError(Exception):
    """The root: catching it catches everything that omniservo raises on purpose."""

    def __reduce__(self) -> tuple[object, ...]:
        """Let another process have it as it is: its message is not what it was made from."""
        return _made_again, (type(self), self.args), vars(self)


def _made_again(kind: type[OmniservoError], arguments: tuple[object, ...]) -> OmniservoError:
    return kind.__new__(kind, *arguments)


class InputError(OmniservoError, ValueError):
    """The call or a file is wrong. The message names file, field, given value and what is legal."""


class AlreadyExists(InputError):
    """A result's file or folder is there already, and no one said that it may be replaced."""

    def __init__(self, path: str | Path) -> None:
        super().__init__(f"{path}: exists; force=True replaces it")
        self.path = path


class NotWritten(InputError):
    """A file could not be written: the disk is full, or the folder is not ours. Nothing of it is left."""

    def __init__(self, path: str | Path, reason: str) -> None:
        super().__init__(f"{path}: {reason}")
        self.path, self.reason = path, reason


class NoSolutionError(OmniservoError):
    """Computed, and the answer is no: the job cannot be done, for the reason that the message names."""


class ServoStop(OmniservoError):
    """The control loop refuses to go on; the arm is stopped. ``reason`` names the cause in one word."""

    reason = "stopped"


class FeatureLoss(ServoStop):
    """Too few features are left to control six degrees of freedom."""

    reason = "feature_loss"


class SingularInteraction(ServoStop):
    """The interaction matrix is singular: the features do not determine a camera twist."""

    reason = "singular_interaction"


class JointLimit(ServoStop):
    """The commanded motion would leave the joint range, or the arm is at a singular configuration."""

    reason = "joint_limit"


class StaleImage(ServoStop):
    """The newest image is older than the loop allows."""

    reason = "stale_image"


class Divergence(ServoStop):
    """The feature error exceeds its bound: the camera is not where the plan says."""

    reason = "divergence"


class NotFinite(ServoStop):
    """A joint, a twist or a command is not a finite number; it was not sent."""

    reason = "not_finite"


class WorkspaceLimit(ServoStop):
    """The camera's centre would leave its workspace."""

    reason = "workspace"


class SlowLoop(ServoStop):
    """The moving robot was not checked for longer than its braking distance allows."""

    reason = "slow_loop"


class Blocked(ServoStop):
    """What is known now leaves no way on that is proven."""

    reason = "blocked"


class NotFollowing(ServoStop):
    """The joints do not move as they were commanded, by more than the drives' lag and gain explain."""

    reason = "not_following"


class InconsistentImage(ServoStop):
    """The points in the image do not move as the measured joints move the camera."""

    reason = "inconsistent_image"


class RobotLost(ServoStop):
    """The robot does not answer: its connection is gone, or its driver failed."""

    reason = "robot_lost"


class ClockFault(ServoStop):
    """The robot's clock runs backwards."""

    reason = "clock_fault"


class StaleJoints(ServoStop):
    """The arm's newest joint state is older than is acted on, though its connection stands."""

    reason = "stale_joints"


class ConnectionLost(RobotLost):
    """The connection to the arm, or to the process that drives it, is gone."""

    reason = "connection"


class ProtectiveStop(ServoStop):
    """The arm's controller stopped it: protective stop or emergency stop."""

    reason = "protective_stop"


class NotInControl(ServoStop):
    """Another program, the pendant or no one commands the arm, or somebody else does besides."""

    reason = "not_in_control"


class InvalidData(ServoStop):
    """What robot, camera or controller gave in mid motion has not the form that it must have."""

    reason = "invalid_data"


__getattr__ = renamed(__name__, {"AnswerIsNo": "NoSolutionError"})
