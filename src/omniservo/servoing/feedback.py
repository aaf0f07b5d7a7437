"""The law that most methods share: the twist that lets an error decay."""

from __future__ import annotations

from omniservo.geometry.arrays import FloatArray
from omniservo.servoing.adaptive_gain import AdaptiveGain, Gain
from omniservo.servoing.control_law import camera_twist


def feedback(error: FloatArray, interaction: FloatArray, gain: Gain) -> FloatArray:
    """Return v = −λ L⁺ e (6,), (5) of Chaumette and Hutchinson, *Visual servo control, part I* (2006).

    Args:
        error: e (k,), in whatever units.
        interaction: L (k, 6) with de/dt = L v.
        gain: λ [1/s].

    Raises:
        SingularInteraction: L does not determine a twist.
    """
    twist = _solution(error, interaction)
    twist += _solution(error - interaction @ twist, interaction)  # what the normal equations round off
    return -(gain(twist) if isinstance(gain, AdaptiveGain) else gain) * twist


def _solution(error: FloatArray, interaction: FloatArray) -> FloatArray:
    """Return L⁺ e (6,)."""
    return -camera_twist(error[:, None], interaction[:, None], None, 1.0)
