"""A whole job whose camera falls silent on the way: it waits, says so everywhere, and arrives."""

import numpy as np
import pytest
from tests.runs.changed_task import DrawnCell

from omniservo.recording import Recorded, RecordedRun, RunRecording, topics
from omniservo.reporting.waits_section import waits_section
from omniservo.runs import replay_run, run_task
from omniservo.runs.safety_of_task import safety_of_task
from omniservo.tasks import load_task

pytestmark = pytest.mark.slow  # each needs a whole run


class SilentCamera:
    """A camera that gives nothing new in a span of time [s]."""

    def __init__(self, robot, span):
        self._robot, self._span, self._image = robot, span, None

    def image(self):
        if not self._span[0] <= self._robot.time < self._span[1]:
            self._image = self._robot.image()
        return self._image

    def close(self):
        self._robot.close()


class SilentCell(DrawnCell):
    span = (1.5, 2.5)

    @property
    def camera(self):
        self.line = getattr(self, "line", None) or SilentCamera(self.robot, self.span)
        return self.line


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    told, file = [], tmp_path_factory.mktemp("run") / "run.mcap"
    with RunRecording(file) as recording:
        result = run_task(
            load_task("paper-example-1"), SilentCell, filmed=False, recording=recording,
            progress=lambda *words: told.append(words),
        )  # fmt: skip
    return result, told, file


@pytest.fixture(scope="module")
def run(recorded):
    return recorded[:2]


def test_it_arrives_and_keeps_what_the_plan_keeps(run):
    result, _ = run
    metrics = result.metrics
    assert metrics["status"] == "converged"
    assert not result.log.contacts
    assert metrics["path_deviation_m"] < 3e-3
    assert metrics["clearance_executed_m"] >= metrics["clearance_asked_m"]
    assert metrics["visibility_executed_px"] >= result.task.planning.visibility_margin


def test_log_metrics_progress_and_report_say_since_when_why_and_how_long(run):
    result, told = run
    (wait,) = result.log.waits
    assert 1.4 < wait.since < 1.7
    assert wait.why.startswith("no new image")
    assert 2.4 < wait.until < 2.6
    assert result.metrics["waits"] == 1
    assert result.metrics["waited_seconds"] == pytest.approx(wait.until - wait.since)
    assert 1e-4 < result.metrics["moved_blind_m"] < result.task.planning.tracking_margin
    stages = [stage for stage, _ in told]
    at = stages.index("waiting for images")
    assert stages[at - 1] == stages[at + 1] == "following the path"
    assert 0.0 < told[at][1] < 1.0
    html = str(waits_section(result))
    assert f"{wait.since:.3f} s" in html
    assert wait.why in html


def test_what_was_planned_in_time_waits_as_well(run):
    """The joints of the log lie where the plan's way has them at the same time, in the gap's lee too."""
    log = run[0].log
    gap = np.abs(log.column("joints") - log.column("planned_joints")).max(axis=1)
    assert gap.max() < 0.02
    w = log.column("w")
    assert (np.diff(w) >= 0.0).all()
    assert w[-1] == pytest.approx(1.0)


def test_a_recording_has_the_wait_and_is_replayed_bit_by_bit(recorded):
    result, _, file = recorded
    found = [each for each in RecordedRun(file) if isinstance(each, Recorded)]
    (wait,) = [each.message for each in found if each.topic == topics.WAIT]
    known = result.log.waits[0]
    assert (wait.since, wait.stands_at, wait.until, wait.why) == (
        known.since, known.stands_at, known.until, known.why,
    )  # fmt: skip
    events = [each.message.msg for each in found if each.topic == topics.EVENTS]
    assert f"waiting: {known.why}" in events
    assert f"waited for {known.until - known.since:.2f} s" in events
    replay = replay_run(file)
    assert replay.differences == ()
    assert replay.largest == 0.0
    assert replay.steps == len(result.log.rows)


def test_a_run_without_a_gap_says_nothing_of_waiting(run):
    log = type(run[0].log)()
    assert waits_section(type("Run", (), {"log": log})()) is None


def test_a_plans_room_for_tracking_is_what_it_may_move_blind():
    task = load_task("paper-example-1")
    assert safety_of_task(task).blind_room == task.planning.tracking_margin == 0.01
