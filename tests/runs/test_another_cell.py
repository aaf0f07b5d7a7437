"""A whole job in a cell that is not the simulator: arm and camera are two objects of their own."""

import csv
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from omniservo.errors import NoSolutionError
from omniservo.robots import CameraImage, RobotState
from omniservo.runs import run_into, run_task
from omniservo.runs.robot_delay import measure_delay
from omniservo.safety import SafetyOptions
from omniservo.scenes import scene_of_task
from omniservo.simulation import World
from omniservo.simulation.projected_dots import ProjectedDots
from omniservo.simulation.simulated_robot import Exposure
from omniservo.tasks import load_task

PERIOD, TICK = 0.1, 1e-3


class ObedientArm:
    """Joints that turn as they were commanded, after the acceleration that they need."""

    def __init__(self, scene):
        self.arm, self.time, self.closed = scene.arm, 0.0, False
        self.joints, self.speeds, self.wanted = np.array(scene.start_joints), np.zeros(6), np.zeros(6)

    def read(self):
        return RobotState(self.time, self.joints.copy(), self.speeds.copy())

    def command(self, joint_velocities):
        self.wanted = np.array(joint_velocities)

    def stop(self):
        self.wanted = np.zeros(6)

    def close(self):
        self.closed = True

    def turn(self, duration):
        self.time += duration
        change = duration * self.arm.joint_acceleration
        self.speeds += np.clip(self.wanted - self.speeds, -change, change)
        self.joints += duration * self.speeds


class DrawingCamera:
    """Draws the dots that the camera on the arm sees."""

    def __init__(self, scene, arm):
        self.scene, self.arm = scene, arm
        self.world, self.dots = World(scene), ProjectedDots(scene)
        self.exposed = {}

    def image(self):
        number = int(self.arm.time / PERIOD + 1e-6)
        if number > 0 and number not in self.exposed:
            seen = Exposure(self.arm.time, self.arm.joints, self.world, self.scene.lights[0], (0, number))
            image = CameraImage(self.arm.time, self.dots.drawn(seen), time_sigma=0.001)
            self.exposed[number] = image, self.scene.world_T_camera(self.arm.joints)
        return self.exposed[number][0] if number > 0 else None

    def close(self):
        self.exposed.clear()


class OwnTruth:
    """What is known; nothing is in the way, nothing touches."""

    def __init__(self, camera):
        self.camera = camera

    def world_T_camera(self, time):
        return next(pose for image, pose in self.camera.exposed.values() if image.time == time)

    def arm_obstacle_distance(self):
        return 1.0

    def contacts(self):
        return frozenset()

    def hidden_by(self, joints, points):
        return [None] * len(points)

    def outside_picture(self, joints, time=None, *, quick=False):
        return np.zeros((4, 4, 3), dtype=np.uint8)


class OwnCell:
    """The cell of a task; nothing of it can be moved."""

    def __init__(self, task, seed):
        self.scene = scene_of_task(task)
        self.driver = ObedientArm(self.scene)
        self.camera = DrawingCamera(self.scene, self.driver)
        self.truth = OwnTruth(self.camera)
        self.approved = []

    clock = drive = None

    def move_obstacles(self, numbers, by):
        raise AssertionError("this task moves none")

    def approve(self, motion):
        self.approved.append(motion)

    def wait(self, duration):
        for _ in range(round(duration / TICK)):
            self.driver.turn(TICK)

    def bring_arm_to(self, joints):
        self.driver.joints = np.array(joints)

    def close(self):
        self.driver.close()
        self.camera.close()


@pytest.mark.slow
def test_a_whole_job_is_done_in_any_cell_and_every_cell_is_closed():
    cells = []

    def open_cell(task, seed):
        cells.append(OwnCell(task, seed))
        return cells[-1]

    task = load_task("paper-example-1")
    task = task.model_copy(update={"sensor": task.sensor.model_copy(update={"rate": 1.0 / PERIOD})})
    result = run_task(task, open_cell, filmed=False)
    assert result.metrics["status"] == "converged"
    assert result.metrics["plan_status"] == "certified"
    goal = RigidTransform.from_matrix(result.truth.initial_T_goal)
    world_T_goal = task.start.world_T_camera.transform * goal
    off = world_T_goal.inv() * cells[-1].scene.world_T_camera(cells[-1].driver.joints)
    assert np.linalg.norm(off.translation) < 1e-3
    assert off.rotation.magnitude() < np.deg2rad(0.2)
    assert [cell.driver.closed for cell in cells] == [True, True]  # the goal's and the run's
    assert cells[0].approved == []
    assert "along a path that is certified" in cells[1].approved[0]


@pytest.mark.slow
def test_its_delay_is_found_no_surer_than_its_stamps_are():
    """By a recording of the whole swing: stamps are 40 ms early."""
    cell = OwnCell(load_task("paper-example-1"), 0)
    exact = cell.camera.image

    def early():
        image = exact()
        return None if image is None else replace(image, time=image.time - 0.04, time_sigma=3e-3)

    cell.camera.image = early
    found = measure_delay(cell, SafetyOptions(image_age=1.0, time_offset=0.5))
    assert found.camera.offset == pytest.approx(0.04, abs=2e-3)
    assert 3e-3 <= found.camera.sigma < 4e-3
    late = found.image_age - found.camera.offset  # images come at once, and are looked for every 5 ms
    assert -2e-3 <= late <= 10e-3
    assert "swing j4 and j5" in cell.approved[0]


