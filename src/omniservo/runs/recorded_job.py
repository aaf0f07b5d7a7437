"""A recording as a job meets it: its inputs, then image by image what the job was given."""

from __future__ import annotations

import dataclasses
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from omniservo.errors import InputError, NoSolutionError, spelled
from omniservo.files import parse_document
from omniservo.geometry.arrays import ByteArray, FloatArray, finite_array, finite_number
from omniservo.recording import Attachment, Parameters, Recorded, RecordedRun, topics
from omniservo.recording.recorded_messages import EndMessage, LookMessage, MatchMessage, StepMessage
from omniservo.robots import JointPath, RobotState
from omniservo.ros_messages.messages import ImageMessage, JointStateMessage
from omniservo.runs.job_recording import ASKED, ESTIMATE, FILES, GOAL, LIMITS, PLAN, ROBOT_FILES
from omniservo.runs.run_inputs import RunInputs
from omniservo.safety import SafetyOptions
from omniservo.scenes import Scene
from omniservo.tasks import Task, TaughtGoal

MOST_FILES = 2**28
"""Attachments of a recording come to so many bytes at most."""


@dataclass
class _Known:
    """What was read so far."""

    files: dict[str, bytes] = field(default_factory=dict)
    image: ImageMessage | None = None
    match: MatchMessage | None = None
    end: EndMessage | None = None


