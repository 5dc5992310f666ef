"""What may go wrong under a fleet costs one log's attempt and nothing else: workers, memory, disks, clusters."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from tests.copies import kept
from tests.fleet_logs import WORK, write_logs

from rotorid.errors import UsageError
from rotorid.fleets import Cluster, Fleet, FleetSettings, Limits, Processes, engines
from rotorid.fleets.engines import Child, versions_here
from rotorid.fleets.table import TABLE
from rotorid.io.copies import Program

pytest.importorskip("pyarrow")
posix = pytest.mark.skipif(os.name == "nt", reason="signals and limits of POSIX")
SETTINGS = FleetSettings(models=("rate.roll",))
LIMITS = Limits(work=WORK, timeout_s=60.0, memory_bytes=1 << 30)
ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(autouse=True)
def _one_program(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fleets of these tests copy one process; most are started to be killed."""
    monkeypatch.setattr(engines, "Program", kept)


def finished(logs: Path, out: Path, engine: Any) -> Fleet:
    one = Fleet([logs], SETTINGS, out, engine=engine)
    try:
        list(one)
        one.write_tables()
    finally:
        one.close()
    return one


def require_all(one: Fleet, numbers: range) -> None:
    """Every row once."""
    assert sorted(row.value for row in one.rows()) == [100.0 + k for k in numbers]


@pytest.mark.slow
@posix
def test_workers_killed_ten_times_during_a_hundred_logs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_logs(tmp_path / "logs", 100, "slow")
    children: list[Child] = []
    begin = Child.__init__

    def remembered(self: Child, limits: Limits, program: Program) -> None:
        begin(self, limits, program)
        children.append(self)

    monkeypatch.setattr(Child, "__init__", remembered)
    killed = 0

    def kill() -> None:
        nonlocal killed
        while killed < 10:
            time.sleep(0.45)
            if (pid := children[killed % 2].pid) is not None:
                os.kill(pid, signal.SIGKILL)
                killed += 1

    thread = threading.Thread(target=kill, daemon=True)
    one = Fleet([tmp_path / "logs"], SETTINGS, tmp_path / "out", engine=Processes(2, LIMITS))
    thread.start()
    list(one)
    one.close()
    failed = {failure.log for failure in one.failures()}
    assert killed == 10
    assert len(one.rows()) + len(failed) == 100
    assert len(failed) <= 1
    again = finished(tmp_path / "logs", tmp_path / "out", Processes(2, LIMITS))
    require_all(again, range(1, 101))
    assert again.resumed == 100 - len(failed)


@posix
def test_logs_that_kill_hang_and_eat_are_set_aside(tmp_path: Path) -> None:
    folder = tmp_path / "logs"
    write_logs(folder, 20)
    for number, word in enumerate(("die", "hang", "memory", "unreadable"), start=101):
        write_logs(folder, 1, word, first=number)
    limits = Limits(work=WORK, timeout_s=1.5, memory_bytes=1 << 30)
    # Only the first answer of a worker waits for its imports, and this test for it.
    one = finished(folder, tmp_path / "out", Processes(2, limits))
    assert len(one.rows()) == 20
    kinds = {failure.log: failure.kind for failure in one.failures()}
    assert kinds == {
        "log-0101.ulg": "died",
        "log-0102.ulg": "time",
        "log-0103.ulg": "memory",
        "log-0104.ulg": "unreadable",
    }
    assert "set aside" in next(failure.reason for failure in one.failures() if failure.kind == "died")
    # What ended a worker is tried again by the next run; what cannot be read is not.
    again = finished(folder, tmp_path / "out", Processes(2, limits))
    assert again.resumed == 21


def test_a_real_hostile_log_costs_itself(tmp_path: Path) -> None:
    folder = tmp_path / "logs"
    folder.mkdir()
    (folder / "random.ulg").write_bytes(b"ULog\x01\x12\x35" + os.urandom(4096))
    (folder / "empty.bin").write_bytes(b"")
    (folder / "page.csv").write_text("<html>\n")
    one = finished(folder, tmp_path / "out", Processes(1, Limits(timeout_s=120.0)))
    assert not one.rows()
    assert {failure.kind for failure in one.failures()} <= {"unreadable", "refused"}
    assert len(one.failures()) == 3


@posix
def test_a_full_disk_ends_the_run_with_a_sentence_and_the_next_goes_on(tmp_path: Path) -> None:
    write_logs(tmp_path / "logs", 30)
    code = (
        "import resource, signal, sys; signal.signal(signal.SIGXFSZ, signal.SIG_IGN);"
        "from tests.hostile.test_fleet_faults import finished, LIMITS, Processes; from pathlib import Path;"
        "from rotorid.errors import UsageError;"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (6000, 6000));"
        "logs, out = map(Path, sys.argv[1:]);\n"
        "try: finished(logs, out, Processes(1, LIMITS))\n"
        "except UsageError as error: print(error); sys.exit(2)"
    )
    child = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path / "logs"), str(tmp_path / "out")],
        capture_output=True,
        text=True,
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "src")])},
        check=False,
    )
    assert (child.returncode, "cannot be written" in child.stdout) == (2, True), child.stderr
    again = finished(tmp_path / "logs", tmp_path / "out", Processes(2, LIMITS))
    require_all(again, range(1, 31))
    assert 3 <= again.resumed < 30


