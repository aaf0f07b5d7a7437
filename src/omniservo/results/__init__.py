"""What a run leaves, from which its report is made: log, film, the truth that it is scored against."""

from omniservo.results.run_log import LogRow, RunLog
from omniservo.results.run_result import Film, RunResult, Seen, Truth
from omniservo.results.taken_look import Known, TakenLook
from omniservo.results.whole_arm import WholeArm

__all__ = ["Film", "Known", "LogRow", "RunLog", "RunResult", "Seen", "TakenLook", "Truth", "WholeArm"]
