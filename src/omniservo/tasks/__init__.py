"""Task files: everything a run needs, validated."""

from omniservo.shipped_tasks import shipped_tasks
from omniservo.tasks.load_task import load_task
from omniservo.tasks.placed import Block
from omniservo.tasks.robot_file import RobotFile, load_robot
from omniservo.tasks.task import Task
from omniservo.tasks.task_sources import KeptRobot, KeptTask, TaskOnRobot
from omniservo.tasks.taught_goal import TaughtGoal

__all__ = [
    "Block",
    "KeptRobot",
    "KeptTask",
    "RobotFile",
    "Task",
    "TaskOnRobot",
    "TaughtGoal",
    "load_robot",
    "load_task",
    "shipped_tasks",
]
