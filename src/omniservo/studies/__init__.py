"""Studies: many closed loops over stated distributions, each row reproducible by its number."""

from omniservo.studies.compare_studies import MethodDifference, RateDifference, compare_studies
from omniservo.studies.load_study import load_study
from omniservo.studies.merge_studies import merge_studies
from omniservo.studies.program import PACKAGE, Program
from omniservo.studies.run_study import Shard, run_study
from omniservo.studies.study import Study
from omniservo.studies.study_folder import StudyHeader, read_header
from omniservo.studies.study_row import RowResult, StudyRow, fields_of_row, run_row
from omniservo.studies.study_rows import read_parts, write_rows
from omniservo.studies.study_summary import MethodSummary, Rate
from omniservo.studies.study_tally import StudyTally

__all__ = [
    "PACKAGE",
    "MethodDifference",
    "MethodSummary",
    "Program",
    "Rate",
    "RateDifference",
    "RowResult",
    "Shard",
    "Study",
    "StudyHeader",
    "StudyRow",
    "StudyTally",
    "compare_studies",
    "fields_of_row",
    "load_study",
    "merge_studies",
    "read_header",
    "read_parts",
    "run_row",
    "run_study",
    "write_rows",
]
