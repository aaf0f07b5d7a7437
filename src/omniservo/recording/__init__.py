"""Runs as MCAP files, which Foxglove and ROS 2 tools open."""

from omniservo.recording.calls import Call
from omniservo.recording.queued_recording import QueuedRecording
from omniservo.recording.read_recording import Attachment, Parameters, Recorded, RecordedRun
from omniservo.recording.run_recording import RunRecording

__all__ = ["Attachment", "Call", "Parameters", "QueuedRecording", "Recorded", "RecordedRun", "RunRecording"]
