"""Workers end with the command, whatever ends that; the core before is the pinned one, in a process of its own."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from benchmarks.gap import before, processes
from benchmarks.gap.cases import case_files
from benchmarks.gap.generate import generate
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


def test_the_core_before_is_unpacked_once_from_the_history(tmp_path: Path) -> None:
    try:
        tree = before.extracted(tmp_path)
    except before.NoHistoryError as error:
        pytest.skip(str(error))
    assert (tree / "hapticd/gap/workflow.py").is_file()
    assert before.extracted(tmp_path) == tree
    assert [path.name for path in tmp_path.iterdir()] == [tree.name]
    # Its workflow compiles for half a minute before it can fail by itself.
    (tree / "hapticd/gap/__init__.py").write_text("raise ImportError('the workflow of the core before')\n")
    found = before.answer({"model.yaml": b"{}", "run.csv": b"x\n"}, tree=tree, limit_s=100.0)
    assert str(tree) in found["error"]
    assert "the workflow of the core before" in found["error"]


def test_a_core_that_takes_too_long_has_not_answered(tmp_path: Path) -> None:
    (tmp_path / "hapticd").mkdir()
    (tmp_path / "hapticd/__init__.py").write_text("while True:\n    pass\n")
    found = before.answer({"model.yaml": b"{}"}, tree=tmp_path, limit_s=1.0)
    assert found["late"] == "no answer in 1 s"


def test_the_core_before_gets_a_run_file_as_bare_columns(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It refuses run files with settings that it does not know."""
    made = generate([], 1, 2.0)
    monkeypatch.setattr(
        before, "_run", lambda folder, *_: {file.name: pq.read_table(file) for file in folder.glob("run.*")}
    )
    as_run, as_columns = (before.answer(case_files(made, form), tree=tmp_path) for form in ("arrow", "parquet"))
    assert as_run["run.parquet"].column_names == as_columns["run.parquet"].column_names
    for name in as_columns["run.parquet"].column_names:
        np.testing.assert_allclose(as_run["run.parquet"][name], as_columns["run.parquet"][name], rtol=0.0, atol=1e-8)
