"""Plan for the whole arm: a camera path that is proven, and that the arm can follow clear of everything.

Prints what is proven of the camera's and the links' clearance, and the joints along the path; then the reason
why a goal is refused at which the arm would touch a crate.
"""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

import omniservo
from omniservo.planning import Box
from omniservo.robots import CAMERA_HOUSING, Solid, load_arm
from omniservo.whole_arm import ArmSetting, plan_with_arm


def main() -> None:
    arm = load_arm("rx60")  # or the URDF of yours
    flange_T_camera = RigidTransform.from_components(
        [0, 0, 0.0905], Rotation.from_euler("z", 90, degrees=True)
    )
    start = np.radians([0.0, 20.0, 110.0, 0.0, 50.0, 0.0])
    setting = ArmSetting(
        arm,
        base_T_initial=arm.base_T_flange(start) * flange_T_camera,
        flange_T_camera=flange_T_camera,
        start=start,
        mounted=CAMERA_HOUSING,
        surroundings=(Solid.half_space("floor", [0.0, 0.0, 1.0], -0.341),),  # in the arm's base frame
        clearance=0.01,  # of every link to everything that stands around [m]
    )
    points = np.array([[x, y, 0.5] for x in (-0.08, 0.0, 0.08) for y in (-0.08, 0.0, 0.08)])
    goal = RigidTransform.from_components([0.15, 0.05, 0.1], Rotation.from_rotvec([0.1, -0.3, 0.2]))
    upright = [0.0, 0.0, 0.0, 1.0]
    post = Box([0.08, 0.0, 0.0], [0.01, 0.2, 0.01], upright)
    problem = omniservo.PlanningProblem(
        omniservo.preset("fe185"), points, goal, obstacles=(post,), clearance=0.03
    )

    found = plan_with_arm(problem, setting)
    print(f"{found.plan.status}, camera {1e3 * found.plan.least_clearance([0]):.1f} mm from the post")
    closest = found.clearance.closest
    print(f"links {found.clearance.status}: {closest.link} and {closest.other} come nearest, ", end="")
    print(f"at least {1e3 * found.clearance.proven:.1f} mm beyond the {1e3 * closest.asked:.0f} mm asked")
    for w in (0.0, 0.5, 1.0):
        print(f"w = {w}: joints {np.degrees(found.branch(w)).round(1)} deg")

    # The camera's centre would be free here, but not the forearm behind it: no camera path can help.
    crate = Box([0.15, 0.05, -0.1], [0.03, 0.03, 0.03], upright)
    refused = plan_with_arm(replace(problem, obstacles=(post, crate)), setting).plan
    print(f"with a crate behind the goal: {refused.status}: {refused.reason}")


if __name__ == "__main__":
    main()
