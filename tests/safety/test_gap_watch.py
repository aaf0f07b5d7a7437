"""An arm is stopped while it can still be braked clear of what stands around it."""

import numpy as np
import pytest

from omniservo.robots import Arm, ArmBodies, RobotState, Solid
from omniservo.safety.gap_watch import GapWatch, TooNear
from omniservo.safety.motion_limits import stopping_distance

ARM = Arm.rx60()
Q = np.deg2rad([0.0, 45.0, 60.0, 0.0, 60.0, 0.0])
KEPT, REACTION = 0.002, 0.1
SPEED = np.array([0.6, 0.0, 0.0, 0.0, 0.0, 0.0])
"""turns the whole arm about the vertical"""
GAPS = np.linspace(-0.12, 0.1, 12)
"""[m]"""


def post(gap):
    """A ball on the way of the hand; at 0 it is a quarter of a metre less its radius away from it."""
    hand = ARM.base_T_flange(Q).translation
    return Solid.sphere("post", hand + np.array([0.0, 0.25 + gap, 0.0]), 0.1)


def least_gap(solid, joints):
    bodies = ArmBodies(ARM, surroundings=[solid])
    bodies.place(joints)
    around = [pair for pair in range(len(bodies.pairs)) if bodies.is_around(pair)]
    return min(bodies.measure(pair) for pair in around)


@pytest.mark.parametrize("gap", GAPS)
def test_what_could_not_be_braked_before_it_is_too_near_is_stopped_and_nothing_else(gap):
    solid = post(gap)
    end = Q + stopping_distance(SPEED, ARM.joint_acceleration, REACTION)
    watch = GapWatch(ArmBodies(ARM, surroundings=[solid]), KEPT, REACTION)
    now, then = least_gap(solid, Q), least_gap(solid, end)
    for velocities, least in ((0.0 * SPEED, now), (SPEED, min(now, then))):
        state = RobotState(0.0, Q, velocities)
        if least >= KEPT:
            watch.check(state)
        else:
            with pytest.raises(TooNear, match=r"post .* mm apart by the joints; at least 2 mm are kept"):
                watch.check(state)


def test_the_cases_above_are_of_all_three_kinds():
    end = Q + stopping_distance(SPEED, ARM.joint_acceleration, REACTION)
    kinds = {(least_gap(post(gap), Q) >= KEPT, least_gap(post(gap), end) >= KEPT) for gap in GAPS}
    assert {(True, True), (True, False), (False, False)} <= kinds


def test_what_would_be_passed_while_braking_is_seen_before():
    """Where the arm stands and where it would come to rest there is room; half way there stands a stick."""
    velocities = 5.0 * SPEED
    end = Q + stopping_distance(velocities, ARM.joint_acceleration, REACTION)
    hand = ARM.base_T_flange(0.5 * (Q + end)).translation
    stick = Solid.sphere("stick", hand, 0.01)
    assert min(least_gap(stick, Q), least_gap(stick, end)) > KEPT
    watch = GapWatch(ArmBodies(ARM, surroundings=[stick]), KEPT, REACTION)
    watch.check(RobotState(0.0, Q, 0.0 * velocities))
    with pytest.raises(TooNear, match="stick would come to rest"):
        watch.check(RobotState(0.0, Q, velocities))
