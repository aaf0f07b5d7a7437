"""What keeps an arm from following a camera path on one branch."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.robots import ArmBodies, ArmClearance, JointPath, arm_clearance
from omniservo.robots.collision.gap_kernels import halves_of
from omniservo.whole_arm.arm_setting import ArmSetting

_HALVINGS = 3
"""of each piece of the joint path at most: its Bernstein coefficients then lie close to it"""


@dataclass(frozen=True, eq=False)
class JudgedBranch:
    """One branch, and why it will not do."""

    branch: JointPath
    clearance: ArmClearance | None
    """None: a limit, a singularity or the reach stops it before"""
    reason: str
    """"" where it will do"""
    w: float
    """where it fails worst"""

    @property
    def is_hidden(self) -> bool:
        """Whether only a body in a line of sight speaks against it, off which no slope leads."""
        return bool(self.reason) and self.clearance is not None and self.clearance.status == "clear"

    @property
    def until(self) -> float:
        """How far the arm gets, as a part of the path."""
        failures = self.branch.failures
        return failures[0].w if failures else 1.0


def judged_branch(
    setting: ArmSetting,
    bodies: ArmBodies,
    branch: JointPath,
    points: FloatArray | None = None,
    *,
    worst: bool = True,
) -> JudgedBranch:
    """Return what fails first: the branch, the reserve to its limits, its singular value, clearance, sight.

    Args:
        setting: the arm, and what it has to keep.
        bodies: the arm among what stands around.
        branch: joints that follow a camera path.
        points: (m, 3) that nothing may hide from the camera, in the base frame [m]; None: any may be hidden.
        worst: see `arm_clearance`.
    """
    if branch.failures:
        first = branch.failures[0]
        return JudgedBranch(branch, None, str(first), first.worst_w)
    w, short, joint = _least_room(setting, branch)
    if short > 0.0:
        reason = (
            f"{setting.arm.joint_names[joint]} comes {math.degrees(short):.2f} deg nearer to the end of its "
            f"range than the {math.degrees(setting.limit_reserve):g} deg that are kept, at w = {w:.3f}"
        )
        return JudgedBranch(branch, None, reason, w)
    place = int(branch.singular_values.argmin())
    if branch.singular_values[place] < setting.singular_value:
        reason = (
            f"the arm is close to singular at w = {branch.w[place]:.3f}: smallest singular value "
            f"{branch.singular_values[place]:.4f}; at least {setting.singular_value:g} is needed"
        )
        return JudgedBranch(branch, None, reason, float(branch.w[place]))
    found = arm_clearance(
        bodies,
        branch,
        clearance=setting.clearance_around,
        self_clearance=setting.self_clearance,
        worst=worst,
    )
    if found.status != "clear":
        return JudgedBranch(branch, found, found.reason, found.closest.w if found.closest else 0.5)
    if points is not None:
        sight = setting.own_sight(branch, points)
        if sight.status == "hidden":
            return JudgedBranch(branch, found, f"a point is hidden: {sight.reason}", sight.w)
    return JudgedBranch(branch, found, "", 0.0)


def _least_room(setting: ArmSetting, branch: JointPath) -> tuple[float, float, int]:
    """Return w, by how much the reserve is missed there at most [rad] (≤ 0: kept for all w), and the joint.

    A polynomial lies within the range of its Bernstein coefficients: those of shorter pieces are checked
    where it needs them.
    """
    knots, pieces = branch.bernstein_pieces()
    low, high = setting.arm.joint_range.T
    for halvings in range(_HALVINGS + 1):
        if halvings:
            knots, pieces = np.sort(np.append(knots, 0.5 * (knots[:-1] + knots[1:]))), halves_of(pieces)
        short = setting.limit_reserve - np.minimum(pieces - low, high - pieces)
        if short.max() <= 0.0:
            break
    place, _, joint = np.unravel_index(int(np.argmax(short)), short.shape)
    return float(0.5 * (knots[place] + knots[place + 1])), float(short.max()), int(joint)
