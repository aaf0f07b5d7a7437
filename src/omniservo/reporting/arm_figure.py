"""An arm drawn: its links in a bent configuration, its joints and flange, and how far each joint turns."""

from __future__ import annotations

import math
from itertools import product
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from scipy.spatial.transform import RigidTransform

from omniservo.cameras import preset
from omniservo.geometry.arrays import FloatArray
from omniservo.reporting.style import EXECUTED, PLANNED, QUIET, THREE, Drawing, new_figure, styled
from omniservo.robots import Arm
from omniservo.scenes import Scene
from omniservo.simulation import OutsideView, Viewpoint, World

_PICTURE = 720
"""[px] side of the image"""
_AXIS = 0.14
"""length of the flange's axes over the arm's size"""
_FILLED = 0.92
"""part of the image's height or width that the arm takes"""
_CORNERS = np.array(list(product((-1.0, 1.0), repeat=3)))
_MARK = 36
"""[px] marks that are nearer would cover each other"""


def draw_arm(arm: Arm, q: FloatArray) -> list[Drawing]:
    """Return the arm in a joint configuration (n,) [rad], beside its joints' ranges and speeds."""
    world = World(_scene(arm, q))
    data = world.data_at(q)
    viewpoint, axis = _viewpoint(arm, world, data)
    view = OutsideView(world, viewpoint, width=_PICTURE, height=_PICTURE, shows_camera=False)
    with styled():
        figure = new_figure(10.2, 5.2)
        picture, ranges = figure.subplots(1, 2, width_ratios=(1.0, 1.0))
        picture.imshow(view.render(q))
        picture.set_axis_off()
        picture.set_title("at the flange: x red, y green, z blue", fontsize=9, fontweight="normal")
        _mark_joints(picture, view, data)
        _mark_flange(picture, view, _flange_axes(arm, q, axis))
        _draw_ranges(ranges, arm)
    posture = ", ".join(f"{angle:z.0f}" for angle in np.rad2deg(q))
    caption = (
        f"Joints {posture} deg. Numbers: joints, from the base outwards. Lines from the flange: x red, "
        "y green, z blue. Bars: ranges, with the speed at their ends."
    )
    return [Drawing("arm", arm.name, caption, figure)]


def _scene(arm: Arm, q: FloatArray) -> Scene:
    nowhere = RigidTransform.identity()
    return Scene(arm, nowhere, nowhere, preset("perspective"), q)


def _viewpoint(arm: Arm, world: World, data: Any) -> tuple[Viewpoint, float]:
    """Return the view across the arm, from its right and a little above, and the flange's axes' length [m].

    With a, b, c a corner's coordinates to the right, upwards and towards the eye, which is at (a₀, b₀, d),
    it is shown where |a − a₀| and |b − b₀| are at most T (d − c): the least d and the middle of both.
    """
    model = world.model
    shown = world.arm_geoms[model.geom_bodyid[world.arm_geoms] != model.body("camera").id]
    boxes, turns = model.geom_aabb[shown], data.geom_xmat[shown].reshape(-1, 3, 3)
    corners = boxes[:, None, :3] + _CORNERS * boxes[:, None, 3:]
    corners = (data.geom_xpos[shown, None] + corners @ turns.transpose(0, 2, 1)).reshape(-1, 3)
    corners = np.vstack([corners, data.xanchor])  # an arm may have no shapes
    size = float(np.linalg.norm(np.ptp(corners, axis=0)))
    corners = np.vstack([corners, _flange_axes(arm, data.qpos, _AXIS * size)])
    ahead = arm.base_T_flange(data.qpos).translation[:2]
    length = float(np.linalg.norm(ahead))
    forward = ahead / length if length > 0.05 * size else np.array([1.0, 0.0])
    aside = np.array([forward[1], -forward[0]])
    way = np.append(0.45 * forward + 0.8 * aside, 0.35)
    way /= np.linalg.norm(way)
    right = np.cross([0.0, 0.0, 1.0], way)
    right /= np.linalg.norm(right)
    across = np.stack([right, np.cross(way, right)])
    T = _FILLED * math.tan(0.5 * Viewpoint.field_of_view)
    sides, towards = corners @ across.T, T * (corners @ way)[:, None]
    most, least = (sides + towards).max(axis=0), (sides - towards).min(axis=0)
    focus = 0.5 * (most + least) @ across
    eye = focus + float((most - least).max()) / (2.0 * T) * way
    return Viewpoint(tuple(eye.tolist()), tuple(focus.tolist())), _AXIS * size


def _flange_axes(arm: Arm, q: FloatArray, length: float) -> FloatArray:
    """Return the flange's origin and the ends of its axes (4, 3), in the base frame [m]."""
    ends: FloatArray = arm.base_T_flange(q).apply(np.vstack([np.zeros(3), length * np.eye(3)]))
    return ends


def _mark_joints(axes: Axes, view: OutsideView, data: Any) -> None:
    """Number the joints; those that are drawn on one another share a mark."""
    groups: list[tuple[FloatArray, list[str]]] = []
    for number, place in enumerate(view.project(data.xanchor), 1):
        near = [names for other, names in groups if math.dist(place, other) < _MARK]
        if near:
            near[0].append(str(number))
        else:
            groups.append((place, [str(number)]))
    for (u, v), names in groups:
        box = {"boxstyle": "round,pad=0.3", "fc": "white", "ec": EXECUTED, "alpha": 0.9}
        axes.text(u, v, ", ".join(names), ha="center", va="center", color=EXECUTED, weight="bold", bbox=box)


def _mark_flange(axes: Axes, view: OutsideView, ends: FloatArray) -> None:
    start, *tips = view.project(ends)
    for tip, colour in zip(tips, ("#d1001c", THREE[2], "#0050d8"), strict=True):
        axes.annotate("", tip, start, arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 1.8})


def _draw_ranges(axes: Axes, arm: Arm) -> None:
    low, high = np.rad2deg(arm.joint_range.T)
    places = np.arange(1, arm.dof + 1)
    axes.barh(places, high - low, left=low, height=0.5, color=PLANNED, alpha=0.55)
    for place, first, last, speed in zip(
        places.tolist(), low.tolist(), high.tolist(), np.rad2deg(arm.joint_speed).tolist(), strict=True
    ):
        for angle, side in ((first, "left"), (last, "right")):
            box = {"facecolor": "white", "edgecolor": "none", "pad": 0.5}
            axes.text(angle, place - 0.42, _degrees(angle), ha=side, va="center", fontsize=8, bbox=box)
        axes.text(
            0.5 * (first + last), place, f"{speed:.0f} °/s", ha="center", va="center", fontsize=9,
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.9, "pad": 1.5},
        )  # fmt: skip
    axes.use_sticky_edges = False
    axes.margins(x=0.04)
    axes.set_ylim(arm.dof + 0.4, 0.35)
    axes.axvline(0.0, color=QUIET, lw=0.8)
    names = [f"{number} {name}" for number, name in enumerate(arm.joint_names, 1)]
    axes.set_yticks(places, names)
    axes.grid(axis="y", visible=False)
    axes.set_xlabel("joint position [deg]; on the bars: highest speed")
    axes.set_title(f"{arm.name}: reaches {arm.reach:.2f} m from its first axis")


def _degrees(angle: float) -> str:
    return f"{angle:z.0f}°".replace("-", "−")
