"""Whether MuJoCo's model is a serial arm, and which of its frames carries the camera."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.errors import InputError, spelled
from omniservo.robots.arm_files.description import LEGAL_COUNTS

TOOL_NAMES = ("tool0", "flange", "attachment_site")
"""What the place for a tool is called: in ROS-Industrial (z outwards), here, in MuJoCo's collection."""

_TAKEN = frozenset({"camera", "floor"})
_KINDS = ("free", "ball", "slide", "hinge")
_WIDEST = 100.0
"""[rad] largest joint position"""


def name_parts(spec: Any) -> None:
    """Give links and joints without a name one; links do not take the names of the simulator's bodies."""
    for number, body in enumerate(spec.bodies[1:], 1):
        old = body.name
        if old in _TAKEN or not old:
            body.name = f"{old or 'link'} {number}"
            for exclude in spec.excludes if old else ():
                exclude.bodyname1 = body.name if exclude.bodyname1 == old else exclude.bodyname1
                exclude.bodyname2 = body.name if exclude.bodyname2 == old else exclude.bodyname2
    for number, joint in enumerate(spec.joints, 1):
        joint.name = joint.name or f"joint {number}"


def check_serial(model: Any, source: str) -> None:
    """Refuse what is not 6 or 7 hinges with limits, each carried by the one before.

    Raises:
        InputError: with the joint's name and what is legal.
    """
    for joint in range(model.njnt):
        kind = _KINDS[model.jnt_type[joint]]
        if kind != "hinge":
            raise InputError(f"{source}: joint {_name(model, joint)}: type {kind!r} given; legal: 'hinge'")
    if model.njnt not in LEGAL_COUNTS:
        names = ", ".join(_name(model, joint) for joint in range(min(model.njnt, 12)))
        raise InputError(f"{source}: {model.njnt} joints ({names or 'none'}); legal: 6 or 7 in a row")
    if model.neq:
        raise InputError(f"{source}: <equality> given; legal: joints that move by themselves")
    for joint in range(model.njnt):
        _check_range(model, joint, source)
        if joint and not _carries(model, model.jnt_bodyid[joint - 1], model.jnt_bodyid[joint]):
            raise InputError(
                f"{source}: joint {_name(model, joint)} does not hang on {_name(model, joint - 1)}; legal: "
                "one joint after the other"
            )


def find_tool(model: Any, tool: str | None, source: str) -> tuple[str, str, RigidTransform]:
    """Return the tool's name, the name of the link that it is fixed to, and its pose there.

    Raises:
        InputError: there is no such site or link, or the last joint does not carry it.
    """
    last = int(model.jnt_bodyid[-1])
    for name in TOOL_NAMES if tool is None else (tool,):
        place = _site_or_body(model, name)
        if place is not None and _carries(model, last, place[0]):
            return name, str(model.body(place[0]).name), place[1]
    if tool is not None:
        sites = [model.site(i) for i in range(model.nsite)]
        names = [site.name for site in sites if _carries(model, last, int(site.bodyid[0]))]
        names += [model.body(i).name for i in range(last, model.nbody) if _carries(model, last, i)]
        legal = ", ".join(name for name in names if name)[:300]
        raise InputError(f"{source}: tool {spelled(tool)}: not carried by the last joint; legal: {legal}")
    body = last
    while len(children := np.flatnonzero(model.body_parentid == body)) == 1:
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
    if not model.jnt_limited[joint]:
        raise InputError(f'{place}: no limits; legal: range="low high"')
    low, high = model.jnt_range[joint]
    if not (np.isfinite([low, high]).all() and -_WIDEST <= low < high <= _WIDEST):
        raise InputError(
            f"{place}: range {low:g} … {high:g} rad; legal: low < high, both within ±{_WIDEST:g} rad"
        )


def _name(model: Any, joint: int) -> str:
    return spelled(model.joint(joint).name)
