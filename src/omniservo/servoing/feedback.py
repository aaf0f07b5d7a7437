"""The law that most methods share: the twist that lets an error decay."""

from __future__ import annotations

import numpy as np

from omniservo.errors import SingularInteraction
from omniservo.geometry.arrays import FloatArray
from omniservo.servoing.adaptive_gain import AdaptiveGain, Gain
from omniservo.servoing.control_law import LEAST_CONDITIONING, singular_message, solve_twist


def feedback(error: FloatArray, interaction: FloatArray, gain: Gain) -> FloatArray:
    """Return v = −λ L⁺ e (6,), (5) of Chaumette and Hutchinson, *Visual servo control, part I* (2006).

    Args:
        error: e (k,), in whatever units.
        interaction: L (k, 6) with de/dt = L v.
        gain: λ [1/s].

    Raises:
        SingularInteraction: L does not determine a twist.
    """
    rows, twist, more = np.ascontiguousarray(interaction), np.empty(6), np.empty(6)
    conditioning = solve_twist(rows, np.ascontiguousarray(error), twist)
    if conditioning < LEAST_CONDITIONING:
        raise SingularInteraction(singular_message(len(error), conditioning))
    solve_twist(rows, error - rows @ twist, more)  # what the normal equations round off
    twist += more
    return -(gain(twist) if isinstance(gain, AdaptiveGain) else gain) * twist
