"""What a daemon lives with as a service: a manager whose watchdog wants to be fed, and somebody who reads its metrics."""

from __future__ import annotations

import socket
import tempfile
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from benchmarks.daemon import MeasuredDaemon
from benchmarks.report import BenchmarkError

SCRAPE_S = 1.0


class Manager:
    """Stands in for systemd, from ``with`` to its end: listens for keep-alives and counts them.

    Args:
        watchdog_s: the watchdog's time, s; the unit's is 5 s.

    Attributes:
        environment: what the daemon must be started with.
        fed: keep-alives so far.
        longest_hunger_s: longest time between two of them.
    """

    def __init__(self, watchdog_s: float = 5.0) -> None:
        self.watchdog_s = watchdog_s
        self.fed = 0
        self.longest_hunger_s = 0.0
        self._last = float("nan")
        self._folder = tempfile.TemporaryDirectory(prefix="hapticd-manager-")
        address = str(Path(self._folder.name) / "notify")
        self.environment = {"NOTIFY_SOCKET": address, "WATCHDOG_USEC": str(round(watchdog_s * 1e6))}
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind(address)
        self._thread = threading.Thread(target=self._listen, name="manager", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as own:
            own.sendto(b"", self.environment["NOTIFY_SOCKET"])
        self._thread.join()
        self._socket.close()
        self._folder.cleanup()

    def _listen(self) -> None:
        while message := self._socket.recv(4096):
            if b"WATCHDOG=1" not in message.splitlines():
                continue
            now = time.monotonic()
            if self.fed:
                self.longest_hunger_s = max(self.longest_hunger_s, now - self._last)
            self.fed, self._last = self.fed + 1, now


class Poller:
    """Asks again and again, from ``with`` to its end.

    Args:
        ask: one request.
        interval_s: from one to the next.

    Attributes:
        answered: requests that were answered.
        failed: the first error; asking ends with it.
    """

    def __init__(self, ask: Callable[[], Any], interval_s: float = SCRAPE_S) -> None:
        self.answered = 0
        self.failed: Exception | None = None
        self._ask, self._interval_s = ask, interval_s
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._poll, name="poller", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._ending.set()
        self._thread.join()

    def _poll(self) -> None:
        while not self._ending.wait(self._interval_s):
            try:
                self._ask()
            except Exception as error:
                self.failed = error
                return
            self.answered += 1


class ServicedDaemon(MeasuredDaemon):
    """A daemon to measure that is also fed, scraped and watched as a service is; see :class:`MeasuredDaemon`."""

    def __init__(self, settings: dict[str, str], busy: bool = False) -> None:
        self.manager = Manager()
        super().__init__(settings, busy, self.manager.environment)
        self.scraper = Poller(self.client.metrics)

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            stack.enter_context(self.manager)
            super().__enter__()
            stack.push(super().__exit__)
            stack.enter_context(self.scraper)
            self._company = stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._company.__exit__(kind, error, trace)

    def require_healthy(self) -> dict[str, Any]:
        """The status, when the loop still renders, every scrape was answered and the watchdog never starved.

        Raises:
            BenchmarkError: one of these is not so.
        """
        status = super().require_healthy()
        if self.scraper.failed:
            raise BenchmarkError(f"a scrape of the metrics was not answered: {self.scraper.failed}")
        if not self.manager.fed or self.manager.longest_hunger_s > self.manager.watchdog_s:
            raise BenchmarkError(
                f"the watchdog would have bitten: fed {self.manager.fed} times, once after "
                f"{self.manager.longest_hunger_s:.1f} s"
            )
        return status
