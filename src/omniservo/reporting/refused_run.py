"""Why a task was refused at planning, drawn."""

from __future__ import annotations

import textwrap

import numpy as np
from matplotlib.patches import Polygon
from scipy.spatial import ConvexHull

from omniservo.geometry.arrays import FloatArray
from omniservo.planning import Cloud, HalfSpace, Plan, worst_moment
from omniservo.reporting.moment_figure import draw_moment
from omniservo.reporting.style import CERTIFIED, Drawing, new_axes, styled
from omniservo.scenes.scene import Scene
from omniservo.simulation import OutsideView, World
from omniservo.whole_arm import ArmSetting

_DIRECTIONS = np.random.default_rng(0).standard_normal((400, 3))
_DIRECTIONS /= np.linalg.norm(_DIRECTIONS, axis=1, keepdims=True)
"""all over the unit sphere"""
_LEAST = 1e-3
"""[m] a point is drawn so large"""


def draw_refused_run(plan: Plan, scene: Scene, setting: ArmSetting, posture: FloatArray) -> Drawing:
    """Return the worst moment of a refused plan: the camera's own, or else the arm in the world there.

    Args:
        plan: not certified.
        scene: the world of the task.
        setting: the arm, and what it has to keep.
        posture: (n,) joints where the arm fails [rad].
    """
    worst = worst_moment(plan)
    if worst is not None and worst.margin < 0.0:
        return draw_moment(plan)
    view = OutsideView(World(scene), width=960, height=720)
    title = f"{plan.status}: {plan.reason}"
    with styled():
        figure, axes = new_axes(9.0, 7.2)
        axes.imshow(view.render(posture))
        axes.set_axis_off()
        figure.suptitle(textwrap.fill(title, 92), x=0.01, ha="left", fontsize=11)
        for outline in _outlines(plan, scene, setting, view):
            axes.add_patch(Polygon(outline, closed=True, fc=f"{CERTIFIED}30", ec=CERTIFIED, lw=1.4, ls="--"))
        place = _nearest(plan, scene, setting, posture)
        if place is not None:
            u, v = view.project(place)
            axes.plot(u, v, "o", ms=34, mfc="none", mec=CERTIFIED, mew=2.6)
    caption = (
        "The arm where it fails. Dashed: obstacles as the planner knows them. Ring: where two bodies lack "
        "most of the required distance."
    )
    return Drawing("refused", title, caption, figure)


def _outlines(plan: Plan, scene: Scene, setting: ArmSetting, view: OutsideView) -> list[FloatArray]:
    """Return outlines (k, 2) [px] of the planner's obstacles in the image; half-spaces have none."""
    world_T_initial = scene.world_T_base * setting.base_T_initial
    outlines = []
    for obstacle in plan.problem.obstacles:
        if not isinstance(obstacle, HalfSpace | Cloud):
            corners, radius = obstacle.core.outline()
            radius = max(radius, _LEAST)
            around = (corners[:, None] + radius * _DIRECTIONS).reshape(-1, 3)
            seen = view.project(world_T_initial.apply(around))
            outlines.append(seen[ConvexHull(seen).vertices])
    return outlines


def _nearest(plan: Plan, scene: Scene, setting: ArmSetting, posture: FloatArray) -> FloatArray | None:
    """Return the place (3,) in the world where a pair lacks most of its clearance; None: none lacks any."""
    bodies = setting.bodies(plan.problem.obstacles)
    bodies.place(posture)
    asked = bodies.asked(setting.clearance_around, setting.self_clearance)
    near = bodies.near(float(asked.max(initial=0.0)))
    short = [(float(asked[one.pair]) - one.gap, one.place) for one in near]
    lacking = [(amount, place) for amount, place in short if amount > 0.0]
    if not lacking:
        return None
    place = max(lacking, key=lambda one: one[0])[1]
    return np.asarray(scene.world_T_base.apply(place))
