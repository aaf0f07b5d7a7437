"""Whole jobs, in any robot cell: a task becomes a folder of results."""

from omniservo.renamed import renamed
from omniservo.runs.estimate_images import estimate_images, estimate_in_cell
from omniservo.runs.estimate_many_images import EstimatedViews, ImageScale, estimate_many_images
from omniservo.runs.estimate_task import estimate_task
from omniservo.runs.export_run import Exported, export_run
from omniservo.runs.ground_truth import GroundTruth
from omniservo.runs.no_path import NoPath
from omniservo.runs.recording_beside import recording_beside
from omniservo.runs.replay_run import Replay, replay_run
from omniservo.runs.robot_cell import OpenCell, RobotCell
from omniservo.runs.run_into import run_into, run_recorded_into
from omniservo.runs.run_task import run_task
from omniservo.runs.see import see
from omniservo.runs.teach_goal import teach_goal, teach_here

__all__ = [
    "EstimatedViews",
    "Exported",
    "GroundTruth",
    "ImageScale",
    "NoPath",
    "OpenCell",
    "Replay",
    "RobotCell",
    "estimate_images",
    "estimate_in_cell",
    "estimate_many_images",
    "estimate_task",
    "export_run",
    "recording_beside",
    "replay_run",
    "run_into",
    "run_recorded_into",
    "run_task",
    "see",
    "teach_goal",
    "teach_here",
]

__getattr__ = renamed(__name__, {"estimate_simulated": "estimate_in_cell"})
