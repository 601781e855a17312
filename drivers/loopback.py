"""The simulated testbed inside the process: the exact plant with the same two function pointers as hardware.

In real time the plant is propagated to the instant at which the loop really reads or writes, so a late tick is
late. In virtual time the instants are the servo's grid, and a run is repeatable to the bit.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np
from numba import types

from drivers.interface import (
    EXCHANGE_WORDS,
    STATUS_ENABLED,
    STATUS_HELD,
    X_COUNTS,
    X_CURRENT,
    X_CURRENT_MEASURED,
    X_ENABLE,
    X_INDEX_COUNTS,
    X_INDEX_SEEN,
    X_STATUS,
    X_TIME_FRAC,
    X_TIME_NS,
    X_TRUE_POSITION,
    X_TRUE_VELOCITY,
    Driver,
    DriverConfigError,
    driver_options,
)
from hapticd.jit import carray, cfunc, njit
from hapticd.plant import kernel

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from hapticd.config import Config

_SIGNATURE = types.int32(types.CPointer(types.int64), types.CPointer(types.int64))
_WORDS = 16
_ENABLED = 0
_BEGUN = 1
_WATCHDOG_NS = 2
"""0: none."""
_HEARD_NS = 3
_TRIPPED = 4
_GAIN = 5
"""f64: current in the motor over the one commanded."""
_INDEX_EVERY = 6
"""f64: counts between two index pulses; infinite: there is none."""
_INDEX_AT = 7
_INDEX_SEEN = 8
_COUNTING = 9
_RELEASED = 10
_FIRST_INDEX = 0.7
"""Distance of the first index pulse below the initial position, in turns."""
_SIZE = _WORDS + kernel.PLANT_SIZE


@njit("int64(int64, float64)", inline=True, counted=False)
def _turn(counts: int, every: float) -> int:
    """Number of index pulses below these counts, from the one below 0 on."""
    return int(np.floor(counts / every + _FIRST_INDEX))


@cfunc(_SIGNATURE)
def _read(state: int, exchange: int) -> int:
    words = carray(state, (_SIZE,))
    plant_i = words[_WORDS:]
    plant_f = plant_i.view(np.float64)
    x = carray(exchange, (EXCHANGE_WORDS,))
    x_float = x.view(np.float64)
    if words[_BEGUN] == 0:
        # The plant's time begins with the first read of the loop.
        words[_BEGUN] = 1
        plant_i[kernel.TIME_NS] = x[X_TIME_NS]
        plant_f[kernel.TIME_FRAC] = x_float[X_TIME_FRAC]
        words[_INDEX_AT] = _turn(kernel.plant_counts(plant_f, plant_i), words.view(np.float64)[_INDEX_EVERY])
    silent_ns = words[_HEARD_NS] + words[_WATCHDOG_NS]
    if words[_WATCHDOG_NS] > 0 and words[_ENABLED] == 1 and x[X_TIME_NS] > silent_ns:
        kernel.plant_current(plant_f, plant_i, silent_ns, 0.0, 0.0)
        words[_ENABLED], words[_TRIPPED] = 0, 1
    kernel.plant_advance(plant_f, plant_i, x[X_TIME_NS], x_float[X_TIME_FRAC])
    counts = kernel.plant_counts(plant_f, plant_i)
    turn = _turn(counts, words.view(np.float64)[_INDEX_EVERY])
    if turn != words[_INDEX_AT]:
        place = max(turn, words[_INDEX_AT]) - _FIRST_INDEX
        x[X_INDEX_COUNTS] = int(place * words.view(np.float64)[_INDEX_EVERY])
        words[_INDEX_AT] = turn
        words[_INDEX_SEEN] += 1
    x[X_INDEX_SEEN] = words[_INDEX_SEEN]
    x[X_COUNTS] = counts * words[_COUNTING]
    x_float[X_CURRENT_MEASURED] = plant_f[kernel.CURRENT]
    if words.view(np.float64)[_GAIN] != 0.0:
        # an amplifier measures with its configured rating
        x_float[X_CURRENT_MEASURED] /= words.view(np.float64)[_GAIN]
    x[X_STATUS] = (STATUS_ENABLED if words[_ENABLED] == 1 else 0) | (STATUS_HELD if words[_RELEASED] == 0 else 0)
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
    if x[X_ENABLE] == 0:
        words[_TRIPPED] = 0
    words[_ENABLED] = 1 if x[X_ENABLE] == 1 and words[_TRIPPED] == 0 else 0
    words[_HEARD_NS] = x[X_TIME_NS]
    if words[_ENABLED] == 1:
        current = words.view(np.float64)[_GAIN] * x_float[X_CURRENT]
        kernel.plant_command(plant_f, plant_i, x[X_TIME_NS], x_float[X_TIME_FRAC], current)
    else:
        kernel.plant_current(plant_f, plant_i, x[X_TIME_NS], x_float[X_TIME_FRAC], 0.0)
    return 0


@dataclass(frozen=True)
class Faults:
    """Faults of the testbed's wiring: option ``faults``, for tests of ``hapticd commission``."""

    current_gain: float = 1.0
    """Motor current over command: −1: exchanged leads, 0: an open lead, 10: a wrong rating."""
    counts: bool = True
    """False: a channel of the encoder is dead."""
    index: bool = True
    watchdog: bool = True
    """False: the amplifier's watchdog does not work."""
    enable: bool = True
    """False: the enable input is bridged and always reads as held."""
    latency_s: float = 0.0
    """In addition to that of the amplifier's model."""


