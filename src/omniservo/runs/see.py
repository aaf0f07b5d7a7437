"""From two images to matched points."""

from __future__ import annotations

from omniservo.cameras.models import CentralModel
from omniservo.geometry.arrays import ByteArray
from omniservo.perception import FeatureKind
from omniservo.results.run_result import Seen


def see(kind: FeatureKind, camera: CentralModel, initial: ByteArray, goal: ByteArray) -> Seen:
    """Find the features in both images and match them.

    Raises:
        InputError: an image with too few features.
        NoSolutionError: they cannot be matched, or too few can.
    """
    return Seen(initial, goal, kind.match(camera, initial, goal))
