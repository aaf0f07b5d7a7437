"""Whether a path, or a part of one, still keeps everything that a changed problem asks for."""

from __future__ import annotations

from omniservo.geometry.polynomial import PROVEN
from omniservo.planning.camera_path import CameraPath
from omniservo.planning.planning_problem import PlanningProblem
from omniservo.planning.problem_arrays import TIGHTER_PX, demands_of, image_limits
from omniservo.planning.search.prove_path import prove_path


def keeps_problem(problem: PlanningProblem, path: CameraPath) -> bool:
    """Return whether every constraint is proven for the whole path, wherever that begins and ends.

    Args:
        problem: in the frame of the path; the motions of its obstacles run over the path's own parameter.
        path: any, also a `CameraPath.part`.

    Raises:
        InputError: the visibility margin leaves nothing of the image.
    """
    demands = demands_of(problem, image_limits(problem, TIGHTER_PX))
    status, _ = prove_path(demands, *path.powers)
    return bool(status == PROVEN)
