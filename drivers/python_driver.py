"""Drivers written in plain Python: subclass :class:`PythonDriver`, write two methods, register an entry point.

The compiled loop calls back into Python through ctypes. With a free GIL that costs about a microsecond; with a busy one
up to the 5 ms switch interval. It is meant for the bring-up of a new board, and the daemon says so when it starts.
"""

from __future__ import annotations

import abc
import ctypes
import math
import traceback
from typing import TYPE_CHECKING

from drivers.interface import (
    ERROR,
    EXCHANGE_WORDS,
    MISSED,
    OK,
    STATUS_ENABLED,
    X_COUNTS,
    X_CURRENT,
    X_CURRENT_MEASURED,
    X_ENABLE,
    X_STATUS,
    Driver,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from hapticd.config import Config

_FUNCTION = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_void_p, ctypes.c_void_p)
_WORDS = ctypes.c_int64 * EXCHANGE_WORDS
_FLOATS = ctypes.c_double * EXCHANGE_WORDS


class PythonDriver(Driver):
    """A driver in plain Python. Raise anything: the loop faults with the exception's text and commands zero."""

    calls_python = True

    def __init__(self, config: Config) -> None:
        super().__init__(config)
        self._enabled = False
        self._callbacks = (_FUNCTION(self._read), _FUNCTION(self._write))

    def open(self) -> None:
        """Connect, then hand out the callbacks' addresses."""
        self.connect()
        read, write = (ctypes.cast(callback, ctypes.c_void_p).value for callback in self._callbacks)
        if read is None or write is None:
            raise RuntimeError("ctypes gave no address for a callback")
        self.read_address, self.write_address = read, write

    def close(self) -> None:
        """Disconnect."""
        self.disconnect()

    @abc.abstractmethod
    def connect(self) -> None:
        """Open the device at zero current, disabled."""

    @abc.abstractmethod
    def disconnect(self) -> None:
        """Close the device; it must end at zero current, disabled."""

    @abc.abstractmethod
    def read_counts(self) -> int | None:
        """The encoder's counts now, or None when the device gave no fresh sample."""

    @abc.abstractmethod
    def write_current(self, current: float, enable: bool) -> None:
        """Command a current in A; ``enable`` False means amplifier off."""

    def _guarded(self, body: Callable[[], int]) -> int:
        try:
            return body()
        except BaseException as exception:
            self.error = "".join(traceback.format_exception_only(exception)).strip()
            return ERROR

    def _read(self, _state: int, exchange: int) -> int:
        def body() -> int:
            counts = self.read_counts()
            words, floats = _WORDS.from_address(exchange), _FLOATS.from_address(exchange)
            floats[X_CURRENT_MEASURED] = math.nan
            words[X_STATUS] = STATUS_ENABLED if self._enabled else 0
            if counts is None:
                return MISSED
            words[X_COUNTS] = counts
            return OK

        return self._guarded(body)

    def _write(self, _state: int, exchange: int) -> int:
        def body() -> int:
            enable = bool(_WORDS.from_address(exchange)[X_ENABLE])
            self.write_current(float(_FLOATS.from_address(exchange)[X_CURRENT]), enable)
            self._enabled = enable
            return OK

        return self._guarded(body)
