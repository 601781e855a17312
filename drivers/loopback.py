"""The simulated testbed inside the process: the exact plant behind the same two pointers as any hardware.

In real time the plant is propagated to the instant at which the loop really reads or writes, so a late tick is really
late. In virtual time the instants are the servo's grid, and a run is bit for bit repeatable.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numba import types

from drivers.interface import (
    EXCHANGE_WORDS,
    STATUS_ENABLED,
    X_COUNTS,
    X_CURRENT,
    X_CURRENT_MEASURED,
    X_ENABLE,
    X_STATUS,
    X_TIME_FRAC,
    X_TIME_NS,
    X_TRUE_POSITION,
    X_TRUE_VELOCITY,
    Driver,
)
from hapticd.jit import carray, cfunc
from hapticd.plant import kernel

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from hapticd.config import Config

_SIGNATURE = types.int32(types.CPointer(types.int64), types.CPointer(types.int64))
_WORDS = 8
_ENABLED = 0
_BEGUN = 1
_SIZE = _WORDS + kernel.PLANT_SIZE


@cfunc(_SIGNATURE)
def _read(state: int, exchange: int) -> int:
    words = carray(state, (_SIZE,))
    plant_i = words[_WORDS:]
    plant_f = plant_i.view(np.float64)
    x = carray(exchange, (EXCHANGE_WORDS,))
    x_float = x.view(np.float64)
    if words[_BEGUN] == 0:
        # The plant's life begins with the loop's first look at it, whatever the clock shows by then.
        words[_BEGUN] = 1
        plant_i[kernel.TIME_NS] = x[X_TIME_NS]
        plant_f[kernel.TIME_FRAC] = x_float[X_TIME_FRAC]
    kernel.plant_advance(plant_f, plant_i, x[X_TIME_NS], x_float[X_TIME_FRAC])
    x[X_COUNTS] = kernel.plant_counts(plant_f, plant_i)
    x_float[X_CURRENT_MEASURED] = plant_f[kernel.CURRENT]
    x[X_STATUS] = STATUS_ENABLED if words[_ENABLED] == 1 else 0
    x_float[X_TRUE_POSITION] = plant_f[kernel.POSITION]
    x_float[X_TRUE_VELOCITY] = plant_f[kernel.VELOCITY]
    return 0


@cfunc(_SIGNATURE)
def _write(state: int, exchange: int) -> int:
    words = carray(state, (_SIZE,))
    plant_i = words[_WORDS:]
    plant_f = plant_i.view(np.float64)
    x = carray(exchange, (EXCHANGE_WORDS,))
    x_float = x.view(np.float64)
    words[_ENABLED] = x[X_ENABLE]
    if x[X_ENABLE] == 1:
        kernel.plant_command(plant_f, plant_i, x[X_TIME_NS], x_float[X_TIME_FRAC], x_float[X_CURRENT])
    else:
        kernel.plant_current(plant_f, plant_i, x[X_TIME_NS], x_float[X_TIME_FRAC], 0.0)
    return 0


class LoopbackDriver(Driver):
    """The simulated testbed.

    Args:
        config: plant, hand, amplifier and encoder of the testbed.
        position: true initial position, rad or m. velocity: rad/s or m/s.
        enabled: start with the amplifier on (virtual time only).
        limited: whether the amplifier clips at its peak current.
        latency_s: sample-to-current latency of the device that is stood in for, added to the amplifier's lag.
    """

    options = ()
    summary = "simulated testbed: the exact plant inside the daemon, in real or virtual time"

    def __init__(
        self,
        config: Config,
        *,
        position: float = 0.0,
        velocity: float = 0.0,
        enabled: bool = False,
        limited: bool = True,
        latency_s: float = 0.0,
    ) -> None:
        super().__init__(config)
        self._initial = (position, velocity, enabled, limited)
        self._stood_in_latency_s = latency_s
        self._buffer: NDArray[np.int64] = np.zeros(0, np.int64)

    def open(self) -> None:
        """Put the shaft at its initial state; amplifier off unless asked otherwise."""
        position, velocity, enabled, limited = self._initial
        plant = kernel.init_plant(self.config, position, velocity, current_loop=True)
        plant[kernel.LAG_NS] += self._stood_in_latency_s * 1e9
        if not limited:
            plant[kernel.SATURATION] = np.inf
        self._buffer = np.concatenate([np.zeros(_WORDS, np.int64), plant.view(np.int64)])
        self._buffer[_ENABLED] = enabled
        self.read_address, self.write_address = _read.address, _write.address
        self.state_address = self._buffer.ctypes.data

    def close(self) -> None:
        """Nothing holds the shaft any more: amplifier off, and the current with it."""
        if self._buffer.size:
            self._buffer[_ENABLED] = 0

    @property
    def plant(self) -> NDArray[np.float64]:
        """The plant's buffer (:mod:`hapticd.plant.kernel`), for scripts that push the shaft by hand."""
        return self._buffer[_WORDS:].view(np.float64)

    def true_state(self, ns: int, frac: float = 0.0) -> tuple[float, float]:
        """True position and velocity at an instant not before the last one."""
        kernel.plant_advance(self.plant, self._buffer[_WORDS:], ns, frac)
        return float(self.plant[kernel.POSITION]), float(self.plant[kernel.VELOCITY])

    def stays_at_rest(self) -> bool:
        """Whether the shaft is at rest and stiction holds it under the present current."""
        return bool(kernel.plant_stays(self.plant, self._buffer[_WORDS:]))

    def describe(self) -> str:
        """What is simulated."""
        plant = self.config.plant
        unit, force = ("kg", "N") if self.config.is_linear else ("kg m²", "N m")
        return f"{self.summary} (inertia {plant.inertia:g} {unit}, Coulomb friction {plant.coulomb:g} {force})"
