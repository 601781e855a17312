"""What the live view costs: the servo loop, the processor, and the browser.

Two pages are stood in for by a process that reads their two streams and throws them away, as if the browsers were on
other machines: a browser beside the servo loop would measure the browser. The blocks with pages and those without take
turns on one daemon, each going first in every other pair. What the daemon pays for its stream is the processor time of all
its threads but the servo's, whose ticks take longer beside anything that uses the caches: that stands beside it. Frames per
second, dropped rows and memory are a real page's, in
Debian's headless Chromium, on this machine, without a graphics card.

``python -m benchmarks scope`` measures all; ``python -m benchmarks.scope --minutes M`` instead keeps the page open for so
long and tells its memory.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
import threading
import time
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import psutil

from benchmarks.daemon import MeasuredDaemon, lateness_ns, quantile_us
from benchmarks.report import BenchmarkError, Figure, NotHereError, document, print_table, progress

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

RATES_HZ = (20_000.0, 1_000.0)
PRIORITY = 80
PAGES = 2
WINDOW_S = 10.0
GOALS = {"late": 1.1, "scope": {20_000.0: 5.0, 1_000.0: 1.0}, "daemon": 2.0, "fps": 30.0, "dropped": 0.0}
BOUNDED = 1.05
"""What the median amount of memory may grow from the first third of a soak to the last: a single look, between two
collections of garbage, may find anything."""
WARM_UP = 0.2
"""Share of a soak before the first third: the rings fill, code is compiled."""
LOOKS = 60
BROWSERS = ("chromium-headless-shell", "chromium")


class ScopeProcess:
    """``hapticd scope`` in front of a daemon, from ``with`` to its end."""

    def __init__(self, socket: Path) -> None:
        words = ["scope", "--socket", str(socket), "--port", "0", "--json"]
        self._command = [sys.executable, "-m", "hapticd.cli", *words]

    def __enter__(self) -> Self:
        self.process = subprocess.Popen(self._command, stdout=subprocess.PIPE, text=True)
        assert self.process.stdout is not None
        text = ""
        while not text.rstrip().endswith("}"):
            line = self.process.stdout.readline()
            if not line:
                raise BenchmarkError("hapticd scope did not start")
            text += line
        self.url = str(json.loads(text)["url"])
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.process.terminate()
        self.process.wait(20)
        assert self.process.stdout is not None
        self.process.stdout.close()


class Readers:
    """Pages without a browser, from ``with`` to its end: a process that reads both streams of each."""

    def __init__(self, url: str, pages: int) -> None:
        self._command = [sys.executable, "-m", "benchmarks.scope", "--read", url, str(pages)]

    def __enter__(self) -> Self:
        self._process = subprocess.Popen(self._command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        assert self._process.stdout is not None
        self._process.stdout.readline()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._process.communicate(timeout=20)


def read(url: str, pages: int) -> None:
    """Read as ``pages`` pages until stdin is closed; says ``ready`` when rows have come to each."""
    from websockets.sync.client import connect

    base, token = url.split("#")
    base = base.rstrip("/")
    ready = [threading.Event() for _ in range(pages)]

    def follow(name: str, page: int) -> None:
        with connect(base.replace("http", "ws", 1) + f"/ws/{name}", origin=base, compression=None) as connection:  # type: ignore[arg-type]
            connection.send(json.dumps({"token": token, "client": f"benchmark-{page}"}))
            for message in connection:
                if isinstance(message, bytes):
                    ready[page].set()

    for page in range(pages):
        for name in ("rows", "state"):
            threading.Thread(target=follow, args=(name, page), daemon=True).start()
    for event in ready:
        event.wait(60)
    print("ready", flush=True)
    sys.stdin.read()


def measure(quick: bool) -> list[Figure]:
    """Lateness ratio, processor time, frames per second."""
    figures: list[Figure] = []
    pairs, seconds = (2, 1.0) if quick else (8, 8.0)
    for rate in RATES_HZ:
        settings = {"servo.rate_hz": str(rate), "servo.priority": str(PRIORITY)}
        with MeasuredDaemon(settings) as daemon, ScopeProcess(daemon.socket) as scope:
            figures += _load(daemon, scope, rate, pairs, seconds)
            if rate == RATES_HZ[0]:
                figures += _browser(scope.url, 5.0 if quick else 40.0)
            daemon.require_healthy()
    return figures


def _load(daemon: MeasuredDaemon, scope: ScopeProcess, rate: float, pairs: int, seconds: float) -> list[Figure]:
    late: dict[bool, list[NDArray[np.float64]]] = {True: [], False: []}
    spent: dict[bool, list[NDArray[np.float64]]] = {True: [], False: []}
    scope_spent: list[float] = []
    daemon.record(1)  # the first recording loads its writer
    for pair in range(pairs):
        for watched in (pair % 2 == 0, pair % 2 == 1):
            with ExitStack() as stack:
                if watched:
                    stack.enter_context(Readers(scope.url, PAGES))
                before = _clocks(daemon, scope)
                late[watched].append(lateness_ns(daemon.record(seconds), rate))
                others, servo, scope_s, took = _clocks(daemon, scope) - before
            spent[watched].append(100 * np.array([others, servo]) / took)
            if watched:
                scope_spent.append(100 * scope_s / took)
        text = ", ".join(
            f"{q:g}: {quantile_us(late[True][-1], q):.1f} : {quantile_us(late[False][-1], q):.1f}" for q in (0.5, 0.99)
        )
        progress(f"{rate:g} Hz, pair {pair + 1} of {pairs}, µs late with {PAGES} pages : without, {text}")
    figures = []
    name = f"{rate / 1000:g} kHz"
    for label, q in (("p50", 0.5), ("p99", 0.99)):
        ours, theirs = (quantile_us(np.concatenate(late[watched]), q) for watched in (True, False))
        details = {"watched_us": ours, "alone_us": theirs, "pairs": pairs, "seconds": seconds}
        shown = f"{name}, late {label}: {ours:.1f} µs, without pages {theirs:.1f} µs"
        goal = GOALS["late"] if rate == RATES_HZ[0] else None
        figures.append(Figure(shown, ours / theirs, "×", goal, peer=f"no page, {pairs} pairs", details=details))
    share = float(np.median(scope_spent))
    figures.append(
        Figure(f"{name}, scope with {PAGES} pages", share, "% CPU", GOALS["scope"][rate], details={"all": scope_spent})
    )
    more = np.median(np.array(spent[True]) - np.array(spent[False]), axis=0)
    goal = GOALS["daemon"] if rate == RATES_HZ[0] else None
    details = {"watched": np.array(spent[True]).tolist(), "alone": np.array(spent[False]).tolist()}
    figures += [
        Figure(f"{name}, daemon's stream and state", float(more[0]), "% CPU", goal, peer="no page", details=details),
        Figure(f"{name}, servo thread beside it", float(more[1]), "% CPU", peer="no page"),
    ]
    return figures


def _browser(url: str, seconds: float) -> list[Figure]:
    with _page(url) as page:
        page.select_option("#window", f"{WINDOW_S:g}")
        time.sleep(WINDOW_S + 2)
        begin = _drawn(page), time.monotonic()
        time.sleep(seconds)
        rate = (_drawn(page) - begin[0]) / (time.monotonic() - begin[1])
        lost = int(page.inner_text("#gaps").split()[0])
        rows = int(page.locator("body").get_attribute("data-seen") or 0)
    details = {"window_s": WINDOW_S, "rows_seen": rows, "seconds": seconds}
    shown = f"20 kHz, frames drawn, {WINDOW_S:g} s window of {rows} rows"
    return [
        Figure(shown, rate, "1/s", GOALS["fps"], "≥", details=details),
        Figure("20 kHz, rows lost on the way to the page", float(lost), "rows", GOALS["dropped"]),
    ]


def stay(minutes: float) -> list[Figure]:
    """Keep one page open at 20 kHz and look at what it and the processes hold, so many times in all."""
    settings = {"servo.rate_hz": str(RATES_HZ[0])}
    looks: list[dict[str, float]] = []
    with MeasuredDaemon(settings) as daemon, ScopeProcess(daemon.socket) as scope, _page(scope.url) as page:
        session = page.context.new_cdp_session(page)
        page.select_option("#window", f"{WINDOW_S:g}")
        began = time.monotonic()
        while time.monotonic() - began < 60 * minutes:
            time.sleep(60 * minutes / LOOKS)
            session.send("HeapProfiler.collectGarbage")
            heap = session.send("Runtime.getHeapUsage")
            looks.append(
                {
                    "minute": (time.monotonic() - began) / 60,
                    "heap_MiB": heap["usedSize"] / 2**20,
                    "buffers_MiB": heap.get("backingStorageSize", 0) / 2**20,
                    "daemon_MiB": psutil.Process(daemon.pid).memory_info().rss / 2**20,
                    "scope_MiB": psutil.Process(scope.process.pid).memory_info().rss / 2**20,
                }
            )
            progress(", ".join(f"{name} {value:.1f}" for name, value in looks[-1].items()))
        lost = page.inner_text("#gaps")
    settled = looks[round(WARM_UP * len(looks)) :]
    third = max(1, len(settled) // 3)
    figures = [Figure("rows lost on the way to the page", float(lost.split()[0]), "rows")]
    for name in ("heap_MiB", "buffers_MiB", "daemon_MiB", "scope_MiB"):
        first, last = (float(np.median([look[name] for look in part])) for part in (settled[:third], settled[-third:]))
        figures += [
            Figure(f"{name}, last third of {minutes:g} minutes", last, "MiB", details={"looks": looks}),
            Figure(f"{name}, growth", last / first, "×", BOUNDED, peer="first third"),
        ]
    return figures


@contextmanager
def _page(url: str) -> Iterator[Any]:
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        raise NotHereError("the browser needs Playwright: pip install playwright") from None
    path = next((found for name in BROWSERS if (found := shutil.which(name))), None)
    if path is None:
        raise NotHereError("there is no browser: apt-get install chromium-headless-shell")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1280, "height": 720})
        page.goto(url)
        page.wait_for_timeout(3000)
        yield page
        browser.close()


def _drawn(page: Any) -> int:
    return int(page.locator("body").get_attribute("data-frames") or 0)


def _clocks(daemon: MeasuredDaemon, scope: ScopeProcess) -> NDArray[np.float64]:
    """Processor time of the daemon's threads but the servo's, of that, and of the scope; the time; all in s."""
    servo = daemon.thread_cpu_s("hapticd-servo")
    times = psutil.Process(scope.process.pid).cpu_times()
    return np.array([daemon.cpu_s() - servo, servo, times.user + times.system, time.monotonic()])


def main() -> None:
    """Whether its memory stays."""
    if sys.argv[1:2] == ["--read"]:
        return read(sys.argv[2], int(sys.argv[3]))
    parser = argparse.ArgumentParser(prog="python -m benchmarks.scope")
    parser.add_argument("--minutes", type=float, required=True)
    return print_table([document("scope", stay(parser.parse_args().minutes), quick=False)])


if __name__ == "__main__":
    main()
