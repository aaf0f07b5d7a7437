import json
import os
import signal

import pytest
from tests.studies.conftest import rows_of

from omniservo.errors import InputError, NoSolutionError
from omniservo.studies import PACKAGE, run_study
from omniservo.studies.run_by_scheduler import run_by_scheduler
from omniservo.studies.study_folder import HEADER, this_machine
from omniservo.studies.study_parts import PartWork

distributed = pytest.importorskip("distributed", reason="dask[distributed] is not installed")


@pytest.fixture(scope="module")
def cluster():
    """A scheduler on loopback and two worker processes."""
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address="127.0.0.1:0", host="127.0.0.1", silence_logs=50
    ) as cluster:
        yield cluster


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_an_interrupted_run_on_a_cluster_is_gone_on_with_here(study, undisturbed, cluster, tmp_path):
    def interrupt(stage, share):
        if share:
            raise KeyboardInterrupt

    folder = tmp_path / "rows"
    with pytest.raises(KeyboardInterrupt):
        run_study(study, folder, scheduler=cluster.scheduler_address, progress=interrupt)
    assert len(list((folder / "parts").glob("0*"))) == 1
    assert run_study(study, folder, workers=1)
    assert rows_of(folder) == rows_of(undisturbed)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_parts_of_workers_with_another_version_are_not_written(study, cluster, tmp_path, monkeypatch):
    """The workers find the version of their own package, whatever the one who asks has."""
    monkeypatch.setitem(vars(PACKAGE), "version", "0.1.0+another0")
    with pytest.raises(InputError, match=r"jsonl.gz: version: '0.1.0\+[0-9a-f]{8}'; '0.1.0\+another0' is"):
        run_study(study, tmp_path / "rows", scheduler=cluster.scheduler_address)
    assert not list((tmp_path / "rows" / "parts").iterdir())


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_what_fails_on_a_worker_is_named(study, cluster, tmp_path):
    work = PartWork(study.to_json(), PACKAGE)
    with pytest.raises(
        NoSolutionError, match="the cluster gives no rows: TypeError: .*the same command goes on"
    ):
        run_by_scheduler(work, tmp_path, ["no number"], cluster.scheduler_address, print, print)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_a_cluster_without_workers_is_said_and_waited_for(study, undisturbed, tmp_path):
    with distributed.LocalCluster(
        n_workers=0, threads_per_worker=1, dashboard_address="127.0.0.1:0", host="127.0.0.1", silence_logs=50
    ) as cluster:
        stages = []

        def start_a_worker_when_asked(stage, share):
            stages.append(stage)
            if "waiting for a worker" in stage:
                cluster.scale(1)

        folder = tmp_path / "rows"
        address = cluster.scheduler_address
        assert run_study(study, folder, scheduler=address, progress=start_a_worker_when_asked)
    assert f"waiting for a worker of {address}" in stages[1]
    assert rows_of(folder) == rows_of(undisturbed)


def test_a_scheduler_that_does_not_answer_is_named(study, tmp_path, monkeypatch):
    monkeypatch.setattr("omniservo.studies.run_by_scheduler._PATIENCE", 0.2)
    with pytest.raises(InputError, match=r"scheduler: 'tcp://127.0.0.1:9': no scheduler answers there"):
        run_study(study, tmp_path / "rows", scheduler="tcp://127.0.0.1:9")
    with pytest.raises(InputError, match="scheduler: 'gopher:///1': no scheduler answers there"):
        run_study(study, tmp_path / "rows", scheduler="gopher:///1")
    monkeypatch.setattr(distributed, "Client", None)  # one of no address would wait for itself at the end
    with pytest.raises(InputError, match=r"scheduler: 'head': no scheduler answers there \(missing port"):
        run_study(study, tmp_path / "rows", scheduler="head")


@pytest.mark.slow
def test_without_dask_a_message_names_what_is_to_be_installed(study, tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "distributed", None)
    with pytest.raises(InputError, match=r"pip install omniservo\[cluster\]"):
        run_study(study, tmp_path / "rows", scheduler="tcp://127.0.0.1:9")


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # of what the killed worker leaves
def test_rows_of_a_cluster_whose_worker_is_killed_are_those_of_one_process(
    study, undisturbed, cluster, tmp_path
):
    with distributed.Client(cluster, set_as_default=False) as client:
        pids = client.run(os.getpid)
        killed = []

        def kill_one_at_work(stage, share):
            busy = [address for address, parts in client.processing().items() if parts]
            if share and busy and not killed:
                killed.append(pids[busy[0]])
                os.kill(killed[0], signal.SIGKILL)

        folder = tmp_path / "rows"
        assert run_study(study, folder, scheduler=cluster.scheduler_address, progress=kill_one_at_work)
    assert killed
    assert rows_of(folder) == rows_of(undisturbed)
    assert json.loads((folder / HEADER).read_text())["machines"] == [this_machine()]
