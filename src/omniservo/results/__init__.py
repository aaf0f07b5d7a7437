"""What a run leaves: its log, film, scores' truth and the whole of it, from which reports are made."""

from omniservo.results.run_log import LogRow, RunLog
from omniservo.results.run_result import Film, RunResult, Seen, Truth
from omniservo.results.whole_arm import WholeArm

__all__ = ["Film", "LogRow", "RunLog", "RunResult", "Seen", "Truth", "WholeArm"]
