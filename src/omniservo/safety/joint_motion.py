"""A joint path that is followed by the joints' own readings, through the supervisor."""

from __future__ import annotations

import numpy as np

from omniservo.errors import ServoStop
from omniservo.geometry.polyline import offsets_from_line
from omniservo.robots import JointPath
from omniservo.safety.supervised_robot import SupervisedRobot
from omniservo.servoing import PathLimits, RestToRestLaw

SHARE = 0.1
"""of the arm's joint speeds and accelerations"""

LEAST_DURATION = 2.0
"""[s]"""

GAIN = 10.0
"""[1/s] with which joints return to where the path has them"""

PERIOD = 5e-3
"""[s] between two commands"""

SETTLED = 2e-4
"""[rad] Joints that are all as near to the path's end as this are there."""

_SETTLING = 1.0
"""The joints are given so long to get there after the motion's time is over [s]."""

_PLACES = 65


class OffPath(ServoStop):
    """The joints, or the camera by them, are farther from the path than was proven to be clear."""

    reason = "off_path"


def follow_joints(supervisor: SupervisedRobot, path: JointPath, within: float) -> float:
    """Lead the arm along a joint path, from rest to rest, and return how long that took [s].

    q̇ = q′ẇ + k (q(w) − q), w(t) of `RestToRestLaw`. The robot stands still on return.

    Args:
        supervisor: of the arm, which stands where the path begins.
        path: to be followed.
        within: how far any joint may be from the nearest place of the path [rad].

    Raises:
        ServoStop: what stopped the arm; `OffPath`: a joint was not ``within``, or not at the end in time.
    """
    arm = supervisor.arm
    limits = PathLimits(path, SHARE * arm.joint_speed, SHARE * arm.joint_acceleration)
    law = RestToRestLaw.for_limits(limits, least_duration=LEAST_DURATION)
    line = path(np.linspace(0.0, 1.0, _PLACES))
    end = path(np.array(1.0))
    begin = supervisor.read().time
    try:
        while True:
            supervisor.image()
            state = supervisor.read()
            time, joints = state.time - begin, state.joint_positions
            off = float(np.abs(offsets_from_line(line, joints)).max(axis=1).min())
            if off > within:
                raise OffPath(f"a joint is {off:.2g} rad off its path; at most {within:g} rad is allowed")
            if time >= law.duration and np.abs(joints - end).max() <= SETTLED:
                break
            if time > law.duration + _SETTLING:
                raise OffPath(f"a joint is {np.abs(joints - end).max():.2g} rad from where its path ends")
            w, speed = law(min(time, law.duration))
            supervisor.command(path(w, 1) * speed + GAIN * (path(w) - joints))
            supervisor.wait(PERIOD)
    except BaseException as error:
        supervisor.stop(error if isinstance(error, ServoStop) else None)
        raise
    supervisor.stop()
    supervisor.wait(0.1)
    return supervisor.read().time - begin
