"""The driver's options in the config."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from drivers.canopen import bus_load
from drivers.interface import PROCESSING_S, DriverConfigError

COMPILED_INTERFACES: Final = ("socketcan", "unix_seqpacket")
"""python-can interfaces with a descriptor for ``struct can_frame``; all others run through Python."""
WIRELESS_INTERFACES: Final = ("unix_seqpacket", "udp_multicast", "virtual")
"""Interfaces between processes, without transmission time."""
_WIRELESS_CHANNELS: Final = ("vcan", "vxcan")
"""Name prefixes of Linux's virtual CAN interfaces."""
_WATCHDOG_MS: Final = (bus_load.GUARDS_PER_WATCHDOG, 60_000)
_REPLY_PART: Final = 0.8


@dataclass(frozen=True)
class Options:
    """Options of the CANopen driver, checked."""

    interface: str = "socketcan"
    """python-can interface: socketcan, unix_seqpacket (compiled path); udp_multicast, virtual, slcan, … (through Python)."""
    channel: str = "can0"
    bitrate: int = bus_load.DEFAULT_BITRATE
    """bit/s, one of CiA 301's."""
    node_id: int = 1
    profile: str = "copley"
    """``copley``, ``cia402`` or the path of a YAML file."""
    eds: str | None = None
    """Path of an EDS file; None: that of the profile."""
    watchdog_ms: int = bus_load.DEFAULT_WATCHDOG_MS
    reply_timeout_s: float | None = None
    """Longest time of TPDO 1 after SYNC, s; None: four fifths of a servo period."""
    latency_s: float | None = None
    """Declared sample-to-current latency, s; None: transmission and processing times."""
    read_back: bool = True
    """Read the drive's demand and mode back on every SYNC (TPDO 2), if the profile names them and the drive has them."""
    enable_bit: int | None = None
    """Bit of the drive's digital inputs (0x60FD) that is 1 while the enable is held; ``safety.enable`` needs it."""
    rated_current: float | None = None
    """Rated current of the motor in A (1000 ‰), if the drive has it in another unit or not at all."""
    rated_torque: float | None = None
    """Rated torque of the motor, N m (or N), likewise."""
    bus: dict[str, Any] = field(default_factory=dict)
    """Further arguments for the python-can interface, such as ``port`` of udp_multicast."""

    @classmethod
    def parse(cls, options: Mapping[str, Any]) -> Options:
        """Check the options of a config.

        Raises:
            DriverConfigError: naming the key, the value and what is allowed.
        """
        given = {key: value for key, value in options.items() if value is not None}
        for key in ("interface", "channel", "profile", "eds"):
            if key in given and not (isinstance(given[key], str) and given[key]):
                raise _wrong(key, given[key], "must be text")
        if given.get("interface", cls.interface) != "socketcan" and "channel" not in given:
            raise DriverConfigError(f"driver.channel is missing: name the channel of {given['interface']}")
        if not isinstance(given.get("read_back", True), bool):
            raise _wrong("read_back", given["read_back"], "must be true or false")
        if not isinstance(given.get("bus", {}), dict):
            raise _wrong("bus", given["bus"], "must be a mapping of arguments for the python-can interface")
        _whole(given, "node_id", 1, 127, "")
        _whole(given, "enable_bit", 0, 31, "")
        _whole(given, "watchdog_ms", *_WATCHDOG_MS, " ms")
        _whole(given, "bitrate", bus_load.BITRATES[0], bus_load.BITRATES[-1], " bit/s")
        if given.get("bitrate", cls.bitrate) not in bus_load.BITRATES:
            rates = ", ".join(str(rate) for rate in bus_load.BITRATES)
            raise _wrong("bitrate", given["bitrate"], f"must be one of CiA 301's: {rates} bit/s")
        for key in ("reply_timeout_s", "latency_s"):
            value = given.get(key, 0.0)
            if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 <= value <= 1.0:
                raise _wrong(key, value, "must be a time from 0 to 1 s")
            if key in given:
                given[key] = float(value)
        for key, unit in (("rated_current", "A"), ("rated_torque", "N m or N")):
            value = given.get(key, 1.0)
            if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 < value < math.inf:
                raise _wrong(key, value, f"must be above 0 {unit}")
        if given.get("reply_timeout_s") == 0.0:
            raise _wrong("reply_timeout_s", 0, "must be above 0 s")
        return cls(**given)

    @property
    def compiled(self) -> bool:
        """Whether the exchange runs compiled on the interface's descriptor."""
        return self.interface in COMPILED_INTERFACES

    @property
    def wireless(self) -> bool:
        """Whether there is no transmission time: an interface between processes, or a virtual one of the kernel."""
        virtual = self.interface == "socketcan" and self.channel.startswith(_WIRELESS_CHANNELS)
        return virtual or self.interface in WIRELESS_INTERFACES

    @property
    def guard_ms(self) -> int:
        """Guard time (0x100C) in ms: a quarter of the watchdog's time, rounded down."""
        return self.watchdog_ms // bus_load.GUARDS_PER_WATCHDOG

    @property
    def back_bytes(self) -> int:
        """Largest number of bytes of TPDO 2; 0: there is none."""
        inputs = bus_load.INPUTS_BYTES if self.enable_bit is not None else 0
        return inputs + (bus_load.READ_BACK_BYTES if self.read_back else 0)

    @property
    def eds_path(self) -> Path | None:
        """The EDS in the config."""
        return None if self.eds is None else Path(os.path.expanduser(self.eds))  # noqa: PTH111 - raises for no user

    def bus_load(self, rate_hz: float) -> float:
        """Bus load at a servo rate in Hz."""
        return bus_load.bus_load(rate_hz, self.bitrate, self.watchdog_ms, self.back_bytes)

    def fastest_rate_hz(self) -> float:
        """Highest servo rate in Hz that the bit rate allows."""
        return bus_load.fastest_rate_hz(self.bitrate, self.watchdog_ms, self.back_bytes)

    def check_rate(self, rate_hz: float) -> str | None:
        """Why a servo rate in Hz is not possible (bus too slow, drive's watchdog too short); None if it is."""
        fastest = self.fastest_rate_hz()
        if rate_hz > fastest:
            without = bus_load.fastest_rate_hz(
                self.bitrate, self.watchdog_ms, self.back_bytes - bus_load.READ_BACK_BYTES
            )
            more = f" (driver.read_back: false: {math.floor(without)} Hz)" if self.read_back else ""
            return (
                f"servo.rate_hz = {rate_hz:g} Hz: SYNC, TPDO and RPDO would fill {self.bus_load(rate_hz):.0%} of the bus at "
                f"driver.bitrate = {self.bitrate} bit/s; the loop may fill {bus_load.USABLE:.0%}, which allows "
                f"{math.floor(fastest)} Hz{more}"
            )
        slowest = 1e3 / self.guard_ms
        if rate_hz < slowest:
            needed = bus_load.GUARDS_PER_WATCHDOG * math.ceil(1e3 / rate_hz)
            return (
                f"servo.rate_hz = {rate_hz:g} Hz: the loop must send a guarding message every {self.guard_ms} ms "
                f"(a quarter of driver.watchdog_ms = {self.watchdog_ms}), and one period is {1e3 / rate_hz:g} ms; set "
                f"driver.watchdog_ms to {needed} or more, or servo.rate_hz to {slowest:g} Hz or more"
            )
        longest = _REPLY_PART / rate_hz
        if self.reply_timeout_s is not None and self.reply_timeout_s > longest:
            return (
                f"driver.reply_timeout_s = {self.reply_timeout_s:g} s is more than {_REPLY_PART:.0%} of the servo period "
                f"({longest:g} s at servo.rate_hz = {rate_hz:g} Hz): the command must still go out in the same period"
            )
        return None

    def declared_latency_s(self) -> float:
        """Sample-to-current latency in s: as declared, or transmission of TPDO 1 and RPDO 1, if any, plus processing.

        A sample that needs the inputs waits for TPDO 2 as well.
        """
        if self.latency_s is not None:
            return self.latency_s
        wire_s = bus_load.wire_time_s(self.bitrate)
        if self.enable_bit is not None:
            wire_s += bus_load.frame_bits(self.back_bytes) / self.bitrate
        return PROCESSING_S + (0.0 if self.wireless else wire_s)


def _wrong(key: str, value: object, rule: str) -> DriverConfigError:
    return DriverConfigError(f"driver.{key} = {value!r}: {rule}")


def _whole(given: Mapping[str, Any], key: str, low: int, high: int, unit: str) -> None:
    value = given.get(key, low)
    if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
        raise _wrong(key, value, f"must be a whole number from {low} to {high}{unit}")
