"""Whether all bodies of the arm keep clear of what stands around, by the joints as they are read."""

from __future__ import annotations

import numpy as np

from omniservo.errors import ServoStop
from omniservo.robots import ArmBodies, RobotState
from omniservo.robots.collision.posture_gaps import PostureGaps
from omniservo.safety.motion_limits import stopping_distance

_SHARES = np.array([[0.0], [0.5], [1.0]])
"""of the stopping distance, where gaps are measured"""


class TooNear(ServoStop):
    """A body of the arm is, or would come to rest, too near to another one."""

    reason = "too_near"


class GapWatch:
    """Stops an arm of which a body could soon not be braked clear of another one any more.

    `PathWatch` knows the camera alone; a link that stands out farther moves more than it. Gaps are measured
    where the arm stands by its joints, where it would come to rest if braking began after the reaction time,
    and half way there.

    Args:
        bodies: the arm among what is known to stand around it.
        clearance: what is to be kept of the gaps to what stands around [m]; of those between the arm's own
            parts it is 0.
        reaction: until braking begins [s].
    """

    def __init__(self, bodies: ArmBodies, clearance: float, reaction: float) -> None:
        self._bodies, self._reaction = bodies, reaction
        self._asked = bodies.asked(clearance, 0.0)
        self._gaps = PostureGaps(bodies, len(_SHARES))
        middle = bodies.arm.joint_range.mean(axis=1)
        self._gaps.worst(middle[None], self._asked, 0.0)  # loads compiled code before anything moves

    def check(self, state: RobotState) -> None:
        """Look where the arm is, and where it could be stopped.

        Raises:
            TooNear: two bodies are, or would be, nearer than they are to keep.
        """
        acceleration = self._bodies.arm.joint_acceleration
        turned = stopping_distance(state.joint_velocities, acceleration, self._reaction)
        found = self._gaps.worst(state.joint_positions + _SHARES * turned, self._asked, 0.0)
        if found is not None:
            posture, pair, gap = found
            one, other = self._bodies.names(pair)
            where = "are" if posture == 0 else "would come to rest"
            raise TooNear(
                f"{one} and {other} {where} {1e3 * gap:.1f} mm apart by the joints; at least "
                f"{1e3 * self._asked[pair]:g} mm are kept"
            )
