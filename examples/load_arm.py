"""Read an arm from a URDF file: kinematics, limits, and the bodies that can be touched.

Prints joints and limits, how far the arm reaches, where its flange is, how many postures reach the same pose,
and how near each link is to a table. `omniservo robot show arm.urdf` says more, and draws the arm.
"""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.robots import ArmBodies, Solid, link_gaps, load_arm

# A made-up arm; name the file of yours instead. Joint: place on the link before [m], axis, range [rad].
JOINTS = (
    ("pan", "0 0 0.15", "0 0 1", 2.9),
    ("lift", "0 0 0.15", "0 1 0", 2.0),
    ("elbow", "0 0 0.30", "0 1 0", 2.4),
    ("roll", "0 0 0.15", "0 0 1", 3.3),
    ("pitch", "0 0 0.15", "0 1 0", 2.0),
    ("turn", "0 0 0.10", "0 0 1", 3.3),
)
LINK = """<link name="{name}"><collision><origin xyz="0 0 0.05"/>
  <geometry><cylinder radius="0.04" length="0.1"/></geometry></collision></link>"""
JOINT = """<joint name="{name}" type="revolute"><origin xyz="{xyz}"/><parent link="{parent}"/>
  <child link="{name}_link"/><axis xyz="{axis}"/>
  <limit lower="-{most}" upper="{most}" velocity="2" effort="50"/></joint>"""


def urdf() -> str:
    parts, parent = [LINK.format(name="base")], "base"
    for name, xyz, axis, most in JOINTS:
        parts.append(JOINT.format(name=name, xyz=xyz, axis=axis, most=most, parent=parent))
        parent = f"{name}_link"
        parts.append(LINK.format(name=parent))
    return "\n".join(['<robot name="made-up">', *parts, "</robot>"])


def main() -> None:
    Path("out").mkdir(exist_ok=True)
    Path("out/arm.urdf").write_text(urdf())
    arm = load_arm("out/arm.urdf")
    print(arm, *arm.notices, sep="\n  ")
    ranges, speeds = np.degrees(arm.joint_range), np.degrees(arm.joint_speed)
    for name, (low, high), speed in zip(arm.joint_names, ranges, speeds, strict=True):
        print(f"{name}: {low:.0f} … {high:.0f} deg, {speed:.0f} deg/s")

    q = np.radians([10.0, 40.0, 70.0, 0.0, 50.0, 0.0])
    flange = arm.base_T_flange(q)
    print(f"flange at {1e3 * flange.translation.round(4)} mm; {len(arm.inverse(flange))} postures reach it")

    table = Solid.box("table", RigidTransform.from_translation([0.4, 0.0, 0.1]), [0.3, 0.4, 0.02])
    for link, gap in link_gaps(ArmBodies(arm, surroundings=[table]), [q]).items():
        print(f"{link} to the table: {1e3 * gap[0]:.0f} mm")


if __name__ == "__main__":
    main()
