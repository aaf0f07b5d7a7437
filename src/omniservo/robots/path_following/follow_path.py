"""A camera path followed by an arm, on every branch of its inverse kinematics."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import RigidTransform

from omniservo.errors import InputError
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import FloatArray, finite_array, frozen
from omniservo.geometry.single_pose import single_pose
from omniservo.robots.arm import LENGTH_SCALE, Arm
from omniservo.robots.path_following.joint_path import JointPath, PathFailure
from omniservo.robots.path_following.march_kernel import States
from omniservo.robots.path_following.path_steps import PathSteps, PosePath, Stop
from omniservo.robots.path_following.quintic import quintic_pieces
from omniservo.robots.path_following.step_kernels import VALUE

_FAMILIES = 8
"""Starts of an arm with seven joints, spread over the configurations that a search finds."""

_AT_START = 1e-6
"""[m], [rad] from the pose of a stated start to the path's"""

_SHARES = np.arange(16) / 16.0
"""places between two samples at which limits are checked, and"""

_BASIS = np.array([math.comb(5, k) * _SHARES**k * (1.0 - _SHARES) ** (5 - k) for k in range(6)]).T
"""(16, 6) the quintic Bernstein polynomials there"""


@with_field_docs
@dataclass(frozen=True, eq=False)
class FollowedPath:
    """What every branch makes of a camera path."""

    branches: tuple[JointPath, ...]
    """those that the arm can follow first, by `JointPath.travel`; then the others, the longest followed
    first"""
    all_tried: bool
    """True: closed form, these are all branches. False: those that a seeded numeric search found, of seven
    joints some of a family; or the one whose start was stated."""

    @property
    def best(self) -> JointPath:
        """The first branch, which may fail, too."""
        return self.branches[0]


def follow_path(
    arm: Arm,
    path: PosePath,
    base_T_initial: RigidTransform,
    flange_T_camera: RigidTransform,
    *,
    start: npt.ArrayLike | None = None,
    aim: npt.ArrayLike | None = None,
    velocity: npt.ArrayLike | None = None,
) -> FollowedPath:
    """Return the joints that carry the camera along a path, on every branch in which the arm can start.

    Each branch is continued from w = 0: the step is foretold by dq/dw and d²q/dw², corrected by Newton's
    iteration on the pose, and halved until the joints do not leap and the quintic between two samples keeps
    the camera on its path within 1e-6 m and rad. Seven joints: least motion, and beside it a motion of the
    arm in itself away from the limits, −k·half range·(distance from the middle / half range)⁵. Limits do not
    steer a branch of six joints; they are judged afterwards, with the full turn of each joint that leaves
    most room.

    Args:
        arm: six or seven joints.
        path: of the camera, see `PosePath`; `omniservo.planning.CameraPath` is one.
        base_T_initial: the frame that the path is stated in.
        flange_T_camera: how the camera sits on the flange.
        start: (n,) [rad], where the arm stands: only the branch that goes on from there is followed, with
            these full turns; None: every branch, each with the full turns that leave most room.
        aim: (n,) [rad], a configuration of seven joints at the path's end: what the camera leaves free goes
            the straight way from ``start`` to it, as far as the camera's path lets it.
        velocity: (n,) dq/dw [rad] with which seven joints leave ``start``: what the camera leaves free of it
            fades away within a quarter of the path. None: self-motion begins as it goes on.

    Raises:
        InputError: no configuration reaches the path's start, or ``start`` is not one; an aim or a velocity
            without start, or of six joints; or something is not finite.
    """
    single_pose("base_T_initial", base_T_initial)
    single_pose("flange_T_camera", flange_T_camera)
    steps = PathSteps(arm, path, base_T_initial, flange_T_camera)
    for name, value in (("aim", aim), ("velocity", velocity)):
        if value is not None and (start is None or arm.dof == 6):
            raise InputError(f"{name}: needs a start, and an arm of seven joints: six leave nothing free")
    if start is not None:
        stand = _checked_start(arm, steps.first_goal, start)
        if aim is not None:
            steps.lead(stand, finite_array("aim", aim, (arm.dof,)))
        if velocity is not None:
            steps.leave(stand, finite_array("velocity", velocity, (arm.dof,)))
        return FollowedPath((_joint_path(arm, *steps.follow(stand), turns=False),), all_tried=False)
    try:
        starts = arm.branches(RigidTransform.from_matrix(steps.first_goal))
    except InputError as error:
        raise InputError(f"path: its start cannot be reached: {error}") from None
    if arm.dof > 6:
        starts = _spread(starts, arm.joint_range)
    # Seven joints were pushed off the limits of the turn that they are in, so they keep it.
    branches = [_joint_path(arm, *steps.follow(each), turns=arm.dof == 6) for each in starts]
    return FollowedPath(tuple(sorted(branches, key=_rank)), arm.has_closed_form)


