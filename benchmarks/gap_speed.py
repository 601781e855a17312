"""How long the gap workflow takes on one core with the whole catalogue, and how much memory: 20 s and 60 s at 1 kHz.

Each recording is made by the generator of the blind benchmark (:mod:`benchmarks.gap`) with one effect at three fifths of its
full strength, or none, and analysed through the public call in a process of its own that has one core: reading and finding,
without the report. Code is compiled before, as an installation does. The peer, sparse regression with PySINDy
(:mod:`benchmarks.gap.sindy`), gets the same files in the same way; without it (``pip install 'hapticd[bench]'``) that figure
is left out.
"""

from __future__ import annotations

import importlib.util
import json
import os
import statistics
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.gap import tasks
from benchmarks.gap.cases import write_files
from benchmarks.gap.plan import Case
from benchmarks.report import BenchmarkError, Figure, progress

MEMORY_GOAL_MB = 500.0
LONGER = 3.0
"""What 60 s may take over what 20 s take."""
_SEED, _STRENGTH = 11, 0.6
_QUICK_S, _SHORT_S, _LONG_S = 5.0, 20.0, 60.0
_NOTHING = "nothing missing"


class Kind(NamedTuple):
    """A kind of recording, and the seconds that 20 s of it may take."""

    name: str
    goal_s: float
    hidden: tuple[str, ...]


KINDS = (
    Kind(_NOTHING, 3.0, (_NOTHING,)),
    Kind("one effect", 8.0, ("coulomb_friction", "stribeck", "torque_ripple", "transport_delay")),
    Kind("memory", 15.0, ("backlash", "flexible_coupling")),
)
_CHILD = """
import json, os, sys, time
os.sched_setaffinity(0, [min(os.sched_getaffinity(0))])
from pathlib import Path
here, begin = Path(sys.argv[1]), time.perf_counter()
{answer}
print(json.dumps([time.perf_counter() - begin, found["verdict"], list(found["effects"])]))
"""
_WORKFLOW = _CHILD.format(
    answer="""
from hapticd.config import load_config
from hapticd.gap import find_gap
from hapticd.gap.data import load_recording
model = load_config(here / "model.yaml")
found = find_gap([load_recording(here / "run.parquet", model)], model).to_json()
"""
)
_PEER = _CHILD.format(
    answer="""
from benchmarks.gap.sindy import identify
found = identify(here)
"""
)
_ONE_THREAD = dict.fromkeys(("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")


@dataclass(frozen=True)
class Spent:
    """What one answer took."""

    seconds: float
    memory_mb: float
    verdict: str
    effects: list[str]


def spent_on(code: str, here: Path) -> Spent:
    """Answer on one case in a process of its own, on one core.

    Raises:
        BenchmarkError: it failed.
    """
    command = [sys.executable, "-c", code, str(here)]
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as errors:
        process = subprocess.Popen(command, stdout=out, stderr=errors, env={**os.environ, **_ONE_THREAD})
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            errors.seek(0)
            raise BenchmarkError(f"the answer on {here.name} failed: {errors.read().decode()[-500:]}")
        out.seek(0)
        seconds, verdict, effects = json.loads(out.read().decode().splitlines()[-1])
    return Spent(seconds, usage.ru_maxrss / 1024.0, verdict, effects)


def recorded(folder: Path, hidden: str, duration_s: float) -> Path:
    """A recording and its nominal model in a folder of their own."""
    slugs = () if hidden == _NOTHING else (hidden,)
    strengths = (_STRENGTH,) * len(slugs)
    case = Case("single" if slugs else "none", slugs, strengths, _SEED, 0, "re35", "parquet", duration_s)
    here = folder / case.name
    write_files(here, tasks.make(case)[0])
    return here


class Pair(NamedTuple):
    """One recording's cost, and the peer's where there is one."""

    hidden: str
    own: Spent
    peer: Spent | None


def measured(folder: Path, kind: Kind, duration_s: float, *, quick: bool) -> list[Pair]:
    """Every recording of a kind."""
    found = []
    for hidden in kind.hidden[: 1 if quick else None]:
        progress(f"{duration_s:g} s, {hidden}: recording")
        here = recorded(folder, hidden, duration_s)
        own = spent_on(_WORKFLOW, here)
        peer = spent_on(_PEER, here) if importlib.util.find_spec("pysindy") else None
        beside = f"; PySINDy {peer.seconds:.1f} s: {', '.join(peer.effects)}" if peer else ""
        progress(f"  {own.seconds:.1f} s, {own.memory_mb:.0f} MB: {own.verdict} {', '.join(own.effects)}{beside}")
        found.append(Pair(hidden, own, peer))
    return found


def _details(pairs: list[Pair]) -> dict[str, Any]:
    return {
        **{
            pair.hidden: {
                "seconds": pair.own.seconds,
                "memory_MB": pair.own.memory_mb,
                "verdict": pair.own.verdict,
                "effects": pair.own.effects,
                "pysindy_s": pair.peer.seconds if pair.peer else None,
            }
            for pair in pairs
        },
        "load_average": os.getloadavg()[0],
    }


def _slowest(pairs: list[Pair]) -> float:
    return max(pair.own.seconds for pair in pairs)


def measure(quick: bool) -> list[Figure]:
    """Seconds of the slowest recording of each kind, megabytes, and the ratio to the peer."""
    figures: list[Figure] = []
    pairs: list[Pair] = []
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        progress("compiling")
        spent_on(_WORKFLOW, recorded(folder, "flexible_coupling", 5.0))
        for kind in KINDS:
            seconds, goal_s = (_QUICK_S, None) if quick else (_SHORT_S, kind.goal_s)
            short = measured(folder, kind, seconds, quick=quick)
            name = f"{seconds:g} s, {kind.name}, slowest"
            figures.append(Figure(name, _slowest(short), "s", goal_s, details=_details(short)))
            pairs += short
            if quick:
                continue
            long = measured(folder, kind, _LONG_S, quick=quick)
            pairs += long
            figures.append(Figure(f"60 s, {kind.name}, slowest", _slowest(long), "s", details=_details(long)))
            ratio = statistics.median(
                longer.own.seconds / shorter.own.seconds for shorter, longer in zip(short, long, strict=True)
            )
            figures.append(Figure(f"60 s over 20 s, {kind.name}", ratio, "×", LONGER, peer="20 s"))
    figures.append(Figure("peak memory", max(pair.own.memory_mb for pair in pairs), "MB", MEMORY_GOAL_MB))
    if ratios := [pair.own.seconds / pair.peer.seconds for pair in pairs if pair.peer]:
        figures.append(Figure("seconds over the peer's, median", statistics.median(ratios), "×", peer="PySINDy"))
    return figures
