"""A study disturbed in every way that its runner promises to bear, beside the same one undisturbed.

Run: ``python -m benchmarks.study_faults [SCENES] [SECONDS]``; a row is a closed loop of at most SECONDS.
SCENES are drawn for each of two cameras and met by eight methods, so 6250 make 10⁵ rows. Undisturbed: two
processes. Shards: four, one of them run twice in two folders, one with a part spoilt, which is named and
run again. Cluster: a Dask scheduler and three workers on loopback, one of which is killed while it works.
"""

from __future__ import annotations

import os
import signal
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from time import perf_counter

from distributed import Client, LocalCluster

from omniservo.errors import InputError
from omniservo.files import whole_folder
from omniservo.studies import Shard, Study, load_study, merge_studies, read_parts, run_study, write_rows

SHARDS = 4


def main() -> None:
    """Print whether the tables are the same to the byte."""
    scenes = int(sys.argv[1]) if len(sys.argv) > 1 else 60
    seconds = float(sys.argv[2]) if len(sys.argv) > 2 else 0.5
    quick = load_study("quick")
    study = quick.model_validate(
        {**dict(quick), "scenes": scenes, "limits": quick.limits.model_copy(update={"seconds": seconds})}
    )
    print(f"{study.rows} rows, of {seconds:g} s at most")
    with tempfile.TemporaryDirectory() as made:
        undisturbed = _table("undisturbed, two processes", _undisturbed, study, Path(made))
        for name, run in (("shards", _in_shards), ("cluster", _on_cluster)):
            same = _table(name, run, study, Path(made)) == undisturbed
            print(f"{name}: {'the same table, byte for byte' if same else 'ANOTHER TABLE'}")


def _table(name: str, run: Callable[[Study, Path], Path], study: Study, made: Path) -> bytes:
    begin = perf_counter()
    folder = run(study, made)
    print(f"{name}: {perf_counter() - begin:.0f} s")
    return write_rows(folder, (row for part in read_parts(folder) for row in part.rows)).read_bytes()


def _undisturbed(study: Study, made: Path) -> Path:
    run_study(study, made / "undisturbed", workers=2)
    return made / "undisturbed"


def _in_shards(study: Study, made: Path) -> Path:
    folders = [made / f"shard-{number}" for number in range(1, SHARDS + 1)]
    for number, folder in enumerate(folders, 1):
        run_study(study, folder, workers=2, shard=Shard(number, SHARDS))
    again = made / "shard-2-again"
    run_study(study, again, workers=2, shard=Shard(2, SHARDS))
    spoilt = next((folders[2] / "parts").glob("0*"))
    spoilt.write_bytes(spoilt.read_bytes()[:-100])
    for attempt in range(2):
        try:
            with whole_folder(made / "merged", "study.json") as work:
                _, certificates = merge_studies([*folders, again], work)
        except InputError as error:
            print(f"shards: refused: {str(error).removeprefix(str(made))}")
            assert attempt == 0
            spoilt.unlink()
            run_study(study, folders[2], workers=2, shard=Shard(3, SHARDS))
    print(f"shards: {certificates} certificates judged again")
    return made / "merged"


def _on_cluster(study: Study, made: Path) -> Path:
    folder = made / "cluster"
    killed: list[int] = []
    with (
        LocalCluster(
            n_workers=3,
            threads_per_worker=1,
            host="127.0.0.1",
            dashboard_address="127.0.0.1:0",
            silence_logs=50,
        ) as cluster,
        Client(cluster, set_as_default=False) as client,
    ):
        pids = client.run(os.getpid)

        def kill_one(stage: str, share: float) -> None:
            busy = [address for address, parts in client.processing().items() if parts and address in pids]
            if share > 0.2 and busy and not killed:
                killed.append(pids[busy[0]])
                os.kill(killed[0], signal.SIGKILL)

        run_study(study, folder, scheduler=cluster.scheduler_address, progress=kill_one)
    print(f"cluster: {len(killed)} of 3 workers killed")
    return folder


if __name__ == "__main__":
    main()
