"""Drive a robot of your own: an arm driver (read, command, stop, close) and a camera source (image, close).

Here one class is both: it adds up joint velocities and renders images. Prints how its closed loop ended.
"""

import numpy as np

import omniservo
from omniservo.perception import DotTracker
from omniservo.robots import CameraImage, RobotState
from omniservo.safety import Supervisor, VisibilityFilter, servo
from omniservo.scenes import Scene, scene_of_task
from omniservo.servoing import RestToRestLaw
from omniservo.simulation import UnifiedRenderer, World
from omniservo.tasks import load_task

CAMERA = omniservo.UnifiedCamera(260.0, 260.0, 161.0, 118.0, 0.9, 320, 240)
PERIOD, NOISE = 0.2, np.random.default_rng(0)  # [s] between images; of the sensor


class MyRobot:
    def __init__(self, scene: Scene) -> None:
        self.time, self.joints, self.velocities = 0.0, np.array(scene.start_joints), np.zeros(6)
        self.renderer, self.newest = UnifiedRenderer(World(scene)), CameraImage(-np.inf, np.zeros((0, 0)))

    def read(self) -> RobotState:
        return RobotState(self.time, self.joints.copy(), self.velocities.copy())

    def image(self) -> CameraImage:
        if self.time >= self.newest.time + PERIOD:  # exposed now, on the clock of `read`
            self.newest = CameraImage(self.time, self.renderer.photograph(self.joints, NOISE))
        return self.newest

    def command(self, joint_velocities: np.ndarray) -> None:
        self.velocities = np.array(joint_velocities)

    def stop(self) -> None:
        self.velocities = np.zeros(6)

    close = stop  # with a real robot: end the connection, too

    def wait(self, duration: float) -> None:  # with a real robot: time.sleep
        self.joints, self.time = self.joints + duration * self.velocities, self.time + duration


def main() -> None:
    task = load_task("paper-example-1", camera=CAMERA)
    scene, goal = scene_of_task(task), task.teach.initial_T_goal.transform
    problem = omniservo.PlanningProblem(CAMERA, [dot.center for dot in task.target.dots], goal)
    options, law = omniservo.TrackerOptions(gain=1.5, delay=PERIOD / 2, settled_frames=5), RestToRestLaw(2.5)
    tracker = omniservo.PathTracker(omniservo.plan_path(problem), CAMERA, options=options, time_law=law)
    robot = MyRobot(scene)
    supervisor = Supervisor(robot, scene.arm, scene.flange_T_camera, camera=robot, wait=robot.wait)
    stop = servo(supervisor, tracker, DotTracker(CAMERA), VisibilityFilter(CAMERA), time_limit=10.0)
    off = (scene.world_T_camera(scene.start_joints) * goal).inv() * scene.world_T_camera(robot.joints)
    print(f"servo {stop or 'done'}, {1e3 * np.linalg.norm(off.translation):.2f} mm from the goal")


if __name__ == "__main__":
    main()
