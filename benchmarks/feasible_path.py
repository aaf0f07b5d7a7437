"""Has a study's scene a solution? A search that knows nothing of this project's planner.

RRT-Connect (Kuffner and LaValle, 2000) of OMPL, over poses of a free camera or over the joints of an arm,
to the joint configurations nearest to its start that reach the goal. A place is legal where everything holds
that a run is scored by, and every point is in the true camera's image and not hidden by a ball; with an arm
joints are within their ranges, no two bodies touch, and the arm is not singular, for there every method is
stopped. Motions are checked in steps of `STEP`, and a path that is found again in a fifth of that.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from itertools import islice, pairwise
from typing import Any

import numpy as np
from ompl import base, geometric, util
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.errors import InputError
from omniservo.geometry.arrays import FloatArray
from omniservo.robots.arm import LENGTH_SCALE, SINGULAR_VALUE
from omniservo.robots.kinematics.twist_matrix import twist_matrix
from omniservo.studies.placed_arm import PlacedArm
from omniservo.studies.study_scene import StudyScene

STEP = 0.01
"""[m], [rad] between places of a motion"""
FINER = 5
GOALS = 4
"""joint configurations at the goal"""
AROUND = 1.0
"""[rad] Joints stay so near to the box of start and goals."""
RANGE = 0.3
"""[rad] that a tree of joint configurations grows by"""
ROOM = 0.75
"""times the distance of start and target: how far from the box of both ends a free camera may go"""

Legal = Callable[[FloatArray], bool]

util.setLogLevel(util.LogLevel.LOG_ERROR)
util.RNG.setSeed(1)


def has_path(scene: StudyScene, seconds: float) -> bool:
    """Return whether a path is found within so many seconds."""
    if scene.arm is None:
        return _searched(*_of_poses(scene), seconds)
    return _searched(*_of_joints(scene, scene.arm), seconds)


def sees_all(scene: StudyScene, axes: FloatArray, centre: FloatArray) -> bool:
    """Return whether a camera with these axes (3, 3) is clear of all balls and sees every point."""
    for ball in scene.obstacles:
        if np.linalg.norm(centre - ball.center) < ball.radius + scene.clearance:
            return False
    if not scene.shown((scene.points - centre) @ axes)[1].all():
        return False
    return not scene.obstacles or not scene.hidden(scene.points, centre).any()


def _of_poses(scene: StudyScene) -> tuple[Any, Legal, list[FloatArray]]:
    """Return the space, what is legal in it, and start and goal: centre and quaternion (7,)."""
    space, end = base.SE3StateSpace(), scene.initial_T_goal
    bounds = base.RealVectorBounds(3)
    room = ROOM * float(np.linalg.norm(scene.points.mean(axis=0)))
    for axis, last in enumerate(end.translation.tolist()):
        bounds.setLow(axis, min(0.0, last) - room)
        bounds.setHigh(axis, max(0.0, last) + room)
    space.setBounds(bounds)

    def legal(place: FloatArray) -> bool:
        return sees_all(scene, Rotation.from_quat(place[3:]).as_matrix(), place[:3])

    ends = RigidTransform.identity(), end
    return space, legal, [np.concatenate((p.translation, p.rotation.as_quat())) for p in ends]


def _of_joints(scene: StudyScene, placed: PlacedArm) -> tuple[Any, Legal, list[FloatArray]]:
    """Return the space, what is legal in it, the start, and the goals nearest to it: joints (n,)."""
    arm, setting, mount = placed.arm, placed.true_setting(), placed.flange_T_camera.as_matrix()
    bodies, initial_T_base = setting.bodies(scene.obstacles), placed.base_T_initial.inv().as_matrix()
    to_camera = twist_matrix(placed.flange_T_camera)

    def legal(q: FloatArray) -> bool:
        flange, jacobian = arm.locate(q)
        scaled = to_camera @ jacobian
        scaled[:3] /= LENGTH_SCALE
        pose = initial_T_base[:3, :3] @ flange[:, :3], initial_T_base[:3, :3] @ flange[:, 3]
        centre = pose[0] @ mount[:3, 3] + pose[1] + initial_T_base[:3, 3]
        if not sees_all(scene, pose[0] @ mount[:3, :3], centre):
            return False
        if np.linalg.svd(scaled, compute_uv=False)[-1] < SINGULAR_VALUE:
            return False
        bodies.place(q)
        return not bodies.near(0.0)

    try:
        goals = arm.inverse(setting.base_T_flange(scene.initial_T_goal))
    except InputError:
        goals = np.empty((0, arm.dof))
    by_distance = sorted(goals, key=lambda q: float(np.abs(q - placed.start).max()))
    nearest = list(islice(filter(legal, by_distance), GOALS))
    ends = [placed.start, *nearest]
    space, bounds = base.RealVectorStateSpace(arm.dof), base.RealVectorBounds(arm.dof)
    low = np.maximum(arm.joint_range[:, 0], np.min(ends, axis=0) - AROUND)
    high = np.minimum(arm.joint_range[:, 1], np.max(ends, axis=0) + AROUND)
    for joint in range(arm.dof):
        bounds.setLow(joint, float(low[joint]))
        bounds.setHigh(joint, float(high[joint]))
    space.setBounds(bounds)
    return space, legal, ends


def _searched(space: Any, legal: Legal, ends: list[FloatArray], seconds: float) -> bool:
    setup = geometric.SimpleSetup(space)
    information = setup.getSpaceInformation()
    setup.setStateValidityChecker(lambda state: bool(legal(_place(space, state))))
    space.setLongestValidSegmentFraction(STEP / space.getMaximumExtent())
    start, *goals = [_state(space, end) for end in ends]
    aim = base.GoalStates(information)
    for goal in goals:
        aim.addState(goal)
    setup.setStartState(start)
    setup.setGoal(aim)
    planner = geometric.RRTConnect(information)
    if not isinstance(space, base.SE3StateSpace):
        planner.setRange(RANGE)
    setup.setPlanner(planner)
    if not goals or not setup.solve(seconds) or not setup.haveExactSolutionPath():
        return False
    path = setup.getSolutionPath()
    states = [path.getState(i) for i in range(path.getStateCount())]
    return all(legal(place) for a, b in pairwise(states) for place in _between(space, a, b))


def _between(space: Any, begin: Any, end: Any) -> Iterator[FloatArray]:
    """Yield the places of a motion."""
    count, there = math.ceil(FINER * space.distance(begin, end) / STEP) + 1, space.allocState()
    for k in range(count + 1):
        space.interpolate(begin, end, k / count, there)
        yield _place(space, there)


def _place(space: Any, state: Any) -> FloatArray:
    if isinstance(space, base.SE3StateSpace):
        q = state.rotation()
        return np.array([state.getX(), state.getY(), state.getZ(), q.x, q.y, q.z, q.w])
    return np.array([state[k] for k in range(space.getDimension())])


def _state(space: Any, place: FloatArray) -> Any:
    state = space.allocState()
    if isinstance(space, base.SE3StateSpace):
        state.setXYZ(*place[:3].tolist())
        q = state.rotation()
        q.x, q.y, q.z, q.w = place[3:].tolist()
    else:
        for k, value in enumerate(place.tolist()):
            state[k] = value
    return state
