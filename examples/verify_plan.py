"""Check a saved plan with the verifier, which shares no code with the planner; falsify it and see it refused.

Prints the verdict on the file as it was saved, on a file that claims 5 mm more clearance than there is, on
one whose path was bent by 5 mm, and on the honest file where 60 mm were meant and 50 mm planned for.
"""

import copy
import json
from pathlib import Path

import omniservo

FIELDS = {
    "format": "omniservo.problem/1",
    "camera": omniservo.preset("fe185").to_dict(),
    "points": [[x, y, 0.5 + abs(x)] for x in (-0.1, 0, 0.1) for y in (-0.1, 0, 0.1)],
    "goal": {"translation": [0, -0.1, 0.2], "quaternion": [0, 0, 0, 1]},
    "obstacles": [{"type": "sphere", "center": [0, -0.05, 0.1], "radius": 0.02}],
    "clearance": 0.05,
}


def main() -> None:
    folder = Path("out")
    folder.mkdir(exist_ok=True)
    problem = omniservo.PlanningProblem.from_dict(FIELDS)
    omniservo.plan_path(problem).save(folder / "plan.json", force=True)

    # From here on nothing is believed but the file: exact arithmetic, no tolerance.
    found = omniservo.verify_plan(folder / "plan.json")
    held = sum(judgement.verdict == "holds" for judgement in found.constraints)
    print(f"as saved: {found.status}, {held} of {len(found.constraints)} stated margins hold")

    honest = json.loads((folder / "plan.json").read_text())
    boastful = copy.deepcopy(honest)
    for line in (boastful["certificate"]["constraints"][0], boastful["certificate"]["worst"]):
        line["margin"] += 0.005  # of both, else they contradict each other
    bent = copy.deepcopy(honest)
    bent["path"]["translation"][0][0] += 0.005  # x(w) = … w² …, so the goal is missed
    for what, plan in (("5 mm more claimed", boastful), ("bent by 5 mm", bent)):
        found = omniservo.verify_plan(plan)
        print(f"{what}: {found.status}: {found.reasons[0]}")

    # A plan can be right for another problem than the one that was meant.
    meant = problem.to_dict() | {"clearance": 0.06}
    found = omniservo.verify_plan(honest, problem=meant)
    print(f"another problem meant: {found.status}: {found.reasons[0]}")


if __name__ == "__main__":
    main()
