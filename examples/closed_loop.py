"""Close the loop on a simulated arm: two images, an estimate, a certified path, and the servo along it.

Nothing passes to the robot but through the Supervisor, which keeps joints, speeds and image age within limits
and brakes the arm otherwise. Prints estimate, plan, how the servo ended, and the simulator's truth.
"""

from dataclasses import replace

import numpy as np

import omniservo
from omniservo.perception import DotKind, DotTracker
from omniservo.planning import Sphere
from omniservo.safety import Step, Supervisor, VisibilityFilter, servo
from omniservo.scenes import Sensor, scene_of_task
from omniservo.servoing import RestToRestLaw
from omniservo.simulation import SimulatedRobot, take_picture
from omniservo.tasks import load_task

CAMERA = omniservo.UnifiedCamera(260.0, 260.0, 161.0, 118.0, 0.9, 320, 240)  # small: pictures take the time


def main() -> None:
    task = load_task("paper-example-1", camera=CAMERA)  # its arm, target and box
    scene, initial_T_goal = scene_of_task(task), task.teach.initial_T_goal.transform
    robot = SimulatedRobot(replace(scene, sensor=Sensor(rate=6.0, latency=0.02)))
    world_T_initial = robot.world_T_camera()
    world_T_goal = world_T_initial * initial_T_goal
    robot.place(scene.joints_for(world_T_goal, scene.start_joints))
    goal = take_picture(robot).pixels
    robot.place(scene.start_joints)
    matched = DotKind().match(CAMERA, take_picture(robot).pixels, goal)

    estimate = omniservo.estimate_two_view(CAMERA, matched.initial, matched.goal, scale=0.223557)
    print(f"estimate: {estimate.status}, {len(matched)} dots, {estimate.rms_px:.4f} px rms")
    corners = (Sphere([-0.01, -0.065, 0.085], 0.0), Sphere([-0.005, -0.08, 0.09], 0.0))
    problem = omniservo.PlanningProblem(
        CAMERA, estimate.points, estimate.initial_T_goal, corners, clearance=0.06, visibility_margin=5.0
    )
    plan = omniservo.plan_path(problem)
    print(f"plan: {plan.status}, {1e3 * plan.least_clearance([0, 1]):.1f} mm kept")

    # The delay is from an exposure to the middle of the time in which its twist acts.
    options = omniservo.TrackerOptions(gain=1.5, delay=0.02 + 0.5 / 6.0, settled_frames=5)
    law = RestToRestLaw(2.5)  # [s]
    tracker = omniservo.PathTracker(plan, CAMERA, goal_pixels=matched.goal, options=options, time_law=law)
    supervisor = Supervisor(robot, scene.arm, scene.flange_T_camera, camera=robot, wait=robot.advance)
    dots, visibility, steps = DotTracker(CAMERA), VisibilityFilter(CAMERA, delay=0.02), list[Step]()
    stop = servo(supervisor, tracker, dots, visibility, on_step=steps.append, time_limit=15.0)

    places = [robot.world_T_camera(step.image.time).translation for step in steps]
    nearest = min(corner.distance(world_T_initial.inv().apply(places)).min() for corner in corners)
    off = (world_T_goal.inv() * robot.world_T_camera()).translation
    print(f"servo: {stop or 'done'} after {robot.time:.1f} s and {len(steps)} images")
    print(f"{1e3 * np.linalg.norm(off):.2f} mm from the goal, contacts: {sorted(robot.contacts()) or 'none'}")
    print(f"never nearer than {1e3 * nearest:.1f} mm; 60 mm were asked")


if __name__ == "__main__":
    main()
