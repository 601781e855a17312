"""Drivers written in plain Python: subclass :class:`PythonDriver`, write two methods, register an entry point.

The compiled loop calls Python through ctypes. With a free GIL that takes about a microsecond; with a busy one
up to the 5 ms switch interval. It is intended for the bring-up of a new board; the daemon warns of it at its start.
"""

from __future__ import annotations

import abc
import ctypes
import math
import traceback
from typing import TYPE_CHECKING

import numpy as np

from drivers.interface import (
    ERROR,
    EXCHANGE_WORDS,
    MISSED,
    OK,
    STATUS_ENABLED,
    STATUS_HELD,
    X_COUNTS,
    X_CURRENT,
    X_CURRENT_MEASURED,
    X_ENABLE,
    X_STATUS,
    Driver,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from hapticd.config import Config

_FUNCTION = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_void_p, ctypes.c_void_p)
_WORDS = ctypes.c_int64 * EXCHANGE_WORDS


class PythonCalls:
    """Two Python functions as the two C functions of a driver.

    Args:
        driver: its ``error`` is set to the text of an exception; the loop then raises a fault.
        read, write: take the exchange's words, shape (16,), int64, and return one of the interface's codes.
    """

    def __init__(
        self,
        driver: Driver,
        read: Callable[[NDArray[np.int64]], int],
        write: Callable[[NDArray[np.int64]], int],
    ) -> None:
        def guarded(body: Callable[[NDArray[np.int64]], int]) -> Callable[[int, int], int]:
            def call(_state: int, exchange: int) -> int:
                try:
                    return body(np.frombuffer(memoryview(_WORDS.from_address(exchange)), np.int64))
                except BaseException as exception:
                    driver.error = "".join(traceback.format_exception_only(exception)).strip()
                    return ERROR

            return call

        self._driver = driver
        self._functions = (_FUNCTION(guarded(read)), _FUNCTION(guarded(write)))

    def install(self) -> None:
        """Set the driver's addresses. This object must exist while they are used."""
        read, write = (ctypes.cast(function, ctypes.c_void_p).value for function in self._functions)
        if read is None or write is None:
            raise RuntimeError("ctypes gave no address for a callback")
        self._driver.read_address, self._driver.write_address = read, write


class PythonDriver(Driver):
    """A driver in plain Python. After any exception the loop raises a fault with its text and commands zero."""

    calls_python = True

    def __init__(self, config: Config) -> None:
        super().__init__(config)
        self._enabled = False
        self._calls = PythonCalls(self, self._read, self._write)

    def open(self) -> None:
        """Connect, then set the callbacks' addresses."""
        self.connect()
        self._calls.install()

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
        """The encoder's present counts; None if the device gave no new sample."""

    def enable_held(self) -> bool:
        """Whether the enable input was held at the last sample; called if ``enable_input`` is True."""
        return False

    @abc.abstractmethod
    def write_current(self, current: float, enable: bool) -> None:
        """Command a current in A; ``enable`` False means amplifier off."""

    def _read(self, words: NDArray[np.int64]) -> int:
        counts = self.read_counts()
        words.view(np.float64)[X_CURRENT_MEASURED] = math.nan
        held = STATUS_HELD if self.enable_input and self.enable_held() else 0
        words[X_STATUS] = (STATUS_ENABLED if self._enabled else 0) | held
        if counts is None:
            return MISSED
        words[X_COUNTS] = counts
        return OK

    def _write(self, words: NDArray[np.int64]) -> int:
        enable = bool(words[X_ENABLE])
        self.write_current(float(words.view(np.float64)[X_CURRENT]), enable)
        self._enabled = enable
        return OK
