"""How long ``hapticd gap`` takes with the whole catalogue, and how much memory: recordings of 20 s and of 60 s at 1 kHz.

Each recording is made by the generator of the blind benchmark (:mod:`benchmarks.gap`) with a clearly visible effect, or
none, and analysed by the command as a user would run it: reading, fits, report, and the next experiment where effects stay
tied. Code is compiled before, as an installation does. The peer, sparse regression with PySINDy
(:mod:`benchmarks.gap.peer`), gets the same files in the same run; without PySINDy (``pip install 'hapticd[bench]'``) that
figure is left out.
"""

from __future__ import annotations

import importlib.util
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.gap import tasks
from benchmarks.gap.cases import write_files
from benchmarks.gap.plan import Case
from benchmarks.report import BenchmarkError, Figure, progress, run_alone

MEMORY_GOAL_MB = 2000.0
_SEED = 11
_NOTHING = "nothing hidden"
SHORT = (
    _NOTHING,
    "coulomb_friction",
    "stribeck",
    "torque_ripple",
    "dropped_samples",
    "presliding",
    "backlash",
    "flexible_coupling",
)
LONG = (_NOTHING, "coulomb_friction", "torque_ripple", "flexible_coupling")
QUICK = (_NOTHING, "flexible_coupling")
_PEER = "import sys; from pathlib import Path; from benchmarks.gap.peer import identify; identify(Path(sys.argv[1]))"
_ENDS_WELL = (0, 1)
"""Exit codes of an analysis that came to its end: 1 says that something stays unexplained."""


@dataclass(frozen=True)
class Spent:
    """What one process took."""

    wall_s: float
    processor_s: float
    memory_MB: float


def spent_on(command: list[str]) -> Spent:
    """Run a command to its end.

    Raises:
        BenchmarkError: it failed.
    """
    with tempfile.TemporaryFile() as errors:
        begin = time.perf_counter()
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=errors)
        _, status, usage = os.wait4(process.pid, 0)
        wall = time.perf_counter() - begin
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode not in _ENDS_WELL:
            errors.seek(0)
            raise BenchmarkError(f"{' '.join(command[:4])} failed: {errors.read().decode()[-500:]}")
    return Spent(wall, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024.0)


def recorded(folder: Path, hidden: str, duration_s: float) -> Path:
    """A recording and its nominal model in a folder of their own."""
    slugs = () if hidden == _NOTHING else (hidden,)
    kind, strength = ("single", "clear") if slugs else ("none", "none")
    case = Case(kind, slugs, strength, _SEED, "re35", "parquet", duration_s)
    here = folder / case.name
    write_files(here, tasks.make(case)[0])
    return here


def analysed(here: Path) -> tuple[Spent, dict[str, Any]]:
    """What the command took, and its gap.json."""
    run, model, out = str(tasks.run_file(here)), str(here / "model.yaml"), here / "out"
    spent = spent_on([sys.executable, "-m", "hapticd.cli", "gap", run, "--model", model, "-o", str(out)])
    return spent, json.loads((out / "gap.json").read_text())


def _figures(folder: Path, names: tuple[str, ...], duration_s: float, ratios: list[float]) -> list[Figure]:
    """Wall time and peak memory of some recordings; what the peer took is compared in `ratios`."""
    figures, most = [], 0.0
    for hidden in names:
        progress(f"{duration_s:g} s, {hidden}: recording")
        here = recorded(folder, hidden, duration_s)
        spent, answer = analysed(here)
        details: dict[str, Any] = {
            "processor_s": spent.processor_s,
            "memory_MB": spent.memory_MB,
            "verdict": answer["verdict"],
            "effects": answer["effects"],
            "load_average": os.getloadavg()[0],
        }
        if importlib.util.find_spec("pysindy"):
            peer = spent_on([sys.executable, "-c", _PEER, str(here)])
            details["pysindy_s"] = peer.wall_s
            ratios.append(spent.wall_s / peer.wall_s)
        most = max(most, spent.memory_MB)
        progress(f"  {spent.wall_s:.1f} s, {spent.processor_s:.1f} s of processors: {answer['verdict']}")
        figures.append(Figure(f"{duration_s:g} s, {hidden}", spent.wall_s, "s", duration_s, details=details))
    return [*figures, Figure(f"peak memory, {duration_s:g} s", most, "MB", MEMORY_GOAL_MB)]


def measure(quick: bool) -> list[Figure]:
    """Seconds of the command, megabytes, and the ratio to the peer."""
    ratios: list[float] = []
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        progress("compiling")
        analysed(recorded(folder, "flexible_coupling", 5.0))
        figures = _figures(folder, QUICK if quick else SHORT, 20.0, ratios)
        if not quick:
            figures += _figures(folder, LONG, 60.0, ratios)
    if ratios:
        figures.append(Figure("wall time over the peer's, median", statistics.median(ratios), "×", peer="PySINDy"))
    return figures


def main(argv: list[str] | None = None) -> int:
    """Run this benchmark alone."""
    return run_alone("gap_speed", measure, argv)


if __name__ == "__main__":
    sys.exit(main())
