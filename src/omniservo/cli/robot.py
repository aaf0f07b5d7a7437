"""``omniservo robot``."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from omniservo.cli.completion import arm_names
from omniservo.cli.expand import expand
from omniservo.cli.grouped import grouped
from omniservo.cli.hand_eye import calibrate_hand_eye
from omniservo.cli.measure_tube import measure_tube
from omniservo.cli.output import Output, refuse_file
from omniservo.cli.robot_live import check, delay
from omniservo.cli.robot_options import PackageOption, packages_of
from omniservo.files import made_folder

if TYPE_CHECKING:
    from scipy.spatial.transform import RigidTransform

    from omniservo.geometry.arrays import FloatArray
    from omniservo.robots import Arm, Link, Solid

app = typer.Typer(help="Show robot arms; calibrate a camera on one (eye-in-hand).", no_args_is_help=True)
app.command("calibrate-hand-eye")(calibrate_hand_eye)
app.command("measure-tube")(measure_tube)
app.command("expand")(expand)
app.command("check")(check)
app.command("delay")(delay)


@app.command("show")
@grouped
def show(
    robot: Annotated[
        str,
        typer.Argument(help="An MJCF or URDF file, or a shipped arm's name.", autocompletion=arm_names),
    ],
    *,
    flange: Annotated[
        str | None, typer.Option("--flange", help="The site or link that carries the camera.")
    ] = None,
    tool: Annotated[str | None, typer.Option("--tool", hidden=True)] = None,
    out: Annotated[Path | None, typer.Option("--out", help="Draw the arm into this folder.")] = None,
    package: PackageOption = None,
    output: Output,
) -> None:
    """Print an arm: joints, reach, links, suggested start configuration and mount, what was left out."""
    refuse_file(out)
    if tool is not None:
        output.line(f"{'notice':<14} --tool is called --flange now")
    with output.working("loading") as progress:
        from omniservo.robots import load_arm, suggested_mount, suggested_posture, suggested_table

        progress(f"reading {robot}")
        arm = load_arm(robot, flange=flange or tool, packages=packages_of(package))
        progress("looking for a start configuration")
        posture, mount = suggested_posture(arm), suggested_mount(arm)
        table = suggested_table(arm, mount, posture)
    _say_arm(arm, output)
    joints, wide = _joints(arm), max(map(len, [*arm.joint_names, *(link.name for link in arm.links)]))
    for joint in joints:
        output.line(_spelled_joint(joint, wide))
    for link in arm.links:
        output.line(f"{'link':<14} {_spelled_link(link, wide)}")
    output.line(
        f"{'configuration':<14} {_spelled_posture(posture)} deg: to start with, as start.joints of a task"
    )
    output.line(
        f"{'mount':<14} {_spelled_mount(mount)} mm, deg: a flange_T_camera that looks along the last axis"
    )
    if table is not None:
        output.line(f"{'table':<14} {_spelled_table(table)} mm: under what that camera sees, as surroundings")
    for notice in arm.notices:
        output.line(f"{'notice':<14} {notice}")
    if out is not None:
        with output.working("drawing"):
            from omniservo.reporting.arm_figure import draw_arm
            from omniservo.reporting.figure_files import write_drawings

            with made_folder(out) as folder:
                drawn = write_drawings(draw_arm(arm, posture), folder)
        for path in drawn:
            output.written(path)
    output.result(_fields(arm, posture, mount, table), "robot-show")


def _fields(arm: Arm, posture: FloatArray, mount: RigidTransform, table: Solid | None) -> dict[str, Any]:
    return {
        "name": arm.name,
        "joints": _joints(arm),
        "reach": arm.reach,
        "flange": {
            "name": arm.flange,
            "link": arm.flange_link,
            "link_T_flange": arm.link_T_flange.as_matrix(),
        },
        "flange_T_camera": mount.as_matrix(),
        "posture": posture.tolist(),
        "table": None if table is None else _table(table),
        "closed_form": arm.has_closed_form,
        "links": [_link(link) for link in arm.links],
        "notices": list(arm.notices),
    }


def _say_arm(arm: Arm, output: Output) -> None:
    """Say what arm it is, as a whole."""
    output.line(f"{'arm':<14} {arm.name}: {arm.dof} revolute joints ({arm.path.name})")
    output.line(f"{'flange':<14} {arm.flange!r}, on link {arm.flange_link!r}")
    output.line(f"{'reach':<14} {arm.reach:.3f} m from the axis of {arm.joint_names[0]}")
    known = "closed form, all branches" if arm.has_closed_form else "seeded numeric search"
    output.line(f"{'inverse':<14} {known}")


def _joints(arm: Arm) -> list[dict[str, Any]]:
    return [
        {
            "name": name,
            "type": "revolute",
            "lower": float(arm.joint_range[i, 0]),
            "upper": float(arm.joint_range[i, 1]),
            "speed": float(arm.joint_speed[i]),
            "acceleration": float(arm.joint_acceleration[i]),
            "effort": None if arm.joint_effort is None else float(arm.joint_effort[i]),
        }
        for i, name in enumerate(arm.joint_names)
    ]


def _spelled_joint(joint: dict[str, Any], wide: int) -> str:
    lower, upper, speed, acceleration = np.rad2deg(
        [joint[name] for name in ("lower", "upper", "speed", "acceleration")]
    )
    effort = "" if joint["effort"] is None else f"  {joint['effort']:6g} N m"
    return (
        f"{'joint':<14} {joint['name']:<{wide}} {lower:7.1f} … {upper:6.1f} deg  {speed:6.1f} deg/s"
        f"  {acceleration:7.1f} deg/s²{effort}"
    )


def _spelled_mount(mount: RigidTransform) -> str:
    """Spell a mount as a task writes it, in mm and degrees."""
    rows = (1e3 * mount.translation, np.rad2deg(mount.rotation.as_rotvec()))
    shown = (", ".join(f"{number:.4g}" for number in np.round(row, 2) + 0.0) for row in rows)
    return "{{translation: [{}], rotation_vector: [{}]}}".format(*shown)


def _table(table: Solid) -> dict[str, Any]:
    return {
        "center": table.pose.translation.tolist(),
        "half_extents": table.size.tolist(),
        "frame": "base",
    }


def _spelled_table(table: Solid) -> str:
    """Spell a table as a task writes it, in mm."""
    rows = (1e3 * table.pose.translation, 1e3 * table.size)
    shown = (", ".join(f"{number:.0f}" for number in row) for row in rows)
    return "{{center: [{}], half_extents: [{}], frame: base}}".format(*shown)


def _spelled_posture(posture: FloatArray) -> str:
    return "[" + ", ".join(f"{angle:z.0f}" for angle in np.rad2deg(posture)) + "]"


def _link(link: Link) -> dict[str, Any]:
    shapes = [{"kind": shape.kind, "extents": list(shape.extents)} for shape in link.shapes]
    return {"name": link.name, "joint": link.joint or None, "shapes": shapes}


def _spelled_link(link: Link, wide: int) -> str:
    counts = Counter(shape.kind for shape in link.shapes)
    made_of = ", ".join(f"{kind} × {count}" for kind, count in counts.items()) or "a frame"
    return f"{link.name:<{wide}} {'on ' + link.joint if link.joint else 'fixed':<{wide + 3}} {made_of}"
