"""The whole job in the simulator, watched while it goes on."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

from omniservo.results import RunResult
from omniservo.runs import run_task
from omniservo.runs.safety_of_task import safety_of_task
from omniservo.runs.supervisor_of import own_supervisor
from omniservo.safety import Supervisor
from omniservo.simulation import SimulatedCell
from omniservo.tasks import Task
from omniservo.viewer.moment import Moment


class WatchedCell(SimulatedCell):
    """The simulated cell, whose supervisor and arm are reported whenever time passes while it is supervised.

    Args:
        task: says what stands where.
        seed: of the sensor's noise.
        watch: called with every moment.
    """

    def __init__(self, task: Task, seed: int, watch: Callable[[Moment], None]) -> None:
        super().__init__(task, seed)
        self._task, self._watch = task, watch

    @cached_property
    def drive(self) -> Supervisor:
        """The supervisor in this process, kept so that its state can be read."""
        return own_supervisor(self, safety_of_task(self._task))

    def wait(self, duration: float) -> None:
        """Let time [s] pass, and report the arm."""
        super().wait(duration)
        supervisor = self.__dict__.get("drive")
        if supervisor is not None:
            state = self.robot.read()
            self._watch(Moment(state.time, state.joint_positions, _state_of(supervisor)))


def servo_live(
    task: Task, watch: Callable[[Moment], None], progress: Callable[[str, float], None]
) -> RunResult:
    """Do the job: images, estimate, plan, servo. Where it is stopped, the log says why.

    Args:
        task: the job.
        watch: called with every moment of the servo; what it raises ends it.
        progress: called with what is being done, and the share of that stage that is behind.

    Raises:
        InputError, NoSolutionError: as `run_task`.
    """
    return run_task(task, lambda job, seed: WatchedCell(job, seed, watch), filmed=False, progress=progress)


def _state_of(supervisor: Supervisor) -> str:
    if supervisor.stopped is not None:
        return f"supervisor: stopped: {supervisor.stopped.reason}"
    return "supervisor: moving" if supervisor.moving else "supervisor: standing"
