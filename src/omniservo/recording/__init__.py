"""Runs as MCAP files, which Foxglove and ROS 2 tools open."""

from omniservo.recording.read_recording import Attachment, Parameters, Recorded, RecordedRun
from omniservo.recording.run_recording import RunRecording

__all__ = ["Attachment", "Parameters", "Recorded", "RecordedRun", "RunRecording"]
