"""What alone commands a cell's arm while it moves."""

from __future__ import annotations

from omniservo.runs.recorded_cell import RecordedCell
from omniservo.runs.recorded_supervision import RecordedSupervision
from omniservo.runs.robot_cell import RobotCell
from omniservo.safety import SafetyOptions, SupervisedRobot, Supervisor


def supervisor_of(cell: RobotCell, options: SafetyOptions) -> SupervisedRobot:
    """Return the supervisor of a cell's arm, which stands still, and of its camera.

    A cell whose arm another process drives has its own, with its own options.
    """
    if isinstance(cell, RecordedCell):
        return RecordedSupervision(supervisor_of(cell.cell, options), cell.recording)
    drive = cell.drive
    return own_supervisor(cell, options) if drive is None else drive


def own_supervisor(cell: RobotCell, options: SafetyOptions) -> Supervisor:
    """Return one in this process."""
    return Supervisor(
        cell.driver,
        cell.scene.arm,
        cell.scene.flange_T_camera,
        camera=cell.camera,
        wait=cell.wait,
        clock=cell.clock,
        options=options,
    )
