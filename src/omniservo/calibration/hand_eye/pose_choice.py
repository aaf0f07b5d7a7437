"""Which images of a board are worth keeping for a hand-eye calibration, and what is still missing."""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.calibration.boards import Board, BoardView
from omniservo.calibration.boards.board_pose import board_pose
from omniservo.calibration.hand_eye.calibrate_images import turns_of
from omniservo.calibration.view_choice import Judgement, moved, still_px
from omniservo.cameras.models import CentralModel
from omniservo.geometry.arrays import FloatArray

FEWEST_POSES = 4
"""views, without which there is no hand-eye calibration"""

ENOUGH_POSES = 10
"""views that are required"""

TURNED = math.radians(30.0)
"""in all, about each of the camera's axes, that is required [rad]"""

STANDING = 5e-4
"""A joint that stands turns by no more from image to image [rad]."""

AXES = ("tilted up and down", "tilted left and right", "turned about its axis")
"""what turns about the camera's x, y and z are called"""

_ANOTHER_TURN = math.radians(8.0)


class PoseChoice:
    """Keeps views of a board at rest from an arm at rest whose camera is turned otherwise than before.

    Args:
        camera: takes the images.
        board: what stands still in front of the arm.
    """

    def __init__(self, camera: CentralModel, board: Board) -> None:
        self._camera = camera
        self._turns = [RigidTransform.identity(), *turns_of(board)]
        self.joints: list[FloatArray] = []
        """of the views that are kept, (n,) each [rad]"""
        self._poses: list[RigidTransform] = []
        self._before: tuple[BoardView, FloatArray] | None = None

    def judge(self, view: BoardView, joints: FloatArray) -> Judgement:
        """Keep a view, or not.

        Args:
            view: of the next image.
            joints: (n,) of the arm, read after the image was taken [rad].
        """
        before, self._before = self._before, (view, joints) if view.found else None
        if not view.found:
            return Judgement(False, f"no board: {view.reason}")
        pose = board_pose(self._camera, view.pixels, view.object_points)
        if pose is None:
            return Judgement(False, f"board: {len(view)} points do not give its pose")
        pose = self._nearest(pose, view)
        turns = [(pose.rotation * kept.rotation.inv()).magnitude() for kept in self._poses]
        if turns and min(turns) < _ANOTHER_TURN:
            return Judgement(False, "board: seen as in a view that is kept; turn the camera")
        if before is None or np.abs(joints - before[1]).max() > STANDING:
            return Judgement(False, "board: another view; let the arm stand")
        if moved(before[0], view) > still_px((self._camera.width, self._camera.height)):
            return Judgement(False, "board: moves though the arm stands")
        self._poses.append(pose)
        self.joints.append(joints)
        return Judgement(True, "kept: the camera is turned otherwise" if turns else "kept: the first view")

    def _nearest(self, pose: RigidTransform, view: BoardView) -> RigidTransform:
        """Return the pose of a board that looks the same turned, counted so that it is turned least."""
        if not (self._poses and view.turnable):
            return pose
        first = self._poses[0].rotation
        return min(
            (pose * turn for turn in self._turns), key=lambda p: float((p.rotation * first.inv()).magnitude())
        )

    @property
    def spread(self) -> FloatArray:
        """(3,) by how much the camera was turned in all [rad]; see `AXES`.

        Tilts are of the board's normal about the camera's x and y, turns of the board about its z: unlike
        rotation vectors from one view to the others they do not depend on how the first view was turned.
        """
        if not self._poses:
            return np.zeros(3)
        R = np.array([pose.as_matrix()[..., :3, :3] for pose in self._poses])
        tilts = np.arcsin(np.clip(R[:, 1::-1, 2], -1.0, 1.0))
        about_axis = np.arctan2(R[:, 1, 0], R[:, 0, 0])
        turned = np.angle(np.exp(1j * (about_axis - about_axis[0])))
        return np.asarray(np.ptp(np.column_stack([tilts, turned]), axis=0))

    def missing(self) -> tuple[str, ...]:
        """Say what is still missing, each in words; nothing: empty."""
        words = [
            f"the camera {name}: {math.degrees(TURNED):.0f}° in all, so far {math.degrees(turned):.0f}°"
            for name, turned in zip(AXES, self.spread, strict=True)
            if turned < TURNED
        ]
        if (more := ENOUGH_POSES - len(self._poses)) > 0:
            words.append(f"{more} more view{'s' * (more > 1)}")
        return tuple(words)

    def summary(self) -> tuple[str, ...]:
        """Say what is kept, a line each."""
        turned = ", ".join(
            f"{name} {math.degrees(s):.0f}°" for name, s in zip(AXES, self.spread, strict=True)
        )
        return (f"{len(self._poses)} kept; the camera was {turned}",)
