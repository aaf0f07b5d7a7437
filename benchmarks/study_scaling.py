"""How much faster a study is with two workers than with one, and what a row costs.

Run on a machine with nothing else to do: ``python -m benchmarks.study_scaling [SCENES]``, of the shipped
study `quick`, whose own number is 30. Starting processes and reading kernels is part of the time.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from time import perf_counter

from omniservo.studies import load_study, read_parts, run_study


def main() -> None:
    """Print wall time and CPU time for one worker and for two."""
    quick = load_study("quick")
    study = quick.model_validate({**dict(quick), "scenes": int(sys.argv[1]) if len(sys.argv) > 1 else 120})
    times = []
    for workers in (1, 2):
        with tempfile.TemporaryDirectory() as made:
            begin = perf_counter()
            run_study(study, Path(made), workers=workers)
            times.append(perf_counter() - begin)
            cpu = sum(sum(part.cpu_seconds.values()) for part in read_parts(Path(made)))
        print(
            f"{workers} worker(s): {study.rows} rows in {times[-1]:.0f} s, {cpu / study.rows:.3f} CPU s a row"
        )
    print(f"of twice the speed: {times[0] / (2 * times[1]):.2f}")


if __name__ == "__main__":
    main()
