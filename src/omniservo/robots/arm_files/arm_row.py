"""Which of a file's joints are the arm's: those before the flange. Others, a gripper's, are held still."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from omniservo.errors import InputError, spelled
from omniservo.robots.arm_files.description import LEGAL_COUNTS

FLANGE_NAMES = ("tool0", "flange", "attachment_site")
"""What a flange is called: in ROS-Industrial (z outwards), here, in MuJoCo's collection."""

_OF_GRIPPERS = re.compile("gripper|finger|jaw|knuckle|thumb", re.IGNORECASE)
"""In the names of joints that no arm has."""

_MOST_NAMED = 8
"""flanges in a message"""

_LEGAL = "legal: 6 or 7 in a row"


@dataclass(frozen=True)
class MovingJoint:
    """A joint as its file has it."""

    name: str
    place: str
    """stands first in messages"""
    kind: str
    """what the file calls it"""
    turns: bool
    """about one axis"""
    follows: str | None
    """the joint that it copies"""
    before: int | None
    """number of the joint that carries it; None: it hangs on the base"""


def arm_row(
    joints: Sequence[MovingJoint], carriers: Mapping[str, int | None], flange: str | None, source: str
) -> tuple[int, ...]:
    """Return the numbers of the arm's joints, from the base outwards: 6 or 7 that turn.

    With a ``flange`` they are all that carry it. Without, all in a row up to where it ends, or to the first
    joint of a gripper: one that does not turn, copies another or is copied, is called gripper, finger, jaw,
    knuckle or thumb, or moves beside others behind the sixth. If a link or site is called as in
    `FLANGE_NAMES` and such a row carries it, it ends there.

    Args:
        joints: all that move, each behind the one that carries it.
        carriers: the last joint before each link and site, by their names; None: no joint.
        flange: the link or site that carries the camera; None: not said.
        source: stands first in messages.

    Raises:
        InputError: there is no such flange, or no such row; the message names the joint and what is legal.
    """
    if flange is not None:
        row = _row_of_flange(joints, carriers, flange, source)
    else:
        named = (_before(joints, carriers[name]) for name in FLANGE_NAMES if name in carriers)
        plain = (row for row in named if _is_arm(joints, row) and not _grippers(joints, row))
        row = next(plain, ()) or _trunk(joints, carriers, source)
    for number, joint in enumerate(joints):
        if number not in row and joint.follows in {joints[i].name for i in row}:
            raise InputError(
                f"{joint.place}: a <mimic> joint follows {spelled(joint.follows)}, a joint of the arm, so "
                "its link cannot be held still; legal: a mimic of a gripper's joint. A piston or spring may "
                "be deleted from the file: the arm is the same, but does not keep clear with it"
            )
    return row


def _before(joints: Sequence[MovingJoint], last: int | None) -> tuple[int, ...]:
    """Return the joints from the base to ``last``."""
    row: list[int] = []
    while last is not None:
        row.insert(0, last)
        last = joints[last].before
    return tuple(row)


def _is_arm(joints: Sequence[MovingJoint], row: Sequence[int]) -> bool:
    return len(row) in LEGAL_COUNTS and all(joints[i].turns and joints[i].follows is None for i in row)


def _grippers(joints: Sequence[MovingJoint], row: Sequence[int]) -> list[int]:
    return [i for i in row if _why_a_grippers(joints, joints[i]) is not None]


def _row_of_flange(
    joints: Sequence[MovingJoint], carriers: Mapping[str, int | None], flange: str, source: str
) -> tuple[int, ...]:
    legal = _legal_flanges(joints, carriers)
    if flange not in carriers:
        raise InputError(f"{source}: flange {spelled(flange)}: no such link or site; legal: {legal}")
    row = _before(joints, carriers[flange])
    odd = next((joints[i] for i in row if not joints[i].turns or joints[i].follows is not None), None)
    if odd is not None:
        what = f"is of type {spelled(odd.kind)}" if not odd.turns else "follows another (<mimic>)"
        raise InputError(
            f"{odd.place}: {what} and carries the flange {spelled(flange)}; legal: joints that turn by "
            f"themselves. Other flanges: {legal}"
        )
    if len(row) not in LEGAL_COUNTS:
        raise InputError(
            f"{source}: flange {spelled(flange)}: carried by {_names(joints, row)}; {_LEGAL}, which carry "
            f"{legal}"
        )
    return row


def _legal_flanges(joints: Sequence[MovingJoint], carriers: Mapping[str, int | None]) -> str:
    names = [name for name, last in carriers.items() if name and _is_arm(joints, _before(joints, last))]
    if not names:
        return "none, for no 6 or 7 joints turn one after the other"
    return ", ".join([*names[:_MOST_NAMED], *(["…"] if len(names) > _MOST_NAMED else [])])


def _trunk(joints: Sequence[MovingJoint], carriers: Mapping[str, int | None], source: str) -> tuple[int, ...]:
    """Return the joints from the base up to a gripper's or the last."""
    row: tuple[int, ...] = ()
    while True:
        here = row[-1] if row else None
        hanging = [i for i, joint in enumerate(joints) if joint.before == here]
        grippers = _grippers(joints, hanging)
        own = [i for i in hanging if i not in grippers]
        if len(own) != 1 or (len(row) in LEGAL_COUNTS and len(hanging) > 1):
            break
        row = (*row, own[0])
    if len(row) in LEGAL_COUNTS:
        return row
    if len(own) > 1:
        first, second = (joints[i] for i in own[:2])
        raise InputError(
            f"{second.place}: moves beside joint {spelled(first.name)}; legal: one joint after the other, or "
            f"a flange that says whose arm is meant: {_legal_flanges(joints, carriers)}"
        )
    if len(row) > max(LEGAL_COUNTS):
        raise InputError(
            f"{source}: {_names(joints, row)}; {_LEGAL}. A flange says where the arm ends: "
            f"{_legal_flanges(joints, carriers)}"
        )
    if hanging:
        end = joints[hanging[0]]
        raise InputError(
            f"{end.place}: {_why_a_grippers(joints, end)}, behind {_names(joints, row)}; {_LEGAL} that "
            "turn by themselves"
        )
    raise InputError(f"{source}: {_names(joints, row)}; {_LEGAL}")


def _why_a_grippers(joints: Sequence[MovingJoint], joint: MovingJoint) -> str | None:
    """Return what shows that a joint is not the arm's; None: nothing does."""
    if not joint.turns:
        return f"type {spelled(joint.kind)} does not turn"
    if joint.follows is not None:
        return "a <mimic> joint follows another"
    if any(other.follows == joint.name for other in joints):
        return "other joints follow it (<mimic>)"
    if _OF_GRIPPERS.search(joint.name):
        return "taken for a gripper's by its name"
    return None


def _names(joints: Sequence[MovingJoint], row: Sequence[int]) -> str:
    names = ", ".join(joints[i].name for i in row[:12])
    return f"{len(row)} joint{'s' if len(row) > 1 else ''} ({names})" if row else "no joint"
