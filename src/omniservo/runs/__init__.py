"""Whole jobs: a task becomes a folder of results."""

from omniservo.runs.estimate_images import estimate_images, estimate_simulated
from omniservo.runs.estimate_task import estimate_task
from omniservo.runs.no_path import NoPath
from omniservo.runs.run_into import run_into
from omniservo.runs.run_task import run_task
from omniservo.runs.see import see
from omniservo.runs.teach_goal import teach_goal

__all__ = [
    "NoPath",
    "estimate_images",
    "estimate_simulated",
    "estimate_task",
    "run_into",
    "run_task",
    "see",
    "teach_goal",
]
