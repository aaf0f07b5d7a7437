"""Write a servo method of your own: measurement in, twist out. This one turns first, and moves then.

In a whole run: omniservo run paper-example-1 --method own_method.py:TurnFirst --method pbvs
Prints how far a camera of its own, no arm, comes to rest from the goal, and how long that takes, beside pbvs.
"""

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

import omniservo
from omniservo.errors import FeatureLoss
from omniservo.servoing import ServoMeasurement, ServoMethod, servo_method
from omniservo.tracking import GoalServo

CAMERA = omniservo.preset("fe185")
TARGET = np.array([[x, y, 0.6 + abs(x)] for x in (-0.1, 0.0, 0.1) for y in (-0.1, 0.0, 0.1)])  # [m]
GOAL = RigidTransform.from_components([0.1, -0.05, 0.2], Rotation.from_rotvec([0.1, -0.2, 0.9]))
PERIOD = 0.05  # [s]


class TurnFirst:  # answers to omniservo.servoing.ServoMethod
    def __init__(self, gain: float) -> None:
        self.gain = gain  # [1/s]

    def step(self, seen: ServoMeasurement) -> np.ndarray:
        if len(seen.bearings) < 6:
            raise FeatureLoss(f"{len(seen.bearings)} points are seen; at least 6 are needed")  # a named stop
        camera_T_goal = seen.goal_T_camera.inv()
        turn = camera_T_goal.rotation.as_rotvec()
        move = camera_T_goal.translation if np.linalg.norm(turn) < np.deg2rad(2.0) else np.zeros(3)
        return self.gain * np.concatenate((move, turn))  # camera frame: [m/s], [rad/s]


def servo(method: ServoMethod) -> str:
    pixels, _ = CAMERA.project(GOAL.inv().apply(TARGET))
    controller, initial_T_camera, time = (
        GoalServo(CAMERA, TARGET, pixels, method=method),
        RigidTransform.identity(),
        0.0,
    )
    while not controller.done and time < 60.0:
        seen, valid = CAMERA.project(initial_T_camera.inv().apply(TARGET))
        twist = PERIOD * controller.step(time, seen, valid)
        initial_T_camera *= RigidTransform.from_exp_coords(np.concatenate((twist[3:], twist[:3])))
        time += PERIOD
    off = GOAL.inv() * initial_T_camera
    turned = np.rad2deg(off.rotation.magnitude())
    return f"{time:.1f} s, {1e3 * np.linalg.norm(off.translation):.2f} mm and {turned:.3f} deg from the goal"


def main() -> None:
    print("turn first:", servo(TurnFirst(1.0)))
    print("pbvs:", servo(servo_method("pbvs", 1.0)))


if __name__ == "__main__":
    main()
