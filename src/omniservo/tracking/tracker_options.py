"""How a path is tracked: the options of `PathTracker`, each checked."""

from dataclasses import dataclass

from omniservo.errors import InputError
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import finite_number
from omniservo.servoing import FeatureName, feature_named


@with_field_docs
@dataclass(frozen=True)
class TrackerOptions:
    """How a path is tracked. The defaults suit an arm at 30 frames a second."""

    feature: FeatureName = "bearing"
    """"bearing" holds in every direction; "virtual-plane" is the paper's, for Z > 0 only."""
    gain: float = 3.0
    """λ₂ of (43) [1/s]; keep gain · (delay + frame period) well below 1."""
    delay: float = 0.0
    """From the exposure of an image to the middle of the time in which the twist computed from it acts
    [s]: latency + half a frame period. The image is carried forward by the planned motion of this time."""
    least_features: int = 4
    """Fewer usable points stop the servo; the pose needs four."""
    divergence_px: float = 25.0
    """A larger rms distance of the points to their reference stops the servo [px]."""
    gate_px: float = 2.0
    """A point farther than this [px], than 3.5 σ of all and than 3.5 σ of the camera's stated error from
    where the pose of the others puts it is taken for another thing that looks alike, and not used."""
    tolerance_px: float = 0.1
    """Done needs: rms distance to the goal image at most this [px],"""
    settled_frames: int = 10
    """in so many frames in a row after the end of the time law;"""
    tolerance_m: float = 5e-4
    """and, on average over these frames, the camera this near to where the goal image puts it [m]"""
    tolerance_rad: float = 2e-3
    """and turned by no more than this against it [rad]."""
    max_linear_speed: float = 1.0
    """The whole twist is scaled down to this [m/s]."""
    max_angular_speed: float = 3.0
    """The whole twist is scaled down to this [rad/s]."""

    def __post_init__(self) -> None:
        feature_named(self.feature)
        for name in (
            "gain",
            "divergence_px",
            "gate_px",
            "tolerance_px",
            "tolerance_m",
            "tolerance_rad",
            "max_linear_speed",
            "max_angular_speed",
        ):
            finite_number(name, getattr(self, name), above=0.0)
        finite_number("delay", self.delay, minimum=0.0)
        for name, least in (("least_features", 4), ("settled_frames", 1)):
            finite_number(name, getattr(self, name), minimum=least)
            if not isinstance(getattr(self, name), int):
                raise InputError(f"{name}: {getattr(self, name)} given; a whole number is needed")
