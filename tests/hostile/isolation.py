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
from dataclasses import dataclass, field
from pathlib import Path
from typing import TextIO

from tests.hostile.loaders import Loader

CPU_S, WALL_S = 5.0, 60.0
"""Processor time and time that one case may take, s."""
MEMORY, ADDRESSES = 512 << 20, 2 << 30
"""Bytes that one case may touch, and ask for; no input is larger than 256 KiB."""
_LONGEST_MESSAGE = 20_000
_CASE, _ACCEPTED, _REFUSED, _SLOWEST_US, _LARGEST = range(5)


@dataclass
class Report:
    """What came of the cases of one loader: how each ended, and what may not happen, with cases and words."""

    accepted: int = 0
    refused: int = 0
    slowest_ms: float = 0.0
    largest_MiB: float = 0.0
    findings: list[tuple[int, str]] = field(default_factory=list)


def run(loader: Loader, first: int, count: int, seed: int) -> Report:
    """Try cases ``first`` to ``first + count - 1`` of a loader; the same numbers give the same inputs."""
    report = Report()
    told = memoryview(mmap.mmap(-1, 4096)).cast("q")
    begin, end = first, first + count
    with tempfile.TemporaryDirectory(prefix="hapticd-hostile-") as folder:
        while begin < end:
            status, lines = _process(loader, range(begin, end), seed, Path(folder), told)
            report.findings += [tuple(json.loads(line)) for line in lines]
            if status == 0:
                break
            report.findings.append((told[_CASE], f"the process ended with {_ending(status)}"))
            begin = told[_CASE] + 1
    report.accepted, report.refused = told[_ACCEPTED], told[_REFUSED]
    report.slowest_ms, report.largest_MiB = told[_SLOWEST_US] / 1e3, told[_LARGEST] / 2**20
    return report


def _ending(status: int) -> str:
    limits = {signal.SIGPROF: f"more than {CPU_S:g} s of processor time", signal.SIGALRM: f"more than {WALL_S:g} s"}
    number = -status
    return limits.get(signal.Signals(number), signal.Signals(number).name) if number > 0 else f"exit code {status}"


def _process(loader: Loader, cases: range, seed: int, folder: Path, told: memoryview) -> tuple[int, list[str]]:
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
        found = list(lines)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), found


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
        path.write_bytes(loader.case(seed, case))
        finding = _one(loader, path, told)
        if finding is not None:
            print(json.dumps([case, finding]), file=out, flush=True)


def _one(loader: Loader, path: Path, told: memoryview) -> str | None:
    with contextlib.suppress(OSError):  # forget the peak of the case before
        Path("/proc/self/clear_refs").write_text("5")
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
        finding = "".join(traceback.format_exception(error)[-8:])
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.setitimer(signal.ITIMER_REAL, 0)
    told[_SLOWEST_US] = max(told[_SLOWEST_US], int(1e6 * (time.process_time() - began)))
    grown = (_kilobytes("VmHWM") - before) << 10
    told[_LARGEST] = max(told[_LARGEST], grown)
    if grown > MEMORY and finding is None:
        finding = f"{grown >> 20} MiB for {path.stat().st_size} bytes"
    return finding


def _wrong_words(words: str, name: str) -> str | None:
    """What is wrong with an error's text, if anything: it names the file, is not endless, and no terminal obeys it."""
    if Path(name).stem not in words and not words.startswith("driver."):
        return f"an error that does not name its file: {words[:500]}"
    if not all(line.isprintable() for line in words.splitlines()):
        return f"an error with control characters: {words[:500]!a}"
    return f"an endless error: {words[:200]}" if len(words) > _LONGEST_MESSAGE else None


def _kilobytes(name: str) -> int:
    with open("/proc/self/status", encoding="ascii") as status:  # noqa: PTH123 - a path object costs as much as the rest
        return next((int(line.split()[1]) for line in status if line.startswith(f"{name}:")), 0)