def test_a_motion_that_is_not_agreed_to_is_not_begun():
    cells = []

    def refuse(motion):
        raise NoSolutionError("no")

    def open_cell(task, seed):
        cells.append(OwnCell(task, seed))
        cells[-1].approve = refuse
        return cells[-1]

    with pytest.raises(NoSolutionError, match="no"):
        run_task(load_task("paper-example-1"), open_cell, filmed=False)
    assert not cells[1].driver.wanted.any()
    assert np.array_equal(cells[1].driver.joints, cells[1].scene.start_joints)


@pytest.mark.slow
def test_a_robot_that_is_lost_in_motion_leaves_a_report_that_says_why(tmp_path):
    cells = []

    def open_cell(task, seed):
        cells.append(OwnCell(task, seed))
        if len(cells) == 2:
            cell = cells[-1]
            cell.truth, read, image = None, cell.driver.read, cell.camera.image

            def lost(answer):
                if cell.driver.time > 2.0:
                    raise OSError("the cable is out")
                return answer()

            cell.driver.read, cell.camera.image = lambda: lost(read), lambda: lost(image)
        return cells[-1]

    task = load_task("paper-example-1")
    task = task.model_copy(update={"sensor": task.sensor.model_copy(update={"rate": 1.0 / PERIOD})})
    metrics = run_into(tmp_path, task, open_cell)["certified"]
    assert metrics["status"] == "stopped"
    assert metrics["reason"].startswith("robot_lost: ")
    assert "the cable is out" in metrics["reason"]
    assert "Stopped: robot lost" in (tmp_path / "report.html").read_text()
    assert (tmp_path / "final.png").exists()


def test_code_is_loaded_by_tracking_an_image_before_the_motion_is_agreed_to():
    """Compiling takes half a minute, once: a motion that began so long after the yes would surprise."""
    times = []

    def refuse(motion):
        raise NoSolutionError("no")

    def open_cell(task, seed):
        cell = OwnCell(task, seed)
        exact = cell.camera.image

        def seen():
            image = exact()
            times.extend([] if image is None else [image.time])
            return image

        times.clear()
        cell.camera.image, cell.approve, cell.clock = seen, refuse, lambda: cell.driver.time
        return cell

    with pytest.raises(NoSolutionError, match="no"):
        run_task(load_task("paper-example-1"), open_cell, filmed=False)
    assert len(set(times)) >= 2  # the initial one, and one that was tracked


def test_an_arm_that_was_moved_while_the_plan_was_approved_is_not_commanded():
    cells = []

    def open_cell(task, seed):
        cells.append(OwnCell(task, seed))
        driver = cells[-1].driver
        cells[-1].approve = lambda motion: driver.joints.__setitem__(2, driver.joints[2] + np.deg2rad(0.5))
        return cells[-1]

    with pytest.raises(NoSolutionError, match=r"j3 was moved by 0\.50 deg since the initial image"):
        run_task(load_task("paper-example-1"), open_cell, filmed=False)
    assert not cells[1].driver.wanted.any()


@pytest.mark.slow
def test_without_truth_what_was_executed_is_what_joints_and_images_say(tmp_path):
    cells = []

    def open_cell(task, seed):
        cells.append(OwnCell(task, seed))
        if len(cells) == 2:  # the run's; the goal was taught before
            cells[-1].truth, cells[-1].camera.close = None, lambda: None
        return cells[-1]

    task = load_task("paper-example-1")
    task = task.model_copy(update={"sensor": task.sensor.model_copy(update={"rate": 1.0 / PERIOD})})
    metrics = run_into(tmp_path, task, open_cell)["certified"]
    assert metrics["status"] == "converged"
    assert metrics["final_translation_error_m"] is None
    assert metrics["arm_clearance_executed_m"] is None
    assert metrics["contacts"] == []
    log = csv.DictReader((tmp_path / "log.csv").read_text().splitlines())
    rows = [row for row in log if float(row["time"]) > 0.0]
    assert all(row["true_position_0"] == "nan" for row in rows)
    world_T_initial = task.start.world_T_camera.transform
    known = [pose for image, pose in cells[-1].camera.exposed.values()]
    for row in rows:
        measured = world_T_initial.apply([float(row[f"measured_position_{i}"]) for i in range(3)])
        assert min(np.linalg.norm(measured - pose.translation) for pose in known) < 2e-4
    assert metrics["clearance_planned_m"] <= metrics["clearance_executed_m"] + 2e-3
    page = (tmp_path / "report.html").read_text()
    assert "whether anything was touched is not measured on a real robot" in page
    assert "Right: the arm from outside" not in page
    assert not (tmp_path / "outside.png").exists()


def test_a_cell_is_closed_when_its_job_fails():
    cells = []

    def open_cell(task, seed):
        cells.append(OwnCell(task, seed))
        cells[-1].truth.hidden_by = lambda joints, points: ["a visitor"] * len(points)
        return cells[-1]

    with pytest.raises(ValueError, match="hidden by a visitor"):
        run_task(load_task("paper-example-1"), open_cell, filmed=False)
    assert cells[0].driver.closed
