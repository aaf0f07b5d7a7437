"""From two pictures to matched dots."""

from __future__ import annotations

import numpy as np

from omniservo.cameras import UnifiedCamera
from omniservo.errors import AnswerIsNo
from omniservo.geometry.arrays import ByteArray
from omniservo.perception import find_dots, match_dots
from omniservo.runs.in_view import LEAST_DOTS
from omniservo.runs.teach_goal import require_dots
from omniservo.simulation.run_result import Seen


def see(camera: UnifiedCamera, initial: ByteArray, goal: ByteArray) -> Seen:
    """Find the dots in both pictures and match them, without being told which is which.

    Raises:
        InputError: a picture with fewer than eight dots.
        AnswerIsNo: the match is ambiguous, or fewer than eight dots can be matched.
    """
    initial_dots = find_dots(initial, camera)
    goal_dots = find_dots(goal, camera)
    require_dots(initial_dots.pixels, "the initial image")
    require_dots(goal_dots.pixels, "the goal image")
    match = match_dots(camera, initial_dots, goal_dots)
    if match.status != "ok":
        raise AnswerIsNo(f"the dots of the two images cannot be matched: {match.status}: {match.reason}")
    if len(match.pairs) < LEAST_DOTS:
        raise AnswerIsNo(f"{len(match.pairs)} dots matched; at least {LEAST_DOTS} are needed")
    pairs = match.pairs[np.argsort(match.pairs[:, 0])]
    return Seen(
        initial, initial_dots.pixels[pairs[:, 0]], goal_dots.pixels[pairs[:, 1]], float(match.residual_px)
    )
