"""Whether the joints have the camera where its path was proven to be free."""

from __future__ import annotations

from scipy.spatial.transform import Rotation

from omniservo.safety.camera_motion import CameraMotion
from omniservo.safety.joint_motion import OffPath
from omniservo.safety.path_controller import PathController


class PathWatch:
    """Stops a camera that the joints have farther from its path than ``room``.

    A controller goes by the image, so by the target: where this moves, or points and distances are wrong in a
    way that `ImageWatch` takes for an error of the structure, the camera goes elsewhere than planned. The
    joints know. It is the nearest place of the path that counts, so a camera that lags is on it.

    Args:
        path: the controller.
        motion: the camera by the joints; at time 0 it stands where the path begins.
        room: the most that it may be beside its path [m].
    """

    def __init__(self, path: PathController, motion: CameraMotion, room: float) -> None:
        self._path, self._motion, self._room = path, motion, room
        self._start = motion(0.0)

    def check(self, time: float) -> None:
        """Look where the joints had the camera at ``time`` [s].

        Raises:
            OffPath: it is too far from its path.
        """
        moved = self._motion(time)[4:] - self._start[4:]
        beside = self._path.distance(Rotation.from_quat(self._start[:4]).inv().apply(moved))
        if not beside <= self._room:
            raise OffPath(
                f"the joints have the camera {1e3 * beside:.1f} mm off its path; the path keeps "
                f"{1e3 * self._room:g} mm free for that"
            )