class RecordedJob:
    """Goes through a recording once, from its beginning to its end.

    Args:
        run: the recording.
    """

    def __init__(self, run: RecordedRun) -> None:
        self.run = run
        """as given"""
        self._entries = iter(run)
        self._known = _Known()
        self._ahead: deque[Recorded] = deque()
        self.fault: InputError | None = None
        """what is not legal in it, once that was met: whoever caught it as another's"""
        self.dropped = 0
        """images that are missing, as far as it was read and as the file says"""
        self._state: RobotState | None = None
        self._size = 0

    @property
    def end(self) -> EndMessage | None:
        """How the servo ended; None: that was not reached, or is not there."""
        return self._known.end

    @property
    def match(self) -> MatchMessage | None:
        """The points that were matched; None: that was not reached, or is not there."""
        return self._known.match

    @property
    def newest_image(self) -> ImageMessage | None:
        """The newest image."""
        return self._known.image

    @property
    def state(self) -> RobotState | None:
        """The newest reading of the joints."""
        return self._state

    def inputs(self) -> tuple[RunInputs, TaughtGoal]:
        """Read up to the first message; return the inputs, and the taught goal.

        Raises:
            InputError: it is not there, or not legal.
        """
        while GOAL not in self._known.files or ASKED not in self._known.files:
            entry = next(self._entries, None)
            if entry is None or isinstance(entry, Recorded):
                missing = next(name for name in (ASKED, GOAL) if name not in self._known.files)
                raise self._missing(missing)
            self._take_in(entry)
        place, files, robot = f"{self.run.path}: {ASKED}", self._below(FILES), self._below(ROBOT_FILES)
        inputs = RunInputs.from_fields(self._fields(ASKED), files, place, robot)
        return inputs, TaughtGoal.from_dict(self._fields(GOAL), f"{self.run.path}: {GOAL}")

    def _below(self, folder: str) -> dict[str, bytes]:
        known = self._known.files
        return {name.removeprefix(folder): known[name] for name in known if name.startswith(folder)}

    def look(self) -> tuple[float, ByteArray, FloatArray] | None:
        """Go on to the next look; return how long the move to it took [s], its image and joints.

        None: planning was over first, or the recording is.

        Raises:
            InputError: what is read is not legal.
        """
        while not self._planned:
            message = self._advance()
            if message is None:
                return None
            if isinstance(message, LookMessage):
                return message.motion_seconds, *self._looked(message)
        return None

    def _looked(self, message: LookMessage) -> tuple[ByteArray, FloatArray]:
        place = f"{self.run.path}: {topics.LOOK}"
        with self.reads():
            if self._known.image is None:
                raise InputError(f"{place}: no image before it")
            image = pixels_of(f"{self.run.path}: {topics.IMAGE}", self._known.image)
            return image, finite_array(f"{place}: joints", message.joints, (None,))

    def take_shot(self, task: Task, scene: Scene, path: JointPath) -> tuple[float, ByteArray, FloatArray]:
        """Return the next look, whatever the move to it was.

        Raises:
            NoSolutionError: there is no other.
        """
        look = self.look()
        if look is None:
            raise NoSolutionError("the recorded job did not look again here")
        return look

    def documents(self) -> tuple[Any, Any]:
        """Read up to the servo; return the estimate's and the plan's fields, None where there are none.

        Raises:
            InputError: what is read is not legal, or much more than stands between plan and servo.
        """
        held = 0
        while self._known.end is None:
            if isinstance(self._advance(), ImageMessage | StepMessage | None):
                break
            held += self._ahead[-1].size if self._ahead else 0
            if held > MOST_FILES:
                raise InputError(f"{self.run.path}: more than {MOST_FILES} bytes between plan and servo")
        there = self._known.files
        return (
            self._fields(ESTIMATE) if ESTIMATE in there else None,
            self._fields(PLAN) if PLAN in there else None,
        )

    def next_message(self) -> Recorded | None:
        """Return the next message after the plan; None at the servo's end, or where the file is cut off.

        Raises:
            InputError: what is read is not legal.
        """
        while not self._ahead and self._known.end is None:
            if self._advance() is None:
                return None
        return self._ahead.popleft() if self._ahead else None

    def read_to_end(self) -> None:
        """Read what is behind the servo's end: whether images are missing is known then.

        Raises:
            InputError: what is read is not legal.
        """
        for entry in self._entries:
            if isinstance(entry, Parameters):
                self._take_in(entry)

    def entries(self) -> Iterator[Attachment | Parameters | Recorded]:
        """Yield what is left, entry by entry, to the end of the file.

        Raises:
            InputError: what is read is not legal.
        """
        for entry in self._entries:
            self._take_in(entry)
            self._ahead.clear()
            yield entry

    def limits(self) -> dict[str, float]:
        """Return the numbers within which the arm was led, as far as that was read.

        Raises:
            InputError: they are none.
        """
        if LIMITS not in self._known.files:
            return {}
        fields, place = self._fields(LIMITS), f"{self.run.path}: {LIMITS}"
        if not isinstance(fields, dict):
            raise InputError(f"{place}: legal: {{NAME: NUMBER, …}}")
        known = {field.name for field in dataclasses.fields(SafetyOptions)}
        found = {str(name): finite_number(f"{place}: {name}", value) for name, value in fields.items()}
        return {name: value for name, value in found.items() if name in known}

    @property
    def _planned(self) -> bool:
        return self._known.match is not None or self._known.end is not None

    def _advance(self) -> Any:
        """Take in the next message and return it; None at the end."""
        with self.reads():
            for entry in self._entries:
                self._take_in(entry)
                if isinstance(entry, Recorded):
                    return entry.message
        return None

    @contextmanager
    def reads(self) -> Iterator[None]:
        """Note what the block refuses: `fault`."""
        try:
            yield
        except InputError as error:
            self.fault = self.fault or error
            raise

    def _take_in(self, entry: Attachment | Parameters | Recorded) -> None:
        if isinstance(entry, Attachment):
            self._size += len(entry.data)
            if self._size > MOST_FILES:
                raise InputError(f"{self.run.path}: attachments of more than {MOST_FILES} bytes")
            self._known.files[entry.name] = entry.data
        elif isinstance(entry, Parameters):
            given = entry.values.get("format")
            if entry.name == topics.PARAMETERS and given != topics.FORMAT:
                raise InputError(
                    f"{self.run.path}: format: {spelled(given)} given; legal: {topics.FORMAT!r}: written by "
                    f"version {spelled(entry.values.get('version'))} of omniservo"
                )
            if entry.name == topics.DROPPED:
                self.dropped += _whole(f"{self.run.path}: {entry.name}", entry.values.get("images"))
        else:
            message = entry.message
            if isinstance(message, ImageMessage):
                self._known.image = message
            elif isinstance(message, MatchMessage):
                self._known.match = message
            elif isinstance(message, EndMessage):
                self._known.end = message
            elif entry.topic == topics.JOINT_STATES and isinstance(message, JointStateMessage):
                self._state = self.reading(message)
            if self._known.match is not None:
                self._ahead.append(entry)

    def reading(self, message: JointStateMessage) -> RobotState:
        """Return a reading of the joints.

        Raises:
            InputError: not finite, or not of one number of joints.
        """
        place = f"{self.run.path}: {topics.JOINT_STATES}"
        n = len(message.position)
        return RobotState(
            message.header.stamp.seconds,
            finite_array(f"{place}: position", message.position, (n,)),
            finite_array(f"{place}: velocity", message.velocity, (n,)),
        )

    def _fields(self, name: str) -> Any:
        place = f"{self.run.path}: {name}"
        try:
            return parse_document(self._known.files[name].decode(), place)
        except UnicodeDecodeError:
            raise InputError(f"{place}: not text (UTF-8)") from None

    def _missing(self, name: str) -> InputError:
        why = "it is cut off before it" if self.run.cut else "not a run that was recorded by omniservo"
        return InputError(f"{self.run.path}: no {name}: {why}")


def _whole(place: str, text: str | None) -> int:
    if text is None or not text.isascii() or not text.isdigit() or len(text) > 9:
        raise InputError(f"{place}: images: {spelled(text)} given; legal: a whole number")
    return int(text)


def pixels_of(place: str, message: ImageMessage) -> ByteArray:
    """Return an image's grey values (height, width)."""
    if message.encoding != "mono8" or message.step != message.width:
        raise InputError(f"{place}: {spelled(message.encoding)} given; legal: 'mono8', rows without gaps")
    if message.height * message.width != len(message.data) or not len(message.data):
        raise InputError(
            f"{place}: {len(message.data)} bytes given; legal: {message.height} × {message.width}"
        )
    return np.array(message.data, dtype=np.uint8).reshape(message.height, message.width)
