"""URDF text of arms that are not shipped, with every number at hand."""

import numpy as np
from scipy.spatial.transform import Rotation

# A 6R of no maker: shoulder and elbow are offset, the wrist is not spherical, axes and frames are oblique.
# name, xyz [m], rpy [rad], axis, lower, upper [rad], velocity [rad/s], effort [N m]
SIX = (
    ("pan", (0, 0, 0.20), (0, 0, 0.3), (0, 0, 1), -2.9, 2.9, 2.0, 120),
    ("lift", (0.05, 0, 0.15), (-1.5707963267948966, 0, 0), (0, 0, 1), -2.0, 1.5, 2.0, 120),
    ("elbow", (0.02, -0.33, 0.01), (0, 0.1, 0), (0, 0, 1), -2.3, 2.3, 2.2, 80),
    ("roll", (0.04, -0.12, 0), (1.5707963267948966, 0, 0), (0, 0, 1), -3.1, 3.1, 3.0, 30),
    ("pitch", (0, 0.01, 0.20), (0, 0, 0), (0, 1, 0), -2.0, 2.0, 3.0, 30),
    ("turn", (0.015, 0, 0.09), (0.05, 0, 0), (0, 0, 1), -6.0, 6.0, 4.0, 20),
)
SEVEN = (*SIX[:3], ("twist", (0, -0.05, 0.02), (0.2, 0, 0), (0, 1, 0), -2.5, 2.5, 2.5, 40), *SIX[3:])
TOOL = ((0, 0, 0.05), (0, 0, 0.5))
"""xyz, rpy of tool0 on the last link"""

_LINK = """<link name="{name}">
  <inertial><origin xyz="0 0 0.05"/><mass value="2"/>
    <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.005"/></inertial>
  <visual><origin xyz="0 0 0.05"/><geometry>{visual}</geometry>
    <material name="orange"><color rgba="0.9 0.4 0.1 1"/></material></visual>
  <collision><origin xyz="0 0 0.04"/><geometry>{collision}</geometry></collision>
</link>"""

_JOINT = """<joint name="{name}" type="revolute">
  <origin xyz="{xyz}" rpy="{rpy}"/><parent link="{parent}"/><child link="{child}"/><axis xyz="{axis}"/>
  <limit lower="{lower}" upper="{upper}" velocity="{velocity}" effort="{effort}"/>
</joint>"""

_FINGER = """<link name="{side}">
  <collision><geometry><box size="0.01 0.02 0.08"/></geometry></collision></link>
<joint name="{joint}" type="{kind}"><origin xyz="{x} 0 0.1"/><parent link="tool0"/><child link="{side}"/>
  <axis xyz="{x} 0 0"/><limit lower="{lower}" upper="0.04" velocity="0.1" effort="20"/>{mimic}</joint>"""

CYLINDER = '<cylinder radius="0.04" length="0.1"/>'


def words(values):
    return " ".join(map(str, values))


def urdf(joints=SIX, *, visual=CYLINDER, collision=CYLINDER, extra=""):
    """The file's text."""
    links = ["base_link", *(f"{row[0]}_link" for row in joints)]
    parts = [_LINK.format(name=name, visual=visual, collision=collision) for name in links]
    for row, parent, child in zip(joints, links, links[1:], strict=False):
        name, xyz, rpy, axis, lower, upper, velocity, effort = row
        parts.append(
            _JOINT.format(
                name=name, xyz=words(xyz), rpy=words(rpy), axis=words(axis), parent=parent, child=child,
                lower=lower, upper=upper, velocity=velocity, effort=effort,
            )
        )  # fmt: skip
    parts.append('<link name="tool0"/>')
    xyz, rpy = TOOL
    parts.append(
        f'<joint name="tool_joint" type="fixed"><origin xyz="{words(xyz)}" rpy="{words(rpy)}"/>'
        f'<parent link="{links[-1]}"/><child link="tool0"/></joint>'
    )
    return "\n".join(['<?xml version="1.0"?>', '<robot name="oblique">', *parts, extra, "</robot>"])


def fingers(*, kind="prismatic", names=("slide_a", "slide_b"), mimic='<mimic joint="slide_a"/>', lower=0.0):
    """Two fingers on tool0, ``extra`` of an arm's text."""
    first = _FINGER.format(side="left", joint=names[0], kind=kind, x=0.02, lower=lower, mimic="")
    return first + _FINGER.format(side="right", joint=names[1], kind=kind, x=-0.02, lower=lower, mimic=mimic)


def urdf_forward(joints, q):
    """The pose (4, 4) of tool0 by the definition of URDF: each origin, then a turn about the axis."""
    pose = np.eye(4)
    for (_, xyz, rpy, axis, *_), angle in zip(joints, q, strict=True):
        unit = np.array(axis) / np.linalg.norm(axis)
        pose = pose @ _frame(xyz, rpy) @ _matrix(Rotation.from_rotvec(angle * unit), (0, 0, 0))
    return pose @ _frame(*TOOL)


def _frame(xyz, rpy):
    return _matrix(Rotation.from_euler("xyz", rpy), xyz)  # roll, pitch, yaw about fixed axes


def _matrix(rotation, place):
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation.as_matrix(), place
    return pose
