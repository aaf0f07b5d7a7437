"""A run that goes on in another process, as its recording tells while it grows. Nothing is sent to it."""

from __future__ import annotations

import tempfile
import time
from glob import escape
from pathlib import Path
from threading import Event
from typing import Protocol

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.errors import InputError
from omniservo.files import parse_document
from omniservo.geometry.arrays import ByteArray, FloatArray
from omniservo.planning import Plan
from omniservo.recording import Attachment, Recorded, RecordedRun, topics
from omniservo.recording.recorded_messages import EndMessage, LogMessage, StepMessage
from omniservo.ros_messages import RosMessage
from omniservo.ros_messages.messages import ImageMessage
from omniservo.runs.begun_as_recorded import begun_as_recorded
from omniservo.runs.export_run import RECORDING
from omniservo.runs.job_recording import PLAN
from omniservo.runs.recorded_job import RecordedJob, pixels_of
from omniservo.viewer.executed_run import ExecutedRun
from omniservo.viewer.moment import Moment

_LOOK = 0.1
"""[s] between two looks at whether the file has grown"""

_PATIENCE = 10.0
"""[s] in which a run that has just begun writes what it is to do"""

_SILENT = 3.0
"""[s] without anything new after which that is said"""


class Watching(Protocol):
    """What a run is shown on."""

    def planned(self, plan: Plan, world_T_initial: RigidTransform, joints: FloatArray) -> None:
        """Show a plan, and the arm (n,) where it begins."""

    def moved(self, moment: Moment) -> None:
        """Show the arm as it is now."""

    def said(self, words: str) -> None:
        """Show what the run says of itself."""

    def ended(self, words: str, run: ExecutedRun | None) -> None:
        """Show that it is over, and what was done; None: no step."""


class WatchedRun:
    """Reads a recording up to its end, and waits where it has not grown yet.

    Args:
        path: of the recording.
        allow_outside: whether files that its task names may lie outside its folder.

    Raises:
        InputError: it is no recording, or its task is not legal.
    """

    def __init__(self, path: Path, *, allow_outside: bool = False) -> None:
        self.path = path
        """as given"""
        self._closed, self._news, self._until = Event(), time.monotonic(), time.monotonic() + _PATIENCE
        self._watching: Watching | None = None
        self._steps = list[StepMessage]()
        self._image: ByteArray | None = None
        self._plan: Plan | None = None
        self._initial = RigidTransform.identity()
        """where the camera stood in the world when it was planned"""
        self._words = ""
        self._begun: float | None = None
        """when the joints were read first [s]"""
        self._job = RecordedJob(RecordedRun(path, self._has_more))
        inputs, goal = self._job.inputs()
        with tempfile.TemporaryDirectory(prefix="omniservo-") as folder:
            try:
                self.task, self.scene = begun_as_recorded(
                    inputs, goal, Path(folder), allow_outside=allow_outside
                )
            except InputError as error:
                raise InputError(f"{path}: {str(error).replace(f'{folder}/', '')}") from None

    @property
    def is_closed(self) -> bool:
        """Whether `watch` ends."""
        return self._closed.is_set()

    def close(self) -> None:
        """End `watch`."""
        self._closed.set()

    def watch(self, watching: Watching) -> None:
        """Show the run from its beginning to its end, or to `close`.

        Raises:
            InputError: what is read is not legal.
        """
        self._watching = watching
        for entry in self._job.entries():
            self._news = time.monotonic()
            if self._closed.is_set():
                return
            if isinstance(entry, Recorded):
                if isinstance(entry.message, EndMessage):
                    self._end(watching, entry.message)
                    return
                self._tell(watching, entry.topic, entry.time, entry.message)
            elif isinstance(entry, Attachment) and entry.name == PLAN:
                place = f"{self.path}: {PLAN}"
                self._plan = Plan.from_dict(parse_document(entry.data.decode(), place))
                self._initial = self.scene.world_T_camera(self._joints())
                watching.planned(self._plan, self._initial, self._joints())

    def _tell(self, watching: Watching, topic: str, now: float, message: RosMessage) -> None:
        if isinstance(message, ImageMessage):
            self._image = self._drawable(message)
        elif isinstance(message, LogMessage):
            self._words = message.msg
            watching.said(self._words)
        elif isinstance(message, StepMessage):
            self._steps.append(message)
            self._words = f"w {message.w:.2f}, {message.error_px:.1f} px from its reference"
        elif topic == topics.JOINT_STATES:
            self._begun = now if self._begun is None else self._begun
            w = self._steps[-1].w if self._steps else np.nan
            watching.moved(Moment(now - self._begun, self._joints(), self._words, w, self._image))

    def _end(self, watching: Watching, message: EndMessage) -> None:
        ended = f"{message.reason}: {message.message}" if message.reason else "the goal is reached"
        watching.ended(ended, executed_steps(self._steps, self._plan, self._initial, ended))

    def _joints(self) -> FloatArray:
        state = self._job.state
        return self.scene.start_joints if state is None else state.joint_positions

    def _drawable(self, message: ImageMessage) -> ByteArray | None:
        """Return an image of the planner's own camera; of another model it is rendered."""
        image = pixels_of(f"{self.path}: {topics.IMAGE}", message)
        return image if image.shape == (self.task.camera.height, self.task.camera.width) else None

    def _has_more(self) -> bool:
        """Wait for the file to grow; return whether to look again."""
        if self._watching is None:
            return time.monotonic() < self._until and not self._closed.wait(_LOOK)
        silent = time.monotonic() - self._news
        if silent > _SILENT:
            self._watching.said(f"nothing new for {silent:.0f} s")
        return not self._closed.wait(_LOOK)


def executed_steps(
    steps: list[StepMessage], plan: Plan | None, world_T_initial: RigidTransform, ended: str
) -> ExecutedRun | None:
    """Return what was done, of the steps that were recorded; None: there is none."""
    if not steps:
        return None
    poses = np.array([step.estimated_pose for step in steps])
    initial_T_camera = RigidTransform.from_components(poses[:, 4:], Rotation.from_quat(poses[:, :4]))
    return ExecutedRun(
        np.array([step.time for step in steps]),
        np.array([step.w if step.leg == 0 else np.nan for step in steps]),
        np.array([step.joints for step in steps]),
        world_T_initial,
        world_T_initial * initial_T_camera,
        np.array([step.error_px for step in steps]),
        ended,
        plan,
    )


def recording_of(path: Path) -> Path | None:
    """Return the recording that a path names: itself, a real robot's run's, or the newest that grows."""
    if path.suffix == ".mcap" and path.is_file():
        return path
    inside = path / RECORDING
    if inside.is_file() and not (path / "inputs").is_dir():
        return inside
    if path.exists() or not path.parent.is_dir():
        return None
    names = (f"{escape(path.name)}{rest}.unfinished.mcap" for rest in ("", "-*"))
    growing = [file for name in names for file in path.parent.glob(name)]
    return max(growing, key=lambda file: file.stat().st_mtime, default=None)
