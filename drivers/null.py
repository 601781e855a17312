"""A driver without a device: a shaft at rest, an amplifier always on. For the loop's warm-up and its cost per tick."""

from __future__ import annotations

import numpy as np
from numba import types

from drivers.interface import EXCHANGE_WORDS, STATUS_ENABLED, X_COUNTS, X_CURRENT_MEASURED, X_STATUS, Driver
from hapticd.jit import carray, cfunc

_SIGNATURE = types.int32(types.CPointer(types.int64), types.CPointer(types.int64))


@cfunc(_SIGNATURE)
def _read(state: int, exchange: int) -> int:
    words = carray(exchange, (EXCHANGE_WORDS,))
    words[X_COUNTS] = 0
    words.view(np.float64)[X_CURRENT_MEASURED] = np.nan
    words[X_STATUS] = STATUS_ENABLED
    return 0


@cfunc(_SIGNATURE)
def _write(state: int, exchange: int) -> int:
    return 0


class NullDriver(Driver):
    """A shaft at rest and an amplifier that is always on."""

    options = ()
    summary = "no device: a shaft at rest and an amplifier that is always on"

    def open(self) -> None:
        """Set the addresses; there is nothing to connect."""
        self.read_address, self.write_address = _read.address, _write.address

    def close(self) -> None:
        """Nothing to release."""
