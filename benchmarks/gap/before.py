"""The core before the present one as a peer: the workflow of one pinned commit, in a process of its own.

`prepared` unpacks that commit's packages from the repository's history and compiles them; `answer` runs its ``find_gap`` on
the same files that the workflow gets. It took minutes a case, so there is a limit, after which it counts as not having
answered; it is one of processor time, so that what else the machine does is not held against it.
"""

from __future__ import annotations

import io
import json
import os
import shutil
import signal
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.gap import tasks
from benchmarks.gap.cases import Files, parquet_of
from benchmarks.gap.plan import Case
from hapticd.record import read_run

COMMIT = "9c9c749"
_PACKAGES = ("hapticd", "drivers")
LIMIT_S = 300.0
_COMPILED_ON_S = 4.0
_RUNNER = Path(__file__).with_name("before_runner.py")


class NoHistoryError(Exception):
    """The commit cannot be had; the text says why."""


def prepared(root: Path) -> Path:
    """The commit's packages in a folder of the benchmark's, compiled, both once.

    Raises:
        NoHistoryError: as `extracted`.
    """
    tree = extracted(root)
    compiled = tree / "compiled"
    if not compiled.exists():
        files, _ = tasks.make(Case("none", (), (), 0, 0, "re35", "parquet", _COMPILED_ON_S))
        found = answer(files, tree=tree, limit_s=None)
        if "error" in found:
            raise NoHistoryError(f"the core before does not run here: {found['error'].strip().splitlines()[-1]}")
        compiled.touch()
    return tree


def extracted(root: Path) -> Path:
    """The commit's packages in a folder of the benchmark's, unpacked once.

    Raises:
        NoHistoryError: this is no clone of the repository that has the commit.
    """
    tree = root.resolve() / f"core-{COMMIT}"
    if tree.is_dir():
        return tree
    repository = Path(__file__).parents[2]
    command = ["git", "-C", str(repository), "archive", COMMIT, *_PACKAGES]
    try:
        archive = subprocess.run(command, check=True, capture_output=True).stdout
    except FileNotFoundError as error:
        raise NoHistoryError(f"the core before needs git: {error}") from None
    except subprocess.CalledProcessError as error:
        raise NoHistoryError(f"the core before needs commit {COMMIT}: {error.stderr.decode().strip()}") from None
    root.mkdir(parents=True, exist_ok=True)
    part = Path(tempfile.mkdtemp(dir=root, prefix=f".{tree.name}."))
    try:
        with tarfile.open(fileobj=io.BytesIO(archive)) as files:
            files.extraction_filter = getattr(tarfile, "data_filter", lambda member, path: member)  # from 3.11.4 on
            files.extractall(part)
        part.rename(tree)
    except BaseException:
        shutil.rmtree(part)
        raise
    return tree


def answer(
    files: Files, excluded: Sequence[str] = (), *, tree: Path, limit_s: float | None = LIMIT_S
) -> dict[str, Any]:
    """What that core answers, and the time it took; ``{"late": …}`` if that was not enough.

    Args:
        files: of the case.
        excluded: slugs that it may not name.
        tree: from `extracted`; a Dask worker must see the same folder.
        limit_s: processor time of the whole process; None for no limit.
    """
    return tasks.timed(lambda folder: _run(folder, excluded, tree, limit_s), _readable(files))


def _readable(files: Files) -> Files:
    """The files, a run file as bare columns: that core refuses settings of today that it does not know."""
    if "run.arrow" not in files:
        return files
    with tempfile.TemporaryDirectory(prefix="gap-") as folder:
        path = Path(folder) / "run.arrow"
        path.write_bytes(files["run.arrow"])
        run = read_run(path).columns
    columns = {
        "time_s": run["time_s"] + 1e-9 * run["wake_late_ns"],
        "encoder_counts": run["encoder_counts"],
        "current_command_A": run["current_command_A"],
    }
    return {"model.yaml": files["model.yaml"], "run.parquet": parquet_of(columns)}


def _run(folder: Path, excluded: Sequence[str], tree: Path, limit_s: float | None) -> dict[str, Any]:
    # -P keeps the runner's own folder off the path: the tree is the only hapticd there is.
    command = [sys.executable, "-P", str(_RUNNER), str(folder), str(tree), f"{limit_s or 0:.0f}", *excluded]
    environment = {**os.environ, "PYTHONPATH": str(tree)}
    done = subprocess.run(command, env=environment, capture_output=True, check=False)
    if done.returncode == -signal.SIGXCPU:
        return {"late": f"no answer in {limit_s:g} s"}
    if done.returncode:
        return {"error": done.stderr.decode(errors="replace")[-4000:]}
    found: dict[str, Any] = json.loads(done.stdout)
    return found
