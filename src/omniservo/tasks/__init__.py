"""Task files: everything a run needs, validated."""

from omniservo.tasks.load_task import load_task, named_camera, shipped_tasks
from omniservo.tasks.task import Block, Task
from omniservo.tasks.taught_goal import TaughtGoal

__all__ = ["Block", "Task", "TaughtGoal", "load_task", "named_camera", "shipped_tasks"]
