"""The servo methods without a plan, by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

from omniservo.errors import InputError, did_you_mean, spelled
from omniservo.servoing.adaptive_gain import Gain
from omniservo.servoing.hybrid_servo import HybridServo, HybridServoOptions
from omniservo.servoing.image_servo import ImageServo, ImageServoOptions
from omniservo.servoing.pose_servo import PoseServo, PoseServoOptions
from omniservo.servoing.servo_method import ServoMethod
from omniservo.servoing.spherical_servo import SphericalServo, SphericalServoOptions
from omniservo.servoing.switched_servo import SwitchedServo, SwitchedServoOptions

SERVO_METHODS: Mapping[str, Callable[[Gain], ServoMethod]] = MappingProxyType(
    {
        "ibvs": lambda gain: ImageServo(ImageServoOptions(gain=gain)),
        "ibvs-desired": lambda gain: ImageServo(ImageServoOptions(matrix="desired", gain=gain)),
        "ibvs-mean": lambda gain: ImageServo(ImageServoOptions(matrix="mean", gain=gain)),
        "bearing": lambda gain: ImageServo(ImageServoOptions(feature="bearing", gain=gain)),
        "spherical": lambda gain: SphericalServo(SphericalServoOptions(gain=gain)),
        "pbvs": lambda gain: PoseServo(PoseServoOptions(gain=gain)),
        "pbvs-target": lambda gain: PoseServo(PoseServoOptions(translation="target", gain=gain)),
        "hybrid-2.5d": lambda gain: HybridServo(HybridServoOptions(gain=gain)),
        "switched": lambda gain: SwitchedServo(
            SwitchedServoOptions(image=ImageServoOptions(gain=gain), pose=PoseServoOptions(gain=gain))
        ),
    }
)
"""What makes each of them, with its gain λ [1/s]."""


def servo_method(name: str, gain: Gain) -> ServoMethod:
    """Return a new method of this name.

    Raises:
        InputError: no such method, or a gain that is not legal.
    """
    if name not in SERVO_METHODS:
        legal = ", ".join(SERVO_METHODS)
        raise InputError(f"method: {spelled(name)} given; legal: {legal}{did_you_mean(name, SERVO_METHODS)}")
    return SERVO_METHODS[name](gain)
