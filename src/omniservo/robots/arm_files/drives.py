"""The drives of the simulated arm: one position servo a joint."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.robots.collision.plain import PLAIN

_BANDWIDTH = 120.0
"""[rad/s] of a drive without load: fast beside any arm's motion, slow beside the physics step of 1 ms"""

_ROTOR = 0.1
"""[kg m²] least inertia of a motor behind its gear, so that a camera on the flange is no great load"""

_POSTURES = 16


def has_drives(model: Any) -> bool:
    """Return whether there is one damped position servo for each joint, in their order, and nothing else."""
    return bool(
        model.nu == model.njnt
        and (model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT).all()
        and (model.actuator_trnid[:, 0] == np.arange(model.njnt)).all()
        and (model.actuator_dyntype == mujoco.mjtDyn.mjDYN_NONE).all()
        and (model.actuator_gear[:, 0] == 1.0).all()
        and (model.actuator_gainprm[:, 0] > 0.0).all()
        and (model.actuator_biasprm[:, 1] == -model.actuator_gainprm[:, 0]).all()
        and (model.actuator_biasprm[:, 2] < 0.0).all()
    )


def add_drives(spec: Any, model: Any) -> None:
    """Put ideal drives in the place of whatever there is: critically damped, friction compensated."""
    for actuator in list(spec.actuators):
        spec.delete(actuator)
    rotors = np.maximum(model.dof_armature, _ROTOR)
    inertias = _largest_inertias(model) - model.dof_armature + rotors
    for joint, rotor, inertia in zip(spec.joints, rotors, inertias, strict=True):
        joint.armature, joint.frictionloss = rotor, 0.0
        joint.damping, joint.stiffness = np.zeros_like(joint.damping), np.zeros_like(joint.stiffness)
        drive = spec.add_actuator(PLAIN, name=f"drive {joint.name}", target=joint.name)
        drive.trntype = mujoco.mjtTrn.mjTRN_JOINT
        stiffness = inertia * _BANDWIDTH**2
        drive.gaintype, drive.biastype = mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtBias.mjBIAS_AFFINE
        drive.gainprm[0] = stiffness
        drive.biasprm[1], drive.biasprm[2] = -stiffness, -2.0 * inertia * _BANDWIDTH


def _largest_inertias(model: Any) -> FloatArray:
    """Return the largest inertia (n,) [kg m²] about each joint in some random configurations."""
    data, column = mujoco.MjData(model), np.zeros(model.nv)
    random = np.random.default_rng(0)
    largest = np.zeros(model.nv)
    for _ in range(_POSTURES):
        data.qpos[:] = random.uniform(model.jnt_range[:, 0], model.jnt_range[:, 1])
        mujoco.mj_fwdPosition(model, data)
        for joint, alone in enumerate(np.eye(model.nv)):
            mujoco.mj_mulM(model, data, column, alone)
            largest[joint] = max(largest[joint], column[joint])
    return largest
