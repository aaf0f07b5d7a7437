"""RRTConnect (Kuffner, LaValle) of OMPL, in SE(3).

Space: a box `ROOM` · ℓ around both ends, and every rotation. A motion is checked at poses close to each other
(`motion_check`) in one call from OMPL: by a Numba kernel, or by NumPy over its poses at once. The answer is
the planner's polyline as it is, without smoothing.

Not counted: the import, the set-up of space and planner (``build_seconds``), the compilation of the kernel.
The planner is random: seeded once, at import, so that figures depend on the order of calls.
"""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter
from typing import Any

import numpy as np
from benchmarks.comparisons.planning.attempt import Attempt, Polyline
from benchmarks.comparisons.planning.neutral import Neutral
from benchmarks.comparisons.planning.peers.motion_check import motion_is_free, motion_is_free_numpy
from ompl import base, geometric, util

from omniservo.geometry.arrays import FloatArray
from omniservo.planning import PlanningProblem

CALLBACKS = "Numba, called from Python once a motion"
CALLBACKS_NUMPY = "NumPy, called from Python once a motion"

ROOM = 0.75
"""of ℓ: how far from the box of both ends a path may go"""

Check = Callable[[Neutral, FloatArray, FloatArray], bool]

util.setLogLevel(util.LogLevel.LOG_ERROR)
util.RNG.setSeed(1)


class _Motions(base.MotionValidator):  # type: ignore[misc]
    """Asks a compiled or vectorised check, once for a whole motion."""

    def __init__(self, information: Any, check: Callable[[FloatArray, FloatArray], bool]) -> None:
        super().__init__(information)
        self._check = check

    def checkMotion(self, start: Any, end: Any, *_: Any) -> bool:
        """Tell whether the motion keeps everything; its start is known to."""
        return self._check(pose_of(start), pose_of(end))


def pose_of(state: Any) -> FloatArray:
    """Return centre and quaternion (7,) of an SE(3) state."""
    q = state.rotation()
    return np.array([state.getX(), state.getY(), state.getZ(), q.x, q.y, q.z, q.w])


def solve(problem: PlanningProblem, neutral: Neutral, budget: float) -> Attempt:
    """Return the polyline that RRTConnect finds within ``budget`` [s], checked by the compiled kernel."""
    return _solve(neutral, budget, motion_is_free)


def solve_numpy(problem: PlanningProblem, neutral: Neutral, budget: float) -> Attempt:
    """Return the same, checked by NumPy."""
    return _solve(neutral, budget, motion_is_free_numpy)


def _solve(neutral: Neutral, budget: float, check: Check) -> Attempt:
    begin = perf_counter()
    calls = [0]

    def free(start: FloatArray, end: FloatArray) -> bool:
        calls[0] += 1
        return check(neutral, start, end)

    setup = _setup(neutral, free)
    building = perf_counter() - begin
    begin = perf_counter()
    status = setup.solve(budget)
    seconds = perf_counter() - begin
    facts = {"build_seconds": building, "motions": float(calls[0])}
    if not setup.haveExactSolutionPath():
        return Attempt(False, None, seconds, str(status.asString()), facts)
    path = setup.getSolutionPath()
    poses = np.array([pose_of(path.getState(i)) for i in range(path.getStateCount())])
    return Attempt(True, Polyline(poses[:, 3:], poses[:, :3]), seconds, facts=facts)


def _setup(neutral: Neutral, free: Callable[[FloatArray, FloatArray], bool]) -> Any:
    space = base.SE3StateSpace()
    bounds, room = base.RealVectorBounds(3), ROOM * neutral.ell
    for axis, last in enumerate(neutral.translation):
        bounds.setLow(axis, min(0.0, float(last)) - room)
        bounds.setHigh(axis, max(0.0, float(last)) + room)
    space.setBounds(bounds)
    setup = geometric.SimpleSetup(space)
    information = setup.getSpaceInformation()
    setup.setStateValidityChecker(lambda state: free(pose_of(state), pose_of(state)))
    information.setMotionValidator(_Motions(information, free))
    setup.setStartAndGoalStates(
        _state(space, np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0])),
        _state(space, neutral.translation, neutral.quaternion),
    )
    setup.setPlanner(geometric.RRTConnect(information))
    setup.setup()
    return setup


def _state(space: Any, t: FloatArray, quaternion: FloatArray) -> Any:
    state = space.allocState()
    state.setXYZ(*(float(v) for v in t))
    rotation = state.rotation()
    rotation.x, rotation.y, rotation.z, rotation.w = (float(v) for v in quaternion)
    return state
