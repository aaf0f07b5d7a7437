"""Follow a plan by the image alone with a camera that goes where it is told: no arm, no simulator.

Each turn of the loop is what a driver of your own would do: pixels in, camera twist out. Prints where the
camera ends beside the goal, how long it took, and what of the planned clearance was left on the way.
"""

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

import omniservo
from omniservo.planning import Sphere
from omniservo.servoing import RestToRestLaw

PERIOD = 0.04  # [s] between images


def main() -> None:
    rng = np.random.default_rng(0)
    camera = omniservo.preset("fe185")
    points = np.array([[x, y, 0.5 - abs(x)] for x in (-0.1, 0.0, 0.1) for y in (-0.09, 0.0, 0.08)])
    initial_T_goal = RigidTransform.from_components([0.1, -0.05, 0.12], Rotation.from_rotvec([0, -0.2, 0.3]))
    ball = Sphere([0.05, -0.025, 0.06], 0.01)
    problem = omniservo.PlanningProblem(camera, points, initial_T_goal, obstacles=(ball,), clearance=0.05)
    plan = omniservo.plan_path(problem)
    print(plan.status, f"{1e3 * plan.least_clearance([0]):.1f} mm to the ball")

    # The servo ends on what was seen at the goal, not where the plan ends: errors of the plan do not stay.
    goal_pixels = camera.project(initial_T_goal.inv().apply(points))[0]
    # A twist acts while the next image is waited for: half a period late, on average.
    options = omniservo.TrackerOptions(delay=PERIOD / 2)
    tracker = omniservo.PathTracker(
        plan, camera, goal_pixels=goal_pixels, options=options, time_law=RestToRestLaw(4.0)
    )
    pose, time, nearest = RigidTransform.identity(), 0.0, np.inf
    while not tracker.done and time < 15.0:
        pixels, seen = camera.project(pose.inv().apply(points))
        pixels += 0.05 * rng.standard_normal(pixels.shape)  # what finding a dot is off by [px]
        twist = tracker.step(time, pixels, seen)  # (linear [m/s], angular [rad/s]), camera frame
        pose = pose * RigidTransform.from_exp_coords(PERIOD * np.concatenate([twist[3:], twist[:3]]))
        nearest = min(nearest, float(ball.distance(pose.translation[None])[0]))
        time += PERIOD

    off = initial_T_goal.inv() * pose
    millimetres, degrees = 1e3 * np.linalg.norm(off.translation), np.degrees(off.rotation.magnitude())
    print(
        f"done: {tracker.done} after {time:.1f} s, {tracker.report.goal_error_px:.2f} px from the goal image"
    )
    print(
        f"{millimetres:.2f} mm and {degrees:.3f} deg from the goal, never nearer than {1e3 * nearest:.1f} mm"
    )


if __name__ == "__main__":
    main()
