"""Plan a camera path among boxes and a mesh, and read what is proven of it.

Prints how near the straight way comes to each body, what the plan keeps from it (proven for every w in
[0, 1], not sampled), what the points keep to the image's limits, and the camera's place on the way.
"""

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

import omniservo
from omniservo.planning import Box, Mesh


def main() -> None:
    # Everything stands in the initial camera's frame [m]: x right, y down, z ahead.
    points = np.array([[x, y, 0.6 + abs(x)] for x in (-0.1, 0.0, 0.1) for y in (-0.1, 0.0, 0.1)])
    goal = RigidTransform.from_components([0.25, 0.0, 0.15], Rotation.from_rotvec([0.0, -0.4, 0.1]))
    upright = [0.0, 0.0, 0.0, 1.0]
    bodies = {
        "shelf": Box([0.1, 0.28, 0.1], [0.3, 0.02, 0.2], upright),
        "post": Box([0.12, -0.03, 0.08], [0.01, 0.05, 0.01], upright),
        # The hull of its corners. A problem file takes STL, OBJ and DAE files as well.
        "wedge": Mesh([[x, y, z] for x in (0.02, 0.2) for y, z in ((-0.2, 0.1), (-0.2, 0.2), (-0.12, 0.15))]),
    }
    problem = omniservo.PlanningProblem(
        omniservo.preset("fe185"),
        points,
        goal,
        obstacles=tuple(bodies.values()),
        clearance=0.05,  # of the camera's centre to every surface [m]
        visibility_margin=10.0,  # of every point to every limit of the image [px]
    )
    plan = omniservo.plan_path(problem)
    print(plan.status, plan.reason)
    if plan.path is None or plan.status != "certified":
        return

    straight = np.linspace(0.0, 1.0, 201)[:, None] * goal.translation
    for number, (name, body) in enumerate(bodies.items()):
        kept = plan.least_clearance([number])
        print(
            f"{name}: straight on {1e3 * body.distance(straight).min():.0f} mm, planned {1e3 * kept:.1f} mm"
        )
    print(f"points stay {plan.least_visibility():.0f} px inside the image")
    for w in (0.0, 0.5, 1.0):
        print(f"w = {w}: camera at {1e3 * plan.path(w).translation.round(4)} mm")


if __name__ == "__main__":
    main()
