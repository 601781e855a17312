"""A CiA 402 drive on CANopen: Copley by default, other vendors through a profile.

Bring-up uses python-can and canopen (``bring_up.py``); then the exchange runs compiled on the interface's descriptor
(``cyclic.py``), or through python-can if it has none (``callback.py``). docs/how-to/canopen-drive.md
"""

from __future__ import annotations

import contextlib
import logging
import math
import time
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from drivers._python_driver import PythonCalls
from drivers.canopen import _plausible, bus_load, cyclic
from drivers.canopen import layout as w
from drivers.canopen.options import COMPILED_INTERFACES, Options
from drivers.canopen.profile import load_profile
from drivers.interface import PROCESSING_S, Driver, DriverConfigError, DriverError, driver_options

if TYPE_CHECKING:
    import canopen

    from drivers.canopen.bring_up import Drive
    from drivers.canopen.bus import Monitor
    from hapticd.config import Config

log = logging.getLogger(__name__)

_LAST_CALL_S = 0.05


def _parsed(config: Config) -> Options:
    """The options of a config.

    Raises:
        DriverConfigError: an option is wrong, or the one required by ``safety.enable`` is missing.
    """
    options = Options.parse(driver_options(config))
    if config.safety.enable and options.enable_bit is None:
        raise DriverConfigError(
            "safety.enable = true: driver canopen needs driver.enable_bit, 0 to 31: the bit of the drive's digital inputs "
            "(0x60FD) that is 1 while the enable is held; a drive's first input is 16"
        )
    return options


