"""From an arm's file to its model."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from omniservo.errors import InputError, spelled
from omniservo.files import read_text
from omniservo.files.own_warnings import own_warnings
from omniservo.files.ros_packages import RosPackages
from omniservo.files.xacro_files import xacro_advice
from omniservo.files.xml_files import parse_elements
from omniservo.geometry.arrays import FloatArray
from omniservo.robots.arm_files.arm_model import ArmModel
from omniservo.robots.arm_files.contacts import choose_contacts, name_shapes
from omniservo.robots.arm_files.description import Description, endless_notice, held_notice
from omniservo.robots.arm_files.drives import add_drives, has_drives
from omniservo.robots.arm_files.hold_rest import hold_rest
from omniservo.robots.arm_files.includes import MOST_BYTES
from omniservo.robots.arm_files.mjcf import SPEED, read_mjcf
from omniservo.robots.arm_files.serial_chain import (
    check_joints,
    find_flange,
    limit_endless,
    name_parts,
)
from omniservo.robots.arm_files.shapes import paint, share_groups
from omniservo.robots.arm_files.urdf import read_urdf
from omniservo.robots.collision.exact_vertices import keep_vertices, on_hull

ASSUMED_SPEED = math.radians(30.0)
"""[rad/s] of every joint of an MJCF that states no speeds, for which the format has no field"""

SPEEDING_UP = 0.25
"""[s] in which a joint is taken to reach its speed where its acceleration is not stated"""

_LEAST_MASS, _LEAST_INERTIA = 1e-3, 1e-6  # [kg], [kg m²] of a link whose file states less or none


def read_arm_file(
    path: str | Path, flange: str | None = None, packages: Mapping[str, str | Path] | None = None
) -> ArmModel:
    """Read a serial arm of 6 or 7 joints that turn from an MJCF or URDF file, which no one need trust.

    Joints that do not carry the flange, as a gripper's, are held still, and said: see `arm_row`.

    The file is bounded in size, holds no document type, and reads no file but meshes and includes inside its
    folder, or meshes in a package that lies among or beside the folders above it, that ``packages`` states,
    or that ROS knows.

    Args:
        path: of the file.
        flange: the site or link that carries the camera; None: the one called ``tool0``, ``flange`` or
            ``attachment_site``, else the last link before a gripper's joints.
        packages: folders of packages by name.

    Raises:
        InputError: anything else; the message names file, element and what is legal.
    """
    file = Path(path)
    root = parse_elements(read_text(file, max_bytes=MOST_BYTES), str(file))
    advice = xacro_advice(root, file)
    if advice is not None:
        raise InputError(f"{file}: {advice}")
    if root.tag == "robot":
        description = read_urdf(root, file, flange, RosPackages(file, packages))
    elif root.tag == "mujoco":
        description = read_mjcf(root, file)
    else:
        raise InputError(
            f"{file}: root element {spelled(root.tag)} given; legal: <robot> (URDF), <mujoco> (MJCF)"
        )
    with _silent():
        return _made_ready(_spec(description, file), description, file, flange)


@contextmanager
def _silent() -> Iterator[None]:
    """Keep MuJoCo's warnings from standard error, and from MUJOCO_LOG.TXT in the working folder."""
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda words: None)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)


def _spec(description: Description, file: Path) -> Any:
    try:
        spec = mujoco.MjSpec.from_string(description.xml, assets=description.assets)
    except ValueError as error:
        raise _unreadable(file, error) from None
    spec.compiler.boundmass = max(spec.compiler.boundmass, _LEAST_MASS)
    spec.compiler.boundinertia = max(spec.compiler.boundinertia, _LEAST_INERTIA)
    for mesh in spec.meshes:
        mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX  # open surfaces have one too
    return spec


def _keep_hulls(spec: Any, vertices: Mapping[str, FloatArray]) -> None:
    """Keep what the file states of the meshes that can be touched."""
    touched = {geom.meshname for geom in spec.geoms if geom.contype or geom.conaffinity}
    for mesh in spec.meshes:
        if mesh.name in touched:
            keep_vertices(spec, mesh, on_hull(vertices[mesh.file or mesh.name]))


def _compiled(spec: Any, file: Path) -> Any:
    try:
        with own_warnings("ignore"):  # of masses and inertias, which drives and bounds make harmless
            return spec.compile()
    except ValueError as error:
        raise _unreadable(file, error) from None


def _unreadable(file: Path, error: ValueError) -> InputError:
    return InputError(f"{file}: MuJoCo cannot read it: {' '.join(str(error).split())[:300]}")


def _speed(description: Description, joints: int, file: Path, notices: list[str]) -> FloatArray:
    """Return the joints' speeds [rad/s]: as stated, or assumed, and said."""
    if description.speed is None:
        notices.append(
            f"joint speeds are not stated; taken: {math.degrees(ASSUMED_SPEED):.0f} deg/s each; to state"
            f' them: <custom><numeric name={SPEED!r} data="180 180 …"/></custom>, one number a joint'
        )
        return np.full(joints, ASSUMED_SPEED)
    if len(description.speed) != joints:
        raise InputError(f"{file}: {len(description.speed)} joint speeds; the arm has {joints} joints")
    return np.array(description.speed)


def _made_ready(spec: Any, description: Description, file: Path, flange: str | None) -> ArmModel:
    notices = list(description.notices)
    renamed = name_parts(spec)
    flange = None if flange is None else renamed.get(flange, flange)
    held, hand = hold_rest(spec, flange, str(file))
    hand |= {renamed.get(name, name) for name in description.hand}
    notices += [held_notice(held)] if held else []
    paint(spec)
    notices += share_groups(spec)
    name_shapes(spec)
    _keep_hulls(spec, description.vertices)
    model = _compiled(spec, file)
    if endless := limit_endless(spec, model):
        notices.append(endless_notice(endless))
        model = _compiled(spec, file)
    check_joints(model, str(file))
    speed = _speed(description, model.njnt, file, notices)
    if description.acceleration is None:
        notices.append(f"accelerations are not stated; taken: full speed in {SPEEDING_UP:g} s")
        acceleration = speed / SPEEDING_UP
    else:
        acceleration = np.array(description.acceleration)
    if len(acceleration) != model.njnt:
        raise InputError(f"{file}: {len(acceleration)} joint accelerations; the arm has {model.njnt} joints")
    for body in spec.bodies:
        body.gravcomp = 1.0
    if not model.ngeom:
        notices.append("no link has a shape: nothing of the arm can be touched, and no contact of it is seen")
    notices += choose_contacts(spec, model)
    if not has_drives(model):
        add_drives(spec, model)
        notices.append("no position servo for every joint; stiff ones are put in for the simulation")
    found = find_flange(model, flange, hand)
    if hand and flange is None:
        notices.append(f"the camera is taken to sit on {found[0]!r}; another link can be named as the flange")
    return ArmModel(spec, _compiled(spec, file), *found, speed, acceleration, tuple(notices))