class LoopbackDriver(Driver):
    """The simulated testbed.

    Options: ``device``, a config file with plant, hand, amplifier and encoder of the testbed, instead of those of the
    config; ``watchdog_ms``, after which its amplifier switches itself off (default: it has none); ``faults``
    (:class:`Faults`).

    Args:
        config: plant, hand, amplifier and encoder of the testbed.
        position: true initial position, rad or m. velocity: rad/s or m/s.
        enabled: start with the amplifier on (virtual time only).
        limited: whether the amplifier clips at its peak current.
        latency_s: sample-to-current latency of the simulated device, added to the amplifier's lag.
    """

    options = ("device", "watchdog_ms", "faults")
    reports_index = True
    enable_input = True
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
        options = driver_options(config)
        self.device = _device(config, options.get("device"))
        """Config of the simulated plant, hand, amplifier and encoder."""
        self._faults = _faults(options.get("faults", {}))
        self._watchdog_ms = _finite("watchdog_ms", options.get("watchdog_ms", 0))
        self._initial = (position, velocity, enabled, limited)
        self._stood_in_latency_s = latency_s
        self._buffer: NDArray[np.int64] = np.zeros(0, np.int64)

    def open(self) -> None:
        """Set the shaft to its initial state, with the amplifier off unless `enabled`."""
        position, velocity, enabled, limited = self._initial
        plant = kernel.init_plant(self.device, position, velocity, current_loop=True)
        faults, encoder = self._faults, self.device.encoder
        plant[kernel.LAG_NS] += (self._stood_in_latency_s + faults.latency_s) * 1e9
        if not limited:
            plant[kernel.SATURATION] = np.inf
        self._buffer = np.concatenate([np.zeros(_WORDS, np.int64), plant.view(np.int64)])
        self._buffer[_ENABLED] = enabled
        self._buffer[_WATCHDOG_NS] = round(1e6 * self._watchdog_ms) if faults.watchdog else 0
        self._buffer[_COUNTING] = int(faults.counts)
        floats = self._buffer.view(np.float64)
        floats[_GAIN] = faults.current_gain
        floats[_INDEX_EVERY] = (encoder.counts_per_rev or math.inf) if faults.index else math.inf
        self.read_address, self.write_address = _read.address, _write.address
        self.state_address = self._buffer.ctypes.data

    def close(self) -> None:
        """Switch the amplifier off, with zero current."""
        if self._buffer.size:
            self._buffer[_ENABLED] = 0

    @property
    def held(self) -> bool:
        """The simulated enable input: held from :meth:`open` on, until this is set to False."""
        return bool(self._buffer[_RELEASED] == 0)

    @held.setter
    def held(self, held: bool) -> None:
        self._buffer[_RELEASED] = self._faults.enable and not held

    @property
    def plant(self) -> NDArray[np.float64]:
        """The plant's buffer (:mod:`hapticd.plant.kernel`), for scripts that apply a hand's force."""
        return self._buffer[_WORDS:].view(np.float64)

    def true_state(self, ns: int, frac: float = 0.0) -> tuple[float, float]:
        """True position and velocity at an instant, which is not before the last one."""
        kernel.plant_advance(self.plant, self._buffer[_WORDS:], ns, frac)
        return float(self.plant[kernel.POSITION]), float(self.plant[kernel.VELOCITY])

    def stays_at_rest(self) -> bool:
        """Whether the shaft is at rest and stiction holds it under the present current."""
        return bool(kernel.plant_stays(self.plant, self._buffer[_WORDS:]))

    def describe(self) -> str:
        """What is simulated."""
        plant = self.device.plant
        unit, force = ("kg", "N") if self.device.is_linear else ("kg m²", "N m")
        return f"{self.summary} (inertia {plant.inertia:g} {unit}, Coulomb friction {plant.coulomb:g} {force})"


def _device(config: Config, path: object) -> Config:
    from hapticd.config import ConfigError, load_config

    if path is None:
        return config
    try:
        device = load_config(str(path))
    except (ConfigError, OSError) as error:
        raise DriverConfigError(f"driver.device = {path!r}: {error}") from error
    if device.is_linear != config.is_linear:
        raise DriverConfigError(f"driver.device = {path!r}: one of the two devices is linear, the other rotary")
    return device


def _faults(given: Any) -> Faults:
    if not isinstance(given, Mapping):
        raise DriverConfigError(f"driver.faults = {given!r}: must be a mapping, such as {{current_gain: -1}}")
    known = {field.name: field.default for field in fields(Faults)}
    for key, value in given.items():
        if key not in known:
            raise DriverConfigError(f"driver.faults.{key}: unknown; it has: {', '.join(known)}")
        if isinstance(known[key], bool) != isinstance(value, bool):
            kind = "true or false" if isinstance(known[key], bool) else "a number"
            raise DriverConfigError(f"driver.faults.{key} = {value!r}: must be {kind}")
        if not isinstance(value, bool):
            _finite(f"faults.{key}", value, -1000.0)
    return Faults(**given)


def _finite(key: str, value: object, least: float = 0.0) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not least <= value <= 60_000.0:
        raise DriverConfigError(f"driver.{key} = {value!r}: must be a number from {least:g} to 60000")
    return float(value)
