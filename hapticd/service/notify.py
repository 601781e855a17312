"""Talking to systemd: readiness, status text, reload, watchdog (sd_notify(3)). Without systemd every call does nothing.

The watchdog is fed from the ticks of the servo loop, not from the clock of whoever feeds it: a daemon whose servo thread
hangs goes hungry however lively the rest of it is.
"""

from __future__ import annotations

import logging
import os
import socket
import time
from collections.abc import Callable

log = logging.getLogger(__name__)


class Notifier:
    """The connection to the service manager that started us.

    Args:
        address: ``$NOTIFY_SOCKET``: a path, or an abstract name after ``@``; None when there is no manager.
        watchdog_s: ``$WATCHDOG_USEC`` in s; None when no watchdog waits for us.
    """

    def __init__(self, address: str | None, watchdog_s: float | None = None) -> None:
        self._address = f"\0{address[1:]}" if address and address.startswith("@") else address
        self.watchdog_s = watchdog_s if address else None
        self._said: str | None = None
        self._owes_ready = False
        self._socket: socket.socket | None = None
        if self._address is not None:
            # Made once: a message needs no descriptor. A manager that does not listen must not stop us.
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)
            self._socket.setblocking(False)

    def close(self) -> None:
        """Close the socket; what is said afterwards is not sent."""
        if self._socket is not None:
            self._socket.close()

    @classmethod
    def from_environment(cls) -> Notifier:
        """The manager that the environment names; a watchdog meant for another process is not ours."""
        microseconds, process = os.environ.get("WATCHDOG_USEC"), os.environ.get("WATCHDOG_PID")
        ours = process is None or process == str(os.getpid())
        watchdog_s = int(microseconds) * 1e-6 if microseconds and microseconds.isdigit() and ours else None
        return cls(os.environ.get("NOTIFY_SOCKET"), watchdog_s)

    def ready(self) -> None:
        """The device is open, the servo loop ticks, the socket answers."""
        self._owes_ready = not self._send("READY=1")

    def reloading(self) -> None:
        """A reload has begun; :meth:`ready` ends it."""
        self._send(f"RELOADING=1\nMONOTONIC_USEC={time.clock_gettime_ns(time.CLOCK_MONOTONIC) // 1000}")

    def stopping(self) -> None:
        """The end has begun."""
        self._send("STOPPING=1")

    def status(self, text: str) -> None:
        """One line for ``systemctl status``; the same one twice is sent once. A READY that was not taken is sent again."""
        if self._owes_ready:
            self.ready()
        if text != self._said and self._send(f"STATUS={text}"):
            self._said = text

    def feed(self) -> None:
        """Tell the watchdog that we live."""
        self._send("WATCHDOG=1")

    def _send(self, message: str) -> bool:
        """Whether the manager took it; without a manager there is nobody to be told again."""
        if self._socket is None or self._address is None:
            return True
        try:
            self._socket.sendto(message.encode(), self._address)
        except OSError as error:
            log.debug("systemd was not told %r: %s", message, error)
            return False
        return True


class TickWatchdog:
    """Feeds the watchdog for as long as the servo loop ticks.

    Args:
        notifier: the manager.
        ticks: how many ticks the loop has done.
    """

    def __init__(self, notifier: Notifier, ticks: Callable[[], int]) -> None:
        self._notifier = notifier
        self._ticks = ticks
        self._seen = -1
        self._fed = -float("inf")

    def look(self, now: float) -> bool:
        """Feed when the loop has ticked since the last look and a fifth of the watchdog's time is over; whether it fed."""
        watchdog_s = self._notifier.watchdog_s
        before, self._seen = self._seen, self._ticks()
        if watchdog_s is None or self._seen == before or now - self._fed < watchdog_s / 5:
            return False
        self._fed = now
        self._notifier.feed()
        return True
