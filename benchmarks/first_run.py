"""What the first minute costs, from an empty kernel cache: ``python -m benchmarks.first_run [--quick]``.

Each job is a process of its own, first with an empty cache, then again with what it left there. CPU is user
and system time of the process and all that it started; the wall time beside it is that of this machine now.
Bytecode is there before, as after an installation.
The lines are README's. ``--quick`` leaves out the run.
"""

from __future__ import annotations

import argparse
import compileall
import os
import re
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter

from benchmarks.tables import print_table

import omniservo

PACKAGE = Path(omniservo.__file__).parent
README = Path(__file__).resolve().parents[1] / "README.md"
RUN = ["-m", "omniservo.cli.main", "run", "paper-example-1", "--quiet", "--force", "--out"]


def readme_lines() -> str:
    """Return the first Python block of the README."""
    found = re.search(r"```python\n(.*?)```", README.read_text(), re.DOTALL)
    assert found is not None
    return found.group(1)


def cost(arguments: list[str], cache: Path) -> tuple[float, float, int]:
    """Run Python with these arguments: CPU and wall time [s], and how many kernels the cache has then."""
    environment = os.environ | {"XDG_CACHE_HOME": str(cache)}
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), perf_counter()
    subprocess.run([sys.executable, *arguments], env=environment, check=True, stdout=subprocess.DEVNULL)
    wall, after = perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime
    return cpu, wall, len(list(cache.rglob("*.kernel")))


def main() -> None:
    """Print a row a job."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--quick", action="store_true", help="without the run")
    quick = parser.parse_args().quick
    compileall.compile_dir(PACKAGE, quiet=2)
    with tempfile.TemporaryDirectory() as folder:
        jobs = [
            ("import omniservo", ["-c", "import omniservo"], 1),
            ("omniservo --help", ["-m", "omniservo.cli.main", "--help"], 1),
            ("README's twelve lines", ["-c", readme_lines()], 2),
        ]
        if not quick:
            jobs.append(("run paper-example-1", [*RUN, str(Path(folder) / "run")], 2))
        rows = []
        for name, arguments, times in jobs:
            cache = Path(folder) / f"cache-{len(rows)}"
            for again in range(times):
                cpu, wall, kernels = cost(arguments, cache)
                state = "–" if times == 1 else ("warm" if again else "empty")
                rows.append(f"{name} | {state} | {cpu:.2f} | {wall:.2f} | {kernels}")
        print_table("| job | cache | CPU [s] | wall [s] | kernels kept |", rows)


if __name__ == "__main__":
    main()
