"""Log records in the journal's native protocol: a fault's code and cause are fields that ``journalctl`` can filter.

``journalctl HAPTICD_FAULT=over_speed`` finds every over-speed. Used only when standard error is the journal
(``$JOURNAL_STREAM``, systemd.exec(5)); protocol: systemd.io, "Native Journal Protocol".
"""

from __future__ import annotations

import logging
import os
import socket
import struct
import sys
from functools import partial
from typing import TYPE_CHECKING

from hapticd.service.sink import cut

if TYPE_CHECKING:
    from hapticd.service.sink import Sink

ADDRESS = "/run/systemd/journal/socket"
FIELDS = "journal"
"""Attribute of a log record (``extra={"journal": {...}}``) whose items become fields ``HAPTICD_<KEY>``."""

_PRIORITIES = ((logging.CRITICAL, 2), (logging.ERROR, 3), (logging.WARNING, 4), (logging.INFO, 6))
_DEBUG_PRIORITY = 7


def stderr_is_journal() -> bool:
    """Whether standard error goes to the journal."""
    device, _, inode = os.environ.get("JOURNAL_STREAM", "").partition(":")
    try:
        found = os.fstat(sys.stderr.fileno())
    except (OSError, ValueError):
        return False
    return (device, inode) == (str(found.st_dev), str(found.st_ino))


class JournalHandler(logging.Handler):
    """Sends records to the journal; if that fails, to standard error, which also goes to the journal.

    Args:
        sink: sends them in its thread, so that no other thread waits for the journal.
        address: the journal's datagram socket.
    """

    def __init__(self, sink: Sink, address: str = ADDRESS) -> None:
        super().__init__()
        self._sink, self._address = sink, address
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)
        self._socket.setblocking(False)

    def emit(self, record: logging.LogRecord) -> None:
        """Queue one record."""
        try:
            message = cut(self.format(record))
            self._sink.put(partial(self._send, encode(message, record), message))
        except Exception:
            self.handleError(record)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()
        super().close()

    def _send(self, datagram: bytes, message: str) -> None:
        """In the sink's thread."""
        try:
            self._socket.sendto(datagram, self._address)
        except OSError:
            self._sink.write_now(f"{message}\n")


def encode(message: str, record: logging.LogRecord) -> bytes:
    """One record as a datagram of fields."""
    priority = next((number for level, number in _PRIORITIES if record.levelno >= level), _DEBUG_PRIORITY)
    fields = {
        "MESSAGE": message,
        "PRIORITY": str(priority),
        "SYSLOG_IDENTIFIER": "hapticd",
        "LOGGER": record.name,
        "THREAD": record.threadName or "",
    }
    extra: dict[str, object] = getattr(record, FIELDS, {})
    fields |= {f"HAPTICD_{key.upper()}": str(value) for key, value in extra.items()}
    return b"".join(_field(name, value) for name, value in fields.items())


def _field(name: str, value: str) -> bytes:
    data = value.encode()
    if b"\n" not in data:
        return name.encode() + b"=" + data + b"\n"
    # A value of several lines carries its length, 64 bits little-endian.
    return name.encode() + b"\n" + struct.pack("<Q", len(data)) + data + b"\n"
