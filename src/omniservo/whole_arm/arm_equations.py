"""The normal equations of camera and arm together."""

from __future__ import annotations

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.held import held
from omniservo.geometry.kernel import kernel
from omniservo.planning.constraints.constraints import Constraints
from omniservo.planning.constraints.place import TX
from omniservo.planning.search.descent import Room, linearise, spread
from omniservo.planning.search.path_family import PathFamily
from omniservo.robots.kinematics.chain import Chain
from omniservo.robots.path_following.step_kernels import settle


@kernel
def add_arm(
    family: PathFamily, ell: float, room: Room, costs: FloatArray, systems: FloatArray, normal: FloatArray
) -> None:
    """Add the systems (m, 6, 7) of the first m samples to the normal equations (nx, nx+1), where they cost.

    `linearise` was called before: ``room`` knows where the camera is at the samples.
    """
    for s in range(costs.shape[0]):
        if costs[s] > 0.0:
            spread(family, ell, s, systems[s], room.poses[s], room.turns[s], room.block, normal)


@kernel
def follow_poses(
    chain: Chain,
    base_T_initial: FloatArray,
    poses: FloatArray,
    camera_T_flange: FloatArray,
    leap: float,
    joints: FloatArray,
) -> bool:
    """Do what `lead_onto` does where the camera is at poses (m, 14), see `push`; no row is carried."""
    goals = np.empty((joints.shape[0], 4, 4))
    for s in range(joints.shape[0]):
        for i in range(4):
            for k in range(4):
                goals[s, i, k] = 0.0
                for j in range(4):
                    moved = base_T_initial[i, 3] if j == 3 else 0.0
                    for c in range(3):
                        moved += base_T_initial[i, c] * poses[s, TX + c if j == 3 else 3 * c + j]
                    goals[s, i, k] += moved * camera_T_flange[j, k]
    return bool(lead_onto(chain, goals, leap, False, joints))


@kernel
def lead_onto(chain: Chain, goals: FloatArray, leap: float, carried: bool, joints: FloatArray) -> bool:
    """Lead every row of joints (m, n) by Newton's iteration to where the flange is to be, (m, 4, 4).

    Args:
        chain: of n joints.
        goals: base_T_flange.
        leap: [rad] that no joint of a row may move.
        carried: each row begins as far off as the one before came to be, and ``leap`` counts from there: so
            joints come to lie far from where they were, if only little by little.
        joints: in and out.

    Returns:
        False: one does not arrive, or a joint leaps.
    """
    chain = held(chain)
    off, before, J = np.zeros(joints.shape[1]), np.empty(joints.shape[1]), np.empty((6, joints.shape[1]))
    for s in range(joints.shape[0]):
        for j in range(before.shape[0]):
            before[j] = joints[s, j]
            joints[s, j] += off[j]
        if not settle(chain, goals[s], joints[s], J):
            return False
        for j in range(before.shape[0]):
            change = joints[s, j] - before[j]
            if not abs(change - off[j]) <= leap:
                return False
            if carried:
                off[j] = change
    return True


def camera_equations(
    constraints: Constraints,
    family: PathFamily,
    x: FloatArray,
    targets: FloatArray,
    pull: float,
    room: Room,
) -> tuple[float, FloatArray, FloatArray]:
    """Return cost, smallest g of every group and normal equations (nx, nx+1) of the camera's constraints."""
    least, normal = np.empty_like(targets), np.empty((len(x), len(x) + 1))
    cost = float(linearise(constraints, family, x, targets, pull, room, least, normal))
    return cost, least, normal
