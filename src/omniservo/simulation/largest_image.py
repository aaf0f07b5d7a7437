"""How large an image may be that is drawn ray by ray: a camera's file can state any size."""

from __future__ import annotations

from omniservo.cameras.models import CentralModel
from omniservo.errors import InputError

_MOST_PIXELS = 2**25
"""which take about 5 GB"""


def refuse_larger(camera: CentralModel) -> None:
    """Raise InputError where a camera has more pixels than are drawn."""
    if camera.width * camera.height > _MOST_PIXELS:
        raise InputError(
            f"camera: {camera.width}x{camera.height} pixels given; legal: at most {_MOST_PIXELS} to be drawn"
        )