class CanopenDriver(Driver):
    """One drive on a CAN bus.

    Args:
        config: driver options (:class:`drivers.canopen.options.Options`), amplifier and servo rate.

    Raises:
        DriverConfigError: an option, the profile or the servo rate is invalid; nothing is opened.
    """

    summary = "CiA 402 drive on CANopen (Copley and others), on a SocketCAN interface or any of python-can's"
    latency_s = bus_load.wire_time_s() + PROCESSING_S
    enable_input = True
    follows_clock = True
    options = tuple(option.name for option in fields(Options))

    def __init__(self, config: Config) -> None:
        super().__init__(config)
        self._options = _parsed(config)
        self._profile, profile_eds = load_profile(self._options.profile)
        eds = self._options.eds_path or profile_eds
        if eds is None or not eds.is_file():
            named = repr(str(eds)) if eds else "null"
            raise DriverConfigError(
                f"driver.eds = {named}: no such file; driver.profile {self._options.profile!r} needs one"
            )
        self._eds: Path = eds
        if problem := self.check_rate(config.servo.rate_hz):
            raise DriverConfigError(problem)
        self._follows = config.servo.clock == "sync"
        if self._follows and not self._options.compiled:
            raise DriverConfigError(
                f"servo.clock = sync: driver.interface = {self._options.interface!r} runs through Python, which would wake "
                f"the loop late: use one of {', '.join(COMPILED_INTERFACES)}"
            )
        self.latency_s = self._options.declared_latency_s()
        self.calls_python = not self._options.compiled
        self._block = np.zeros(w.WORDS, np.int64)
        self._network: canopen.Network | None = None
        self._monitor: Monitor | None = None
        self._drive: Drive | None = None
        self._calls: PythonCalls | None = None
        self._exception: str | None = None
        self._last_reason: str | None = None

    @classmethod
    def declared_latency_s(cls, config: Config) -> float:
        """The option ``latency_s``, or the time of TPDO, RPDO and processing at the config's bit rate, s."""
        return _parsed(config).declared_latency_s()

    @classmethod
    def declared_step(cls, config: Config) -> float:
        """One step of the target, A: from the given rated values, or the largest that bring-up accepts."""
        return _plausible.declared_step(_parsed(config), config)

    @classmethod
    def max_rate_hz(cls, config: Config) -> float:
        """Highest rate at the config's bit rate, Hz."""
        return _parsed(config).fastest_rate_hz()

    @classmethod
    def max_rate_reason(cls, config: Config) -> str:
        """The bus, and the time of one tick on it."""
        options = _parsed(config)
        wire_us = 1e6 * bus_load.tick_bits(options.back_bytes) / options.bitrate
        return (
            f"classic CAN at {1e-6 * options.bitrate:g} Mbit/s allows {math.floor(options.fastest_rate_hz())} Hz: "
            f"SYNC, command and replies take {wire_us:.0f} µs on the wire"
        )

    def check_rate(self, rate_hz: float) -> str | None:
        """Why the bus, the drive's watchdog or the producer of SYNC does not allow a servo rate in Hz; None if they do."""
        if self.config.servo.clock == "sync" and rate_hz != self.config.servo.rate_hz:
            return "servo.clock = sync: the producer of SYNC sets the rate"
        return self._options.check_rate(rate_hz)

    @property
    def error(self) -> str | None:
        """What stopped the exchange, in words."""
        from drivers.canopen.reasons import explain

        # After close, the memory of the exchange shows only that.
        found = self._last_reason if self._network is None else explain(self._block)
        return found or self._exception

    @error.setter
    def error(self, text: str | None) -> None:
        self._exception = text

    def open(self) -> None:
        """Bring the drive up; it is operational, at zero current and disabled afterwards."""
        import can
        import canopen

        from drivers.canopen.bring_up import bring_up
        from drivers.canopen.bus import Monitor, listen, open_bus, stop_listening

        options = self._options
        where = f"{options.interface} {options.channel}"
        bus = open_bus(options)
        self._network = network = canopen.Network(bus)
        self._monitor = Monitor(options.node_id, follows=self._follows)
        listen(network, self._monitor)
        try:
            drive = bring_up(network, self._monitor, options, self._profile, self._eds, self.config)
            if options.compiled and drive.echoes:
                raise DriverError(
                    f"{where} returns our own frames (receive_own_messages): switch that "
                    "off, because they look like frames of another master"
                )
        except DriverError as error:
            raise type(error)(f"{where}: {self._restarted() or error}") from error
        except (can.CanError, OSError) as error:
            raise DriverError(f"{where}: the interface does not send: {error}") from error
        finally:
            stop_listening(network)
        if restarted := self._restarted():
            raise DriverError(f"{where}: {restarted}")
        self._drive = drive
        self._prepare(drive)
        if options.compiled:
            self._block[w.DESCRIPTOR] = bus.fileno()
            self.read_address, self.write_address = cyclic.read_function.address, cyclic.write_function.address
            self.wait_address = cyclic.wait_function.address if self._follows else 0
        else:
            from drivers.canopen.callback import CallbackExchange

            exchange = CallbackExchange(bus, self._block, echoes=drive.echoes)
            self._calls = PythonCalls(self, exchange.read, exchange.write)
            self._calls.install()
        self.state_address = self._block.ctypes.data

    def _restarted(self) -> str:
        """A sentence if the node sent its boot-up message during bring-up."""
        node = self._options.node_id
        if self._monitor is None or node not in self._monitor.booted:
            return ""
        return f"node {node} booted during bring-up and has lost its settings: check its supply, and start again"

    def _prepare(self, drive: Drive) -> None:
        options, block = self._options, self._block
        block[:] = 0
        block[w.NODE] = options.node_id
        block[w.REPLY_NS] = round(1e9 * (options.reply_timeout_s or 0.0))
        block[w.GUARD_NS] = 1_000_000 * options.guard_ms
        block[w.GUARD_TOGGLE] = -1
        if self._profile.guarding == "heartbeat":
            block[w.GUARD_LOW] = (w.GUARD + self._profile.master_id) | 1 << 32
            block[w.GUARD_DATA] = w.NMT_OPERATIONAL
        else:
            block[w.GUARD_LOW] = w.GUARD + options.node_id | w.REMOTE
            block[w.GUARD_ANSWERED] = 1
        floats = block.view(np.float64)
        floats[w.COMMAND_PER_AMPERE] = drive.command_per_ampere
        floats[w.AMPERE_PER_ACTUAL] = drive.ampere_per_actual
        if drive.ampere_per_demand is not None:
            block[w.READ_BACK] = 1
            floats[w.AMPERE_PER_DEMAND] = drive.ampere_per_demand
        block[w.HELD_MASK] = drive.held_mask
        block[w.FOLLOWS] = self._follows
        block[w.DUE] = self._follows  # the first sample may be the reply to a SYNC of the bring-up
        block[w.MODE] = block[w.MODE_WANTED] = drive.mode_number

    def close(self) -> None:
        """Zero current, power stage off, node pre-operational, watchdog off; the bus is closed in any case."""
        if self._network is None:
            return
        self._last_reason = self.error
        for remark in self.remarks():
            log.warning("%s", remark)
        network, self._network = self._network, None
        from drivers.canopen.bring_up import release
        from drivers.canopen.bus import listen, stop_listening

        options, drive, self._drive = self._options, self._drive, None
        healthy = self._block[w.REASON] == 0
        # For a loop that still runs the bus is now closed: it sends nothing between or after these commands.
        self._block[w.REASON] = w.LOST_CLOSED
        try:
            network.send_message(w.RPDO1 + options.node_id, bytes(w.RPDO1_BYTES))
            network.send_message(w.NMT, bytes([0x80, options.node_id]))
            if drive is not None and self._monitor is not None and healthy:
                listen(network, self._monitor)
                release(drive.objects, self._profile, options)
        except Exception as error:
            if drive is not None:
                log.warning("closing the CAN drive: %s; its watchdog must switch it off", error)
        finally:
            with contextlib.suppress(Exception):
                stop_listening(network)
            # During a present call the descriptor's number must not be reused by another socket.
            time.sleep(min(self.config.period, _LAST_CALL_S))
            if network.bus is not None:
                network.bus.shutdown()

    def remarks(self) -> list[str]:
        """SDO reads by another client, and TPDO 1 without a SYNC."""
        from drivers.canopen.reasons import remarks

        return remarks(self._block)

    def describe(self) -> str:
        """Mode, identity, resolution of the command, and bus load."""
        options = self._options
        load, fastest = options.bus_load(self.config.servo.rate_hz), options.fastest_rate_hz()
        bus = (
            f"{options.interface} {options.channel}, node {options.node_id}, {options.bitrate // 1000} kbit/s, bus load "
            f"{load:.0%} (fastest rate {math.floor(fastest)} Hz)"
        )
        if self._drive is None:
            return f"CANopen drive, profile {self._profile.name}, on {bus}"
        step = 1e3 / self._drive.command_per_ampere
        back = "read back" if self._drive.ampere_per_demand is not None else "not read back"
        return f"CANopen drive, {self._drive.mode}, {step:.3g} mA per step, {back} ({self._drive.identity}), on {bus}"
