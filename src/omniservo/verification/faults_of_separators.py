"""The list of separating planes: one for each constraint about a box, capsule or mesh, and no other."""

from omniservo.verification.fields import shown
from omniservo.verification.obstacles import SEPARATED
from omniservo.verification.plan_file import PlanFile


def faults_of_separators(file: PlanFile) -> list[str]:
    """Return what a certified plan lacks, and what stands for no constraint; the first of each."""
    bodies = [i for i, o in enumerate(file.problem.obstacles) if isinstance(o, SEPARATED)]
    points = range(len(file.problem.points)) if file.problem.occlusion else ()
    unknown = next((key for key in file.separators if not _asked(key, bodies, len(points))), None)
    faults = []
    if unknown is not None:
        faults.append(f"certificate.separators: {_name(unknown):.80} is no constraint of this problem")
    if file.status != "certified":
        return faults
    for i in bodies:
        asked: list[tuple[str, int | None]] = [(f"clearance obstacle {i}", None)]
        asked += [(f"occlusion obstacle {i}", j) for j in points]
        missing = next((key for key in asked if key not in file.separators), None)
        if missing is not None:
            return [*faults, f"certificate.separators: {_name(missing)} is missing"]
    return faults


def _asked(key: tuple[str, int | None], bodies: list[int], points: int) -> bool:
    name, point = key
    family, _, index = name.partition(" obstacle ")
    if not index.isdecimal() or int(index[:9]) not in bodies or index != str(int(index[:9])):
        return False
    return family == "clearance" if point is None else family == "occlusion" and 0 <= point < points


def _name(key: tuple[str, int | None]) -> str:
    return key[0] if key[1] is None else f"{key[0]} (point {shown(key[1])})"
