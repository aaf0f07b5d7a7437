"""The joints of a URDF that are not the arm's, held still at their zero: where that puts their links."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.errors import InputError, spelled
from omniservo.files.xml_files import XmlElement
from omniservo.geometry.arrays import FloatArray
from omniservo.robots.arm_files.xml_fields import XmlFields


def held_positions(joints: Sequence[XmlElement], fields: XmlFields) -> dict[str, float]:
    """Return where each joint stands [rad], [m], by name: at zero, or at the end of its range that is nearer.

    One that copies another stands where that puts it.

    Raises:
        InputError: it copies a joint that is not among them, or itself on the way.
    """
    by_name = {fields.text(joint, "name"): joint for joint in joints}
    return {name: _position(joint, by_name, fields) for name, joint in by_name.items()}


def spelled_positions(joints: Sequence[XmlElement], positions: dict[str, float]) -> list[str]:
    """Return each joint and where it stands, for people."""
    words = []
    for joint in joints:
        name = joint.get("name", "").strip()
        slides = joint.get("type") == "prismatic"
        at = f"{1e3 * positions[name]:g} mm" if slides else f"{math.degrees(positions[name]):g} deg"
        words.append(f"{name} at {at}")
    return words


def moved_origin(joint: XmlElement, position: float, fields: XmlFields) -> tuple[FloatArray, FloatArray]:
    """Return xyz [m] and rpy [rad] (3,) of what a joint carries, as it stands at a position [rad], [m]."""
    origin, axis = fields.only(joint, "origin"), axis_of(joint, fields)
    given = [
        np.zeros(3) if origin is None or not origin.get(name) else fields.numbers(origin, name, 3)
        for name in ("xyz", "rpy")
    ]
    here = RigidTransform.from_components(given[0], Rotation.from_euler("xyz", given[1]))
    unit = axis / np.linalg.norm(axis)
    if joint.get("type") == "prismatic":
        there = here * RigidTransform.from_translation(position * unit)
    else:
        there = here * RigidTransform.from_rotation(Rotation.from_rotvec(position * unit))
    return np.asarray(there.translation), there.rotation.as_euler("xyz", suppress_warnings=True)


def axis_of(joint: XmlElement, fields: XmlFields) -> FloatArray:
    """Return the direction (3,) of a joint's axis, x where the file does not say.

    Raises:
        InputError: it has no length.
    """
    axis = fields.only(joint, "axis")
    if axis is None:
        return np.array([1.0, 0.0, 0.0])
    direction = fields.numbers(axis, "xyz", 3)
    if not direction.any():
        raise InputError(f"{fields.place(joint)}: axis: 0 0 0 given; legal: a direction")
    return direction


def _position(joint: XmlElement, by_name: dict[str, XmlElement], fields: XmlFields) -> float:
    factor, shift = 1.0, 0.0
    for _ in by_name:
        mimic = fields.only(joint, "mimic")
        if mimic is None:
            return shift + factor * _rest(joint, fields)
        followed = fields.text(mimic, "joint")
        if followed not in by_name:
            raise InputError(f"{fields.place(mimic)}: joint {spelled(followed)}: no such joint that moves")
        multiplier, offset = (
            float(fields.numbers(mimic, name, 1)[0]) if mimic.get(name) else default
            for name, default in (("multiplier", 1.0), ("offset", 0.0))
        )
        factor, shift = factor * multiplier, shift + factor * offset
        joint = by_name[followed]
    raise InputError(f"{fields.place(joint)}: <mimic> joints follow each other in a ring; legal: one leads")


def _rest(joint: XmlElement, fields: XmlFields) -> float:
    limit = fields.only(joint, "limit")
    if limit is None or joint.get("type") == "continuous":
        return 0.0
    low, high = (
        float(fields.numbers(limit, name, 1)[0]) if limit.get(name) else 0.0 for name in ("lower", "upper")
    )
    return min(max(0.0, low), high)
