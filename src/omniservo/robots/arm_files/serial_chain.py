"""What MuJoCo's model of an arm calls its parts, whether its joints have limits, and its flange."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.errors import InputError, spelled
from omniservo.robots.arm_files.arm_row import FLANGE_NAMES
from omniservo.robots.arm_files.description import ENDLESS

_TAKEN = frozenset({"camera", "floor"})
_WIDEST = 100.0
"""[rad] largest joint position"""

_TURNS = 2
_MOST_TURNS = (2 * _TURNS + 1) ** 7
"""ways of whole turns that all joints together may have: each is a branch of inverse kinematics"""


def name_parts(spec: Any) -> dict[str, str]:
    """Give links and joints without a name one; links do not take the names of the simulator's bodies.

    Returns:
        The new names of links that had one, by the old.
    """
    renamed: dict[str, str] = {}
    for number, body in enumerate(spec.bodies[1:], 1):
        old = body.name
        if old in _TAKEN or not old:
            body.name = f"{old or 'link'} {number}"
            renamed |= {old: body.name} if old else {}
            for exclude in spec.excludes if old else ():
                exclude.bodyname1 = body.name if exclude.bodyname1 == old else exclude.bodyname1
                exclude.bodyname2 = body.name if exclude.bodyname2 == old else exclude.bodyname2
    for number, joint in enumerate(spec.joints, 1):
        joint.name = joint.name or f"joint {number}"
    return renamed


def limit_endless(spec: Any, model: Any) -> list[str]:
    """Give hinges without a range the one of a continuous joint; return their names."""
    endless = [model.joint(joint).name for joint in range(model.njnt) if not model.jnt_limited[joint]]
    most = np.degrees(ENDLESS) if spec.compiler.degree else ENDLESS
    for name in endless:
        joint = spec.joint(name)
        joint.limited, joint.range = mujoco.mjtLimited.mjLIMITED_TRUE, (-most, most)
    return endless


def check_joints(model: Any, source: str) -> None:
    """Refuse joints that are coupled, or without sensible limits, each and together.

    Raises:
        InputError: with the joint's name and what is legal.
    """
    if model.neq:
        raise InputError(f"{source}: <equality> given; legal: joints of the arm that move by themselves")
    for joint in range(model.njnt):
        _check_range(model, joint, source)
    turns = np.floor(np.ptp(model.jnt_range, axis=1) / (2.0 * np.pi)) + 1.0
    if turns.prod() > _MOST_TURNS:
        raise InputError(
            f"{source}: the joints' ranges hold one posture in {turns.prod():.0f} ways, by whole turns; "
            f"legal: {_MOST_TURNS} at most, as ranges of ±{_TURNS:g} turns"
        )


def find_flange(model: Any, flange: str | None, hand: frozenset[str]) -> tuple[str, str, RigidTransform]:
    """Return the flange's name, the name of the link that it is fixed to, and its pose there.

    Args:
        model: of the arm alone; its last joint carries the flange.
        flange: link or site; None: the first of `FLANGE_NAMES` that the last joint carries, else the last
            link before others stand beside each other or on a joint that is held still.
        hand: links on joints that are held still.
    """
    last = int(model.jnt_bodyid[-1])
    for name in FLANGE_NAMES if flange is None else (flange,):
        place = _site_or_body(model, name)
        if place is not None and _carries(model, last, place[0]):
            return name, str(model.body(place[0]).name), place[1]
    body = last
    while len(children := np.flatnonzero(model.body_parentid == body)) == 1:
        if str(model.body(children[0]).name) in hand:
            break
        body = int(children[0])
    name = str(model.body(body).name)
    return name, name, RigidTransform.identity()


def _site_or_body(model: Any, name: str) -> tuple[int, RigidTransform] | None:
    site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, name)
    if site >= 0:
        turned = Rotation.from_quat(model.site_quat[site], scalar_first=True)
        return int(model.site_bodyid[site]), RigidTransform.from_components(model.site_pos[site], turned)
    body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name)
    return (int(body), RigidTransform.identity()) if body > 0 else None


def _carries(model: Any, body: int, carried: int) -> bool:
    while carried > body:  # parents have smaller numbers
        carried = int(model.body_parentid[carried])
    return carried == body


def _check_range(model: Any, joint: int, source: str) -> None:
    place = f"{source}: joint {_name(model, joint)}"
    low, high = model.jnt_range[joint]
    if not (np.isfinite([low, high]).all() and -_WIDEST <= low < high <= _WIDEST):
        raise InputError(
            f"{place}: range {low:g} … {high:g} rad; legal: low < high, both within ±{_WIDEST:g} rad"
        )


def _name(model: Any, joint: int) -> str:
    return spelled(model.joint(joint).name)
