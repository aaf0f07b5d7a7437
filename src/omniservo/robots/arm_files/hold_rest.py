"""The joints of an MJCF that are not the arm's, held still where the file has them."""

from __future__ import annotations

from typing import Any

import mujoco

from omniservo.errors import spelled
from omniservo.robots.arm_files.arm_row import MovingJoint, arm_row

_KINDS = ("free", "ball", "slide", "hinge")


def hold_rest(spec: Any, flange: str | None, source: str) -> tuple[list[str], frozenset[str]]:
    """Take all joints out of MuJoCo's MjSpec that do not carry the flange, see `arm_row`.

    With them go their drives, and what couples them with each other alone (grippers are closed by that).

    Returns:
        The names of these joints, and of the bodies that they carried.

    Raises:
        InputError: there is no such flange, or no row of 6 or 7 hinges.
    """
    joints: list[Any] = []
    before: list[int | None] = []
    carriers: dict[str, int | None] = {}
    _walk(spec.worldbody, None, joints, before, carriers)
    followed = {e.name1: e.name2 for e in spec.equalities if e.type == mujoco.mjtEq.mjEQ_JOINT and e.name2}
    described = [
        MovingJoint(
            joint.name,
            f"{source}: joint {spelled(joint.name)}",
            _KINDS[int(joint.type)],
            joint.type == mujoco.mjtJoint.mjJNT_HINGE,
            followed.get(joint.name),
            last,
        )
        for joint, last in zip(joints, before, strict=True)
    ]
    row = arm_row(described, carriers, flange, source)
    rest = [joint for number, joint in enumerate(joints) if number not in row]
    names, bodies = [joint.name for joint in rest], frozenset(joint.parent.name for joint in rest)
    for actuator in list(spec.actuators):
        if actuator.trntype == mujoco.mjtTrn.mjTRN_TENDON or actuator.target in names:
            spec.delete(actuator)
    for equality in list(spec.equalities):
        if _couples_only_rest(equality, names, carriers, row, described):
            spec.delete(equality)
    for joint in rest:
        spec.delete(joint)
    return names, bodies


def _walk(
    body: Any, last: int | None, joints: list[Any], before: list[int | None], carriers: dict[str, int | None]
) -> None:
    """Write down joints from the base outwards, what each hangs on, and what carries each body and site."""
    for joint in body.joints:
        before.append(last)
        last = len(joints)
        joints.append(joint)
    carriers |= {part.name: last for part in (body, *body.sites) if part.name not in ("", "world")}
    for child in body.bodies:
        _walk(child, last, joints, before, carriers)


def _couples_only_rest(
    equality: Any,
    rest: list[str],
    carriers: dict[str, int | None],
    row: tuple[int, ...],
    joints: list[MovingJoint],
) -> bool:
    if equality.type == mujoco.mjtEq.mjEQ_JOINT:
        return equality.name1 in rest and (not equality.name2 or equality.name2 in rest)
    ends = [_last_of_row(carriers.get(name), row, joints) for name in (equality.name1, equality.name2)]
    return ends[0] is not None and ends[0] == ends[1]


def _last_of_row(joint: int | None, row: tuple[int, ...], joints: list[MovingJoint]) -> int | None:
    while joint is not None and joint not in row:
        joint = joints[joint].before
    return joint
