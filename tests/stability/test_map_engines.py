from __future__ import annotations

import importlib.util
import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from hapticd.stability import map_engines, map_store
from hapticd.stability.maps import Chunk, Maps, Study, chunks, run_chunk

STUDY = Study(beta_count=68, sigma_count=21, velocities=(1.0, 10.0), periods=20_000)
needs_dask = pytest.mark.skipif(
    importlib.util.find_spec("distributed") is None, reason="the optional extra 'dask' is not installed"
)


@pytest.mark.parametrize("jobs", [1, 2, 5])
def test_threads_give_what_one_call_after_the_other_gives(jobs: int) -> None:
    wanted = chunks(STUDY)[:7]
    found = dict(map_engines.local(wanted, jobs))
    assert set(found) == set(wanted)
    for chunk in wanted:
        np.testing.assert_array_equal(found[chunk], run_chunk(chunk))


def test_closing_early_ends_the_threads() -> None:
    results = map_engines.local(chunks(STUDY), 2)
    next(results)
    results.close()
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("map")]


def test_without_distributed_the_error_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(map_engines.ClusterError, match=r"pip install 'hapticd\[dask\]'"):
        list(map_engines.dask(chunks(STUDY), "tcp://127.0.0.1:1"))


@needs_dask
@pytest.mark.filterwarnings("default")
@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "nonsense://x"])
def test_a_missing_scheduler_is_named(address: str) -> None:
    with pytest.raises(map_engines.ClusterError, match=f"no Dask scheduler at {address}"):
        list(map_engines.dask(chunks(STUDY), address, connect_s=0.5))


class Cluster:
    """A scheduler and two workers, each a process of its own."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._processes: list[subprocess.Popen[bytes]] = []
        file = folder / "scheduler.json"
        common = ("--scheduler-file", str(file), "--no-dashboard", "--host", "127.0.0.1")
        self._start("scheduler", "--port", "0", *common)
        self.workers = [self._start("worker", "--nthreads", "1", "--no-nanny", *common) for _ in range(2)]
        deadline = time.monotonic() + 60.0
        while not (file.exists() and file.read_bytes().endswith(b"}")) and time.monotonic() < deadline:
            time.sleep(0.05)  # it is there, and empty, before it is written
        self.address = str(json.loads(file.read_text())["address"])

    def _start(self, kind: str, *words: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", f"distributed.cli.dask_{kind}", *words]
        if kind == "worker":
            command += ["--local-directory", str(self.folder)]
        with (self.folder / f"{kind}.log").open("ab") as log:
            process = subprocess.Popen(command, stdout=log, stderr=log, cwd=self.folder)
        self._processes.append(process)
        return process

    def stop(self) -> None:
        for process in self._processes:
            process.kill()
            process.wait()


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[Cluster]:
    running = Cluster(tmp_path)
    yield running
    running.stop()


@needs_dask
@pytest.mark.filterwarnings("default")
def test_a_cluster_that_loses_a_worker_gives_the_same_maps(cluster: Cluster, tmp_path: Path) -> None:
    from distributed import Client

    victim = cluster.workers[0]
    held: list[int] = []

    with Client(cluster.address, set_as_default=False) as watcher:
        watcher.wait_for_workers(2, timeout=60)
        pids = watcher.run(os.getpid)
        assert set(pids.values()) == {worker.pid for worker in cluster.workers}
        (name,) = (worker for worker, pid in pids.items() if pid == victim.pid)

        def kill() -> None:
            held.append(len(watcher.processing()[name]))
            victim.send_signal(signal.SIGKILL)

        # stopped first and killed a little later, so that it dies with work on its hands and not between two chunks
        killer = threading.Timer(0.3, kill)

        def engine(wanted: list[Chunk]) -> map_engines.Results:
            for k, result in enumerate(map_engines.dask(wanted, cluster.address)):
                if k == 3:
                    victim.send_signal(signal.SIGSTOP)
                    killer.start()
                yield result

        maps, alone = Maps(STUDY), Maps(STUDY)
        map_store.fill(maps, engine, tmp_path / "maps.npz")
        killer.join()
    map_store.fill(alone, map_engines.local, None)
    assert held
    assert held[0] > 0
    assert victim.wait() == -signal.SIGKILL
    assert maps.done.all()
    np.testing.assert_array_equal(maps.points, alone.points)
    np.testing.assert_array_equal(map_store.load(tmp_path / "maps.npz").points, alone.points)
