"""Runs cases in processes of their own, each case within bounded processor time, time and memory.

A case that ends its process (a signal of the kernel, or of a limit) is a finding like an exception that nobody foresaw,
and the next process goes on behind it.
"""

from __future__ import annotations

import contextlib
import gc
import json
import logging
import mmap
import os
import resource
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TextIO

from benchmarks.hostile.loaders import Loader

CPU_S = 5.0
"""Processor time that one case may take, s."""
WALL_S = 60.0
MEMORY = 512 << 20
"""Bytes that one case may touch; no input is larger than 256 KiB."""
ADDRESSES = 2 << 30
"""Bytes of address space that it may ask for."""
_LONGEST_MESSAGE = 20_000
_CASE, _ACCEPTED, _REFUSED, _SLOWEST_US, _LARGEST = range(5)


@dataclass
class Report:
    """What came of the cases of one loader.

    Attributes:
        loader: its name. inputs: how many were tried. accepted, refused: how each ended, a result or a clear error.
        slowest_ms: of processor time. largest_MiB: memory touched. findings: what may not happen, each with its first case.
    """

    loader: str
    inputs: int = 0
    accepted: int = 0
    refused: int = 0
    slowest_ms: float = 0.0
    largest_MiB: float = 0.0
    findings: dict[str, Finding] = field(default_factory=dict)


@dataclass
class Finding:
    """Something that may not happen: the first case that shows it, how many do, and the words of the first."""

    case: int
    count: int
    words: str


def run(
    loader: Loader, first: int, count: int, seed: int, advance: Callable[[int], None] = lambda done: None
) -> Report:
    """Try cases ``first`` to ``first + count - 1`` of a loader.

    Args:
        loader: what reads them. first, count, seed: which cases; the same numbers give the same inputs.
        advance: called with the number of cases done.
    """
    report = Report(loader.name)
    shared = mmap.mmap(-1, 4096)
    told = memoryview(shared).cast("q")
    begin, end = first, first + count
    with tempfile.TemporaryDirectory(prefix="hapticd-hostile-") as folder:
        while begin < end:
            status, lines = _process(loader, range(begin, end), seed, Path(folder), told, advance)
            for line in lines:
                _note(report, **json.loads(line))
            if status == 0:
                break
            words = f"the process ended with {_ending(status)}"
            _note(report, case=int(told[_CASE]), what=words, words=words)
            begin = int(told[_CASE]) + 1
    report.inputs = count
    report.accepted, report.refused = int(told[_ACCEPTED]), int(told[_REFUSED])
    report.slowest_ms, report.largest_MiB = told[_SLOWEST_US] / 1e3, told[_LARGEST] / 2**20
    return report


def document(report: Report) -> dict[str, object]:
    """The report as JSON has it."""
    return asdict(report)


def _note(report: Report, case: int, what: str, words: str) -> None:
    found = report.findings.setdefault(what, Finding(case, 0, words))
    found.count += 1


def _ending(status: int) -> str:
    number = -status
    limits = {signal.SIGPROF: f"more than {CPU_S:g} s of processor time", signal.SIGALRM: f"more than {WALL_S:g} s"}
    return limits.get(signal.Signals(number), signal.Signals(number).name) if number > 0 else f"exit code {status}"


def _process(
    loader: Loader, cases: range, seed: int, folder: Path, told: memoryview, advance: Callable[[int], None]
) -> tuple[int, list[str]]:
    """Fork a process for the cases; its exit code (negative: a signal) and the findings that it wrote."""
    reader, writer = os.pipe()
    sys.stdout.flush()
    child = os.fork()
    if child == 0:
        code = 1
        try:
            os.close(reader)
            with os.fdopen(writer, "w") as out:
                _work(loader, cases, seed, folder, told, out)
            code = 0
        except BaseException:
            traceback.print_exc()
        finally:
            os._exit(code)
    os.close(writer)
    with os.fdopen(reader) as lines:
        found = []
        while line := lines.readline():
            if line.startswith("{"):
                found.append(line)
            advance(int(told[_CASE]) - cases.start)
    _, status = os.waitpid(child, 0)
    return os.waitstatus_to_exitcode(status), found


def _work(loader: Loader, cases: range, seed: int, folder: Path, told: memoryview, out: TextIO) -> None:
    used = _kilobytes("VmSize") << 10
    resource.setrlimit(resource.RLIMIT_AS, (used + ADDRESSES, used + ADDRESSES))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    warnings.simplefilter("error")
    logging.disable()
    gc.freeze()
    path = folder / f"case{loader.suffix}"
    for case in cases:
        told[_CASE] = case
        if case % 1000 == 0:
            print(file=out, flush=True)
        path.write_bytes(loader.case(seed, case))
        finding = _one(loader, path, told)
        if finding is not None:
            print(json.dumps({"case": case, **finding}), file=out, flush=True)


def _one(loader: Loader, path: Path, told: memoryview) -> dict[str, str] | None:
    _forget_peak()
    before, began = _kilobytes("VmRSS"), time.process_time()
    signal.setitimer(signal.ITIMER_REAL, WALL_S)
    signal.setitimer(signal.ITIMER_PROF, CPU_S)
    finding = None
    try:
        loader.load(path)
        told[_ACCEPTED] += 1
    except loader.errors as error:
        told[_REFUSED] += 1
        finding = _wrong_words(str(error), path.name)
    except BaseException as error:
        place = traceback.extract_tb(error.__traceback__)[-1]
        what = f"{type(error).__module__}.{type(error).__name__} at {Path(place.filename).name}:{place.lineno}"
        finding = {
            "what": what,
            "words": f"{error}"[:500] + "\n" + "".join(traceback.format_tb(error.__traceback__)[-6:]),
        }
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.setitimer(signal.ITIMER_REAL, 0)
    told[_SLOWEST_US] = max(told[_SLOWEST_US], int(1e6 * (time.process_time() - began)))
    grown = (_kilobytes("VmHWM") - before) << 10
    told[_LARGEST] = max(told[_LARGEST], grown)
    if grown > MEMORY and finding is None:
        finding = {"what": "too much memory", "words": f"{grown >> 20} MiB for {path.stat().st_size} bytes"}
    return finding


def _wrong_words(words: str, name: str) -> dict[str, str] | None:
    """What is wrong with an error's text, if anything: it names the file, is not endless, and no terminal obeys it."""
    lines = words.splitlines()
    if Path(name).stem not in words and not words.startswith("driver."):
        return {"what": "an error that does not name its file", "words": words[:500]}
    if not all(line.isprintable() for line in lines):
        return {"what": "an error with control characters", "words": ascii(words[:500])}
    if len(words) > _LONGEST_MESSAGE:
        return {"what": "an endless error", "words": f"{len(words)} characters: {words[:200]}"}
    return None


def _forget_peak() -> None:
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")


def _kilobytes(name: str) -> int:
    with open("/proc/self/status", encoding="ascii") as status:  # noqa: PTH123 - a path object costs as much as the rest
        return next((int(line.split()[1]) for line in status if line.startswith(f"{name}:")), 0)


def total(reports: Sequence[Report]) -> int:
    """Findings of all kinds."""
    return sum(len(report.findings) for report in reports)