# A cluster


@contextmanager
def scheduler(port: int) -> Iterator[subprocess.Popen[bytes]]:
    one = dask("distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard")
    try:
        yield one
    finally:
        ended(one)


def dask(module: str, *words: str) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-m", module, *words],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        cwd=ROOT,
        start_new_session=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "src")]), "OPENBLAS_NUM_THREADS": "1"},
    )


def ended(process: subprocess.Popen[bytes]) -> None:
    try:
        os.killpg(process.pid, signal.SIGKILL)
    except (ProcessLookupError, AttributeError):
        process.kill()
    process.wait()


def a_worker(port: int, *words: str) -> subprocess.Popen[bytes]:
    return dask(
        "distributed.cli.dask_worker", f"tcp://127.0.0.1:{port}", "--nthreads", "1", "--no-dashboard",
        "--no-nanny", "--host", "127.0.0.1", *words,
    )  # fmt: skip


def free_port() -> int:
    import socket

    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


quiet = pytest.mark.filterwarnings("ignore")


@pytest.mark.slow
@posix
@quiet
def test_a_scheduler_with_two_workers_gives_the_same_bytes_although_one_is_killed(tmp_path: Path) -> None:
    pytest.importorskip("distributed")
    write_logs(tmp_path / "logs", 40, "slow")
    finished(tmp_path / "logs", tmp_path / "here", Processes(1, LIMITS))
    port = free_port()
    with scheduler(port):
        workers = [a_worker(port), a_worker(port)]
        try:
            engine = Cluster(f"tcp://127.0.0.1:{port}", LIMITS)
            one = Fleet([tmp_path / "logs"], SETTINGS, tmp_path / "there", engine=engine)
            for count, _ in enumerate(one, start=1):
                if count == 8:
                    ended(workers[0])
            one.write_tables()
            one.close()
        finally:
            for worker in workers:
                ended(worker)
    assert (tmp_path / "here" / TABLE).read_bytes() == (tmp_path / "there" / TABLE).read_bytes()


@pytest.mark.slow
@posix
@quiet
def test_a_scheduler_that_is_restarted_costs_time_alone(tmp_path: Path) -> None:
    pytest.importorskip("distributed")
    write_logs(tmp_path / "logs", 40, "slow")
    port = free_port()
    with scheduler(port) as first:
        worker = a_worker(port)
        again: list[subprocess.Popen[bytes]] = []
        try:
            engine = Cluster(f"tcp://127.0.0.1:{port}", LIMITS, patience_s=60.0)
            one = Fleet([tmp_path / "logs"], SETTINGS, tmp_path / "out", engine=engine)
            for count, _ in enumerate(one, start=1):
                if count == 8:
                    ended(first)
                    ended(worker)
                    again.append(
                        dask(
                            "distributed.cli.dask_scheduler",
                            "--host",
                            "127.0.0.1",
                            "--port",
                            str(port),
                            "--no-dashboard",
                        )
                    )
                    again.append(a_worker(port))
            one.close()
        finally:
            for process in (worker, *again):
                ended(process)
    require_all(one, range(1, 41))


@quiet
def test_a_client_of_a_local_cluster_gives_the_same_bytes_and_stays_open(tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed")
    write_logs(tmp_path / "logs", 12)
    write_logs(tmp_path / "logs", 1, "die", first=50)
    finished(tmp_path / "logs", tmp_path / "here", Processes(2, LIMITS))
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=False, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
    ):
        one = finished(tmp_path / "logs", tmp_path / "there", Cluster(client, LIMITS))
        assert client.status == "running"
    assert [failure.kind for failure in one.failures()] == ["died"]
    assert (tmp_path / "here" / TABLE).read_bytes() == (tmp_path / "there" / TABLE).read_bytes()


def test_a_scheduler_that_is_not_there_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr("rotorid.fleets.engines._CONNECT_S", 1.0)
    with pytest.raises(UsageError, match="cannot be reached"):
        Cluster(f"tcp://127.0.0.1:{free_port()}", LIMITS)


@quiet
def test_workers_of_other_versions_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
    ):
        own = versions_here()
        monkeypatch.setattr(client, "run", lambda _: {"tcp://there": {**own, "numpy": "1.0"}})
        with pytest.raises(UsageError, match=r"numpy 1\.0 there"):
            Cluster(client, LIMITS)
