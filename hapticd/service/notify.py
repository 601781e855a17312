"""Messages to systemd: readiness, status text, reload, watchdog (sd_notify(3)). Without systemd every call does nothing.

The watchdog is reset only while the servo loop ticks: a daemon whose servo thread hangs is restarted, even if its other
threads run.
"""

from __future__ import annotations

import logging
import os
import socket
import time
from collections.abc import Callable

log = logging.getLogger(__name__)


class Notifier:
    """The connection to the service manager.

    Args:
        address: ``$NOTIFY_SOCKET``: a path, or an abstract name after ``@``; None without a manager.
        watchdog_s: ``$WATCHDOG_USEC`` in s; None without a watchdog.
    """

    def __init__(self, address: str | None, watchdog_s: float | None = None) -> None:
        self._address = f"\0{address[1:]}" if address and address.startswith("@") else address
        self.watchdog_s = watchdog_s if address else None
        self._said: str | None = None
        self._owes_ready = False
        self._socket: socket.socket | None = None
        if self._address is not None:
            # Created once, so that a message needs no new descriptor. A manager that does not listen is no error.
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)
            self._socket.setblocking(False)

    def close(self) -> None:
        """Close the socket; later messages are not sent."""
        if self._socket is not None:
            self._socket.close()

    @classmethod
    def from_environment(cls) -> Notifier:
        """The manager of the environment variables; a watchdog for another process is ignored."""
        microseconds, process = os.environ.get("WATCHDOG_USEC"), os.environ.get("WATCHDOG_PID")
        ours = process is None or process == str(os.getpid())
        watchdog_s = int(microseconds) * 1e-6 if microseconds and microseconds.isdigit() and ours else None
        return cls(os.environ.get("NOTIFY_SOCKET"), watchdog_s)

    def ready(self) -> None:
        """Report that the device is open, the servo loop runs, and the socket answers."""
        self._owes_ready = not self._send("READY=1")

    def reloading(self) -> None:
        """Report the begin of a reload; :meth:`ready` reports its end."""
        self._send(f"RELOADING=1\nMONOTONIC_USEC={time.clock_gettime_ns(time.CLOCK_MONOTONIC) // 1000}")

    def stopping(self) -> None:
        """Report the begin of the shutdown."""
        self._send("STOPPING=1")

    def status(self, text: str) -> None:
        """Send a line for ``systemctl status``, if it has changed. An unsent READY is sent again."""
        if self._owes_ready:
            self.ready()
        if text != self._said and self._send(f"STATUS={text}"):
            self._said = text

    def feed(self) -> None:
        """Reset the watchdog."""
        self._send("WATCHDOG=1")

    def _send(self, message: str) -> bool:
        """Send a message; returns whether the manager received it, True without a manager."""
        if self._socket is None or self._address is None:
            return True
        try:
            self._socket.sendto(message.encode(), self._address)
        except OSError as error:
            log.debug("systemd was not told %r: %s", message, error)
            return False
        return True


class TickWatchdog:
    """Resets the watchdog as long as the servo loop runs.

    Args:
        notifier: the manager.
        ticks: returns the number of ticks of the loop.
    """

    def __init__(self, notifier: Notifier, ticks: Callable[[], int]) -> None:
        self._notifier = notifier
        self._ticks = ticks
        self._seen = -1
        self._fed = -float("inf")

    def look(self, now: float) -> bool:
        """Reset the watchdog if the loop has ticked and a fifth of its time is over; returns whether it was reset."""
        watchdog_s = self._notifier.watchdog_s
        before, self._seen = self._seen, self._ticks()
        if watchdog_s is None or self._seen == before or now - self._fed < watchdog_s / 5:
            return False
        self._fed = now
        self._notifier.feed()
        return True
