"""The driver object: opens the port, begins a session with the board, and sets the compiled exchange for the servo loop."""

from __future__ import annotations

import contextlib
import time
from dataclasses import fields
from typing import TYPE_CHECKING

import numpy as np

from drivers.interface import Driver, DriverError
from drivers.serial_dac import budget, exchange, port, state
from drivers.serial_dac.options import Options, more_bytes, read_options
from drivers.serial_dac.session import Session

if TYPE_CHECKING:
    import serial
    from numpy.typing import NDArray

    from drivers.serial_dac.messages import Capabilities, SampleReply
    from hapticd.config import Config

_OFF_COMMANDS = 2
_LAST_BYTES_S = 0.05


class SerialDacDriver(Driver):
    """A board with DAC and encoder counter on a serial port (``docs/protocols/serial-dac.md``).

    Raises:
        DriverConfigError: an option is unknown, out of range, or too slow for the servo rate.
    """

    summary = "serial DAC board: one sample and one command frame per tick (docs/protocols/serial-dac.md)"
    latency_s = budget.default_latency_s(921_600)
    enable_input = True
    options = tuple(option.name for option in fields(Options))

    def __init__(self, config: Config) -> None:
        super().__init__(config)
        self._options = read_options(config)
        self.latency_s = self._options.declared_latency_s(more_bytes(config))
        self._port: serial.Serial | None = None
        self._session: Session | None = None
        self._capabilities: Capabilities | None = None
        self._exception: str | None = None
        self._state: NDArray[np.int64] = np.zeros(state.STATE_WORDS, np.int64)

    @classmethod
    def declared_latency_s(cls, config: Config) -> float:
        """Option ``latency_s``, or the transmission time of reply and COMMAND at the baud rate."""
        return read_options(config).declared_latency_s(more_bytes(config))

    @classmethod
    def max_rate_hz(cls, config: Config) -> float:
        """Highest servo rate at the baud rate, Hz."""
        return budget.fastest_rate_hz(read_options(config).baud, budget.EXCHANGE_BYTES + more_bytes(config))

    def check_rate(self, rate_hz: float) -> str | None:
        """Why baud, watchdog or reply time-out do not allow the rate; None if they do."""
        options = self._options
        more = more_bytes(self.config)
        return budget.rate_refusal(rate_hz, options.baud, options.watchdog_ms, options.reply_timeout_s, more)

    @property
    def error(self) -> str | None:
        """Why the session ended, if not by a closed port."""
        if self._state[state.S_LOST] == state.RESTARTED:
            return f"the board on {self._options.port} has restarted: it lost its settings and its encoder count"
        return self._exception

    @error.setter
    def error(self, text: str | None) -> None:
        self._exception = text

    def open(self) -> None:
        """Open the port and begin a session; the board is then at zero current and disabled."""
        options = self._options
        self._port = port.open_port(options.port, options.baud)
        self._session = Session(self._port.fileno(), options.port)
        self._capabilities = found = self._session.hello()
        self._check(found)
        self._session.configure(options.watchdog_ms, found)
        off = self._session.prove_off(found, inputs=self.config.safety.enable)
        self._state = self._initial_state(self._port.fileno(), found, off)
        self.read_address, self.write_address = exchange.read.address, exchange.write.address
        self.state_address = self._state.ctypes.data

    def _check(self, found: Capabilities) -> None:
        amplifier, name = self.config.amplifier, self._options.port
        if amplifier.dac_bits != found.dac_bits:
            raise DriverError(
                f"{name}: amplifier.dac_bits = {amplifier.dac_bits} bits, but the board's DAC has {found.dac_bits} bits"
            )
        if round((amplifier.dac_full_scale or 0.0) * 1e6) != found.full_scale_ua:
            raise DriverError(
                f"{name}: amplifier.dac_full_scale = {amplifier.dac_full_scale:g} A, "
                f"but the board's full scale is {found.full_scale_ua / 1e6:.7g} A"
            )

    def _initial_state(self, descriptor: int, found: Capabilities, reply: SampleReply) -> NDArray[np.int64]:
        options, more = self._options, more_bytes(self.config)
        words = state.new_state(descriptor, options.baud, options.reply_timeout_s, more)
        words[state.S_INPUTS] = self.config.safety.enable
        words[state.S_SEQ] = reply.seq
        words[state.S_COMMAND_SEQ] = reply.command_seq
        words[state.S_COUNTER_BITS] = found.counter_bits
        words[state.S_DAC_BITS] = found.dac_bits
        words[state.S_COUNTS] = exchange.unwrapped(0, reply.count, found.counter_bits)
        return words

    def close(self) -> None:
        """Command zero current and disable, as far as the port works, then close the port."""
        # For a loop that still runs the port is now lost: it sends nothing between or after these commands.
        self._state[state.S_LOST] = self._state[state.S_LOST] or state.GONE
        if self._port is None:
            return
        with contextlib.suppress(DriverError, OSError):
            if self._session is not None and self._capabilities is not None:
                self._session.flush(int(self._state[state.S_TORN]))
                for _ in range(_OFF_COMMANDS):
                    self._session.send_off(int(self._state[state.S_SEQ]), self._capabilities.dac_bits)
            port.wait_sent(self._port.fileno(), _LAST_BYTES_S)
        # During a present call, at most a period long, the descriptor's number must not be reused by another file.
        time.sleep(min(self.config.period, _LAST_BYTES_S))
        self._port.close()
        self._port = self._session = None

    def describe(self) -> str:
        """Port, baud, firmware and capabilities."""
        options, found = self._options, self._capabilities
        line = f"serial DAC board on {options.port} at {options.baud} baud"
        if found is None:
            return f"{line}, not open"
        return (
            f"{line}, firmware {found.firmware_text}, serial number {found.serial_number}: {found.dac_bits} bits over "
            f"± {found.full_scale_ua / 1e6:g} A, {found.counter_bits}-bit counter, watchdog {options.watchdog_ms} ms"
        )
