"""Options of the serial DAC driver in the config, checked before the port is opened."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from drivers.interface import DriverConfigError, driver_options
from drivers.serial_dac import budget
from hapticd.config.text import shown

if TYPE_CHECKING:
    from hapticd.config import Config

_DAC_BITS = (8, 16)
_BAUD = (1200, 50_000_000)
_WATCHDOG_MS = (1, 65_535)
_LONGEST_LATENCY_S = 1.0


@dataclass(frozen=True)
class Options:
    """Checked options.

    Attributes:
        port: path of the serial device.
        baud: bits per second.
        watchdog_ms: time in ms after which the board switches itself off.
        reply_timeout_s: longest wait for a SAMPLE reply in s; None: four fifths of a period, at least the line's time.
        latency_s: declared sample-to-current latency in s; None: from the transmission time of reply and COMMAND.
    """

    port: str
    baud: int = 921_600
    watchdog_ms: int = 20
    reply_timeout_s: float | None = None
    latency_s: float | None = None

    def declared_latency_s(self, more: int) -> float:
        """Sample-to-current latency in s, with ``more`` bytes in addition to a SAMPLE reply."""
        return budget.default_latency_s(self.baud, more) if self.latency_s is None else self.latency_s


def more_bytes(config: Config) -> int:
    """Bytes of a config's replies in addition to a SAMPLE reply."""
    return budget.INPUTS_BYTES if config.safety.enable else 0


def read_options(config: Config) -> Options:
    """The driver's options in a config; also checks that the config is possible with a serial board.

    Raises:
        DriverConfigError: names the key, the value, the limit and its unit.
    """
    given = driver_options(config)
    port = given.get("port")
    if not (isinstance(port, str) and port):
        said = "is missing" if port is None else f"= {shown(port)}: must be a path"
        raise DriverConfigError(f"driver.port {said}; serial_dac needs the device's path, such as /dev/ttyUSB0")
    baud = _whole(given, "baud", _BAUD, "baud", Options.baud)
    timeout = _seconds(given, "reply_timeout_s", budget.wire_s(budget.SAMPLE_BYTES + budget.REPLY_BYTES, baud), 1.0)
    options = Options(
        port=port,
        baud=baud,
        watchdog_ms=_whole(given, "watchdog_ms", _WATCHDOG_MS, "ms", Options.watchdog_ms),
        reply_timeout_s=timeout,
        latency_s=_seconds(given, "latency_s", 0.0, _LONGEST_LATENCY_S),
    )
    bits = config.amplifier.dac_bits
    if not bits or not _DAC_BITS[0] <= bits <= _DAC_BITS[1]:
        raise DriverConfigError(
            f"amplifier.dac_bits = {shown(bits)}: a serial board has {_DAC_BITS[0]} … {_DAC_BITS[1]} bits"
        )
    rate = config.servo.rate_hz
    if reason := budget.rate_refusal(rate, baud, options.watchdog_ms, timeout, more_bytes(config)):
        raise DriverConfigError(f"servo.rate_hz = {rate:g} Hz: {reason}")
    return options


def _whole(given: dict[str, Any], key: str, limits: tuple[int, int], unit: str, default: int) -> int:
    value = given.get(key, default)
    if isinstance(value, bool) or not isinstance(value, int | float) or not float(value).is_integer():
        raise DriverConfigError(f"driver.{key} = {shown(value)}: must be a whole number of {unit}")
    if not limits[0] <= value <= limits[1]:
        raise DriverConfigError(f"driver.{key} = {shown(value)}: must be from {limits[0]} to {limits[1]} {unit}")
    return int(value)


def _seconds(given: dict[str, Any], key: str, least: float, most: float) -> float | None:
    value = given.get(key)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise DriverConfigError(f"driver.{key} = {shown(value)}: must be a number of seconds")
    if not least <= value <= most:
        raise DriverConfigError(f"driver.{key} = {shown(value)}: must be from {least:.3g} to {most:g} s")
    return float(value)
