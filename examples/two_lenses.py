"""Ask the same goal of two lenses, with growing margins to the limits of the image.

Prints, for a perspective camera (75° wide) and a fisheye (185°), what the planner says to each margin, how
far inside the image all points are proven to stay where there is a path, and which end pose forbids it else.
"""

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

import omniservo
from omniservo.planning import Capsule

MARGINS = (0.0, 80.0, 120.0, 160.0)  # [px]


def main() -> None:
    points = np.array([[x, y, 0.45] for x in (-0.12, 0.0, 0.12) for y in (-0.09, 0.0, 0.09)])
    # Aside and nearer, and half a turn about the axis: on the way the corners swing outwards.
    aim = Rotation.from_rotvec([0.0, -0.36, 0.0])
    goal = RigidTransform.from_components([0.15, 0.0, 0.05], aim * Rotation.from_rotvec([0.0, 0.0, 3.0]))
    post = Capsule([0.075, -0.4, 0.025], [0.075, 0.0, 0.025], 0.01)

    for name, lens in (("perspective", "perspective"), ("fisheye", "fe185")):
        for margin in MARGINS:
            problem = omniservo.PlanningProblem(
                omniservo.preset(lens),
                points,
                goal,
                obstacles=(post,),
                clearance=0.04,
                visibility_margin=margin,
            )
            plan = omniservo.plan_path(problem)
            kept = f"{plan.least_visibility():.1f} px kept" if plan.status == "certified" else plan.reason
            print(f"{name}, {margin:.0f} px asked: {plan.status}, {kept}")


if __name__ == "__main__":
    main()
