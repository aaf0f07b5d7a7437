"""Figures, animation and the HTML report of a run."""

from omniservo.reporting.animation import write_animation
from omniservo.reporting.calibration_report import write_calibration_report
from omniservo.reporting.estimate_report import write_estimate_report
from omniservo.reporting.hand_eye_report import write_hand_eye_report
from omniservo.reporting.image_distance import image_distance
from omniservo.reporting.paper_table import ComparisonRow, comparison_table, paper_table_markdown
from omniservo.reporting.write_figures import write_figures
from omniservo.reporting.write_report import write_report

__all__ = [
    "ComparisonRow",
    "comparison_table",
    "image_distance",
    "paper_table_markdown",
    "write_animation",
    "write_calibration_report",
    "write_estimate_report",
    "write_figures",
    "write_hand_eye_report",
    "write_report",
]
