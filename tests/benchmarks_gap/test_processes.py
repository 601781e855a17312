"""Workers end with the command, whatever ends that."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from benchmarks.gap import processes
from tests.polling import wait_until

_COMMAND = """
import sys, time
from pathlib import Path
from benchmarks.gap import processes
from tests.benchmarks_gap.test_processes import sleep
if __name__ == "__main__":
    processes.end_on_sigterm()
    with processes.pool(2) as pool:
        waiting = [pool.submit(sleep, sys.argv[1], number) for number in range(3)]
        waiting[0].result()
"""


def sleep(folder: str, number: int) -> None:
    """A case that takes long, and a peer's process under it that ends with its parent."""
    (Path(folder) / f"{number}.worker").write_text(str(os.getpid()))
    end = "from benchmarks.gap.processes import end_with_parent; end_with_parent()"
    code = f"import time; {end}; print(flush=True); time.sleep(600)"
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE) as child:
        assert child.stdout is not None
        child.stdout.readline()
        (Path(folder) / f"{number}.child").write_text(str(child.pid))


def _written(folder: Path) -> list[int]:
    texts = [path.read_text() for path in (*folder.glob("*.worker"), *folder.glob("*.child"))]
    return [int(text) for text in texts if text]


def _runs(process: int) -> bool:
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGKILL], ids=lambda number: number.name)
def test_what_ends_the_command_ends_its_workers_at_once(number: signal.Signals, tmp_path: Path) -> None:
    script = tmp_path / "command.py"
    script.write_text(_COMMAND)
    path = os.pathsep.join(sys.path)
    command = subprocess.Popen(
        [sys.executable, str(script), str(tmp_path)], env={**os.environ, "PYTHONPATH": path}, stderr=subprocess.DEVNULL
    )
    try:
        wait_until(lambda: len(_written(tmp_path)) == 4, "two workers with a process each")
        started = _written(tmp_path)
        command.send_signal(number)
        begin = time.monotonic()
        command.wait(20.0)
        wait_until(lambda: not any(map(_runs, started)), "all of them are gone", 20.0)
        assert time.monotonic() - begin < 10.0
    finally:
        command.kill()


def test_work_that_ends_by_itself_is_not_disturbed() -> None:
    with processes.pool(1) as pool:
        assert pool.submit(abs, -3).result(60.0) == 3