def _checked_start(arm: Arm, goal: FloatArray, start: npt.ArrayLike) -> FloatArray:
    stand = finite_array("start", start, (arm.dof,))
    twist, _ = arm.miss(stand, goal)
    linear, angular = LENGTH_SCALE * float(np.linalg.norm(twist[:3])), float(np.linalg.norm(twist[3:]))
    if max(linear, angular) > _AT_START:
        raise InputError(
            f"start: {1e3 * linear:.3g} mm and {np.rad2deg(angular):.3g} deg from the path's start"
        )
    return stand


def _rank(branch: JointPath) -> tuple[bool, float, float]:
    first = branch.failures[0].w if branch.failures else 1.0
    return not branch.feasible, -first, branch.travel


def _joint_path(arm: Arm, states: States, stop: Stop | None, *, turns: bool) -> JointPath:
    w = states.w
    q, slope, bend = (np.ascontiguousarray(states.joints[:, order]) for order in range(3))
    fine, dense = w, q
    if len(w) > 1:
        fine = np.append((w[:-1, None] + np.diff(w)[:, None] * _SHARES).ravel(), w[-1])
        inside = _BASIS @ quintic_pieces(w, q, slope, bend)
        dense = np.concatenate([inside.reshape(-1, q.shape[1]), q[-1:]])
    if turns:
        middle = 0.5 * (dense.min(axis=0) + dense.max(axis=0))
        turn = 2.0 * np.pi * np.round((arm.joint_range.mean(axis=1) - middle) / (2.0 * np.pi))
        q, dense = q + turn, dense + turn
    failures = _passed_limits(arm, fine, dense)
    if stop is not None:
        failures.append(PathFailure(stop.kind, arm.joint_names[stop.joint], stop.w, stop.amount, stop.w))
    way = np.abs(np.diff(dense, axis=0)).sum(axis=0)
    return JointPath(
        w=frozen(w),
        positions=frozen(q),
        velocities=frozen(slope),
        accelerations=frozen(bend),
        singular_values=frozen(states.values[:, VALUE]),
        limit_margins=frozen(arm.limit_margins(q)),
        failures=tuple(sorted(failures, key=lambda failure: failure.w)),
        travel=float((way / arm.joint_speed).max()),
    )


def _passed_limits(arm: Arm, w: FloatArray, q: FloatArray) -> list[PathFailure]:
    margins = arm.limit_margins(q)
    found = []
    for joint in np.flatnonzero(margins.min(axis=0) < 0.0):
        room = margins[:, joint]
        first, worst = int(np.argmax(room < 0.0)), int(np.argmin(room))
        begins = float(w[first])
        if first:  # linear between two places so close together
            begins -= float(w[first] - w[first - 1]) * room[first] / (room[first] - room[first - 1])
        name = arm.joint_names[joint]
        found.append(PathFailure("limit", name, begins, float(-room[worst]), float(w[worst])))
    return found


def _spread(starts: FloatArray, joint_range: FloatArray) -> FloatArray:
    """Return up to `_FAMILIES` configurations: that with most room, then ever the one farthest from those."""
    relative = (starts - joint_range[:, 0]) / np.diff(joint_range, axis=1)[:, 0]
    room = np.minimum(relative, 1.0 - relative).min(axis=1)
    chosen = [int(np.argmax(room))]
    apart = np.abs(relative - relative[chosen[0]]).max(axis=1)
    while len(chosen) < min(_FAMILIES, len(starts)):
        chosen.append(int(np.argmax(apart)))
        apart = np.minimum(apart, np.abs(relative - relative[chosen[-1]]).max(axis=1))
    return starts[chosen]
