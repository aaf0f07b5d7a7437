"""The share of a job that is behind."""

import pytest

from omniservo.runs.job_progress import JobProgress


@pytest.mark.parametrize("methods", [("certified",), ("certified", "paper", "ibvs")])
def test_what_loading_takes_is_behind_when_the_first_stage_begins(methods):
    told = []
    job = JobProgress(lambda stage, share: told.append(share), methods, filmed=True)
    job("teaching the goal")
    for number in range(len(methods)):
        job.begin_run(number)
        job("following the path", 0.5)
    job.report()
    assert 0.05 < told[0] * len(methods) < 0.1
    assert told == sorted(told)
    assert 0.9 < told[-1] < 1.0
