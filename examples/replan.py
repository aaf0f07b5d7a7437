"""Plan again while the camera moves, because an obstacle moves.

A ball drifts into the way. After every image the replanner is told where the ball is: it keeps the way that
is proven, takes up another one without a jump, or raises Blocked, a ServoStop that brakes an arm. Prints when
another way was taken up, where the camera ends, and how near it came to the ball.
"""

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

import omniservo
from omniservo.planning import Capsule, Sphere
from omniservo.servoing import RestToRestLaw
from omniservo.tracking import Replanner

PERIOD = 0.04  # [s] between images


def ball_at(time: float) -> list[float]:
    # As a sensor of yours would see it [m]: it comes into the way and stops.
    return [0.12, 0.2 - 0.1 * min(time, 1.6), 0.04]


def known_at(time: float) -> Capsule:
    # A way is proven for what is known now: with the ball goes where it may be in the next half second.
    return Capsule(ball_at(time), ball_at(time + 0.5), 0.02)


def main() -> None:
    camera = omniservo.preset("fe185")
    points = np.array([[x, y, 0.5] for x in (-0.08, 0.0, 0.08) for y in (-0.08, 0.0, 0.1)])
    initial_T_goal = RigidTransform.from_components([0.2, 0.05, 0.1], Rotation.from_rotvec([0.1, -0.3, 0.2]))
    problem = omniservo.PlanningProblem(
        camera, points, initial_T_goal, obstacles=(known_at(0.0),), clearance=0.03
    )
    plan = omniservo.plan_path(problem)
    options = omniservo.TrackerOptions(delay=PERIOD / 2)
    tracker = omniservo.PathTracker(plan, camera, options=options, time_law=RestToRestLaw(4.0))
    replanner = Replanner(tracker, plan)

    pose, time, nearest = RigidTransform.identity(), 0.0, np.inf
    while not tracker.done and time < 15.0:
        twist = tracker.step(time, *camera.project(pose.inv().apply(points)))
        replanner.set_obstacles([known_at(time)])
        event = replanner.look(time)  # after the twist was sent: planning has the rest of the period
        if event is not None and event.outcome == "replanned":
            print(f"{time:.2f} s: another way, found in {1e3 * event.seconds:.0f} ms")
        pose = pose * RigidTransform.from_exp_coords(PERIOD * np.concatenate([twist[3:], twist[:3]]))
        time += PERIOD
        nearest = min(nearest, float(Sphere(ball_at(time), 0.02).distance(pose.translation[None])[0]))

    off = initial_T_goal.inv() * pose
    print(f"done: {tracker.done} after {time:.1f} s and {len(tracker.legs)} ways")
    print(f"{1e3 * np.linalg.norm(off.translation):.2f} mm from the goal")
    print(f"never nearer to the ball than {1e3 * nearest:.1f} mm; 30 mm were asked")


if __name__ == "__main__":
    main()
