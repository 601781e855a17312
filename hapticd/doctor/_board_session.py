"""A session with a serial DAC board for its bring-up: output off, and a reply is awaited for every SAMPLE."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from drivers.serial_dac import messages, port
from drivers.serial_dac.exchange import unwrapped
from drivers.serial_dac.options import read_options
from drivers.serial_dac.session import Session

if TYPE_CHECKING:
    from drivers.serial_dac.options import Options
    from hapticd.config import Config

REPLY_S: Final = 0.25
"""Longest wait for a reply."""


class NoReplyError(Exception):
    """The board did not answer a SAMPLE."""


@dataclass
class Board:
    """A session with a board: output off, and a reply is awaited for every SAMPLE."""

    session: Session
    options: Options
    capabilities: messages.Capabilities
    seq: int = 0
    counts: int = 0
    """Position with the counter's overflow removed."""

    def sample(self) -> messages.SampleReply:
        """One SAMPLE and its reply.

        Raises:
            NoReplyError: no reply. DriverError: the port is lost.
        """
        self.seq = (self.seq + 1) & 0xFF
        self.session.send(messages.sample(self.seq))

        def wanted(payload: bytes) -> messages.SampleReply | None:
            reply = messages.sample_reply(payload)
            return reply if reply is not None and reply.seq == self.seq else None

        reply = self.session.receive(wanted, REPLY_S)
        if reply is None:
            raise NoReplyError
        self.counts = unwrapped(self.counts, reply.count, self.capabilities.counter_bits)
        return reply

    @property
    def middle(self) -> int:
        """The code of zero current."""
        return 1 << (self.capabilities.dac_bits - 1)

    def code(self, current: float) -> int:
        """The code of a current in A."""
        full_scale = self.capabilities.full_scale_ua * 1e-6
        return min(max(self.middle + round(current / full_scale * self.middle), 0), 2 * self.middle - 1)

    def command(self, code: int, *, enable: bool) -> None:
        """One COMMAND."""
        self.session.send(messages.command(self.seq, code, enable=enable))

    def off(self) -> None:
        """Zero current and disable, twice."""
        for _ in range(2):
            self.command(self.middle, enable=False)


@contextmanager
def opened(config: Config) -> Iterator[Board]:
    """A board with its output off, which is switched off again at the end in any case.

    Raises:
        DriverError: no port, no board, another version.
    """
    options = read_options(config)
    line = port.open_port(options.port, options.baud)
    try:
        session = Session(line.fileno(), options.port)
        board = Board(session, options, session.hello())
        try:
            yield board
        finally:
            board.off()
            port.wait_sent(line.fileno(), REPLY_S)
    finally:
        line.close()
