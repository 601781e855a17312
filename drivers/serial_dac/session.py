"""The beginning of a session with a board: HELLO, capabilities, CONFIGURE, and the proof that its output is off."""

from __future__ import annotations

import os
import random
import select
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TypeVar

from drivers.interface import DriverError
from drivers.serial_dac import messages
from drivers.serial_dac.framing import Decoder, frame

HELLO_S = 3.0
HELLO_EVERY_S = 0.1
REPLY_S = 0.25
ATTEMPTS = 3
_CHUNK = 4096

_Found = TypeVar("_Found")


@dataclass
class Session:
    """Requests and replies on an open descriptor, before and after the compiled exchange.

    Attributes:
        descriptor: of the port, not blocking.
        name: of the port, for messages.
    """

    descriptor: int
    name: str
    received: int = 0
    decoder: Decoder = field(default_factory=Decoder)

    def hello(self) -> messages.Capabilities:
        """Begin a session; the board disables its output.

        Raises:
            DriverError: no reply, another protocol version, or impossible capabilities.
        """
        nonce = random.randrange(0x10000)  # noqa: S311 - distinguishes sessions, not a secret
        nonces: set[int] = set()
        self.flush()
        deadline = time.monotonic() + HELLO_S

        def mine(payload: bytes) -> tuple[int, bytes] | None:
            head = messages.hello_reply_head(payload)
            return (head[0], payload) if head is not None and head[1] in nonces else None

        while time.monotonic() < deadline:
            nonce = (nonce + 1) & 0xFFFF
            nonces.add(nonce)
            self.send(messages.hello(nonce))
            if (reply := self.receive(mine, HELLO_EVERY_S)) is not None:
                return self._checked(*reply)
        raise DriverError(f"{self.name}: no reply from a board within {HELLO_S:g} s ({self._silence()})")

    def _checked(self, version: int, payload: bytes) -> messages.Capabilities:
        if version != messages.VERSION:
            raise DriverError(
                f"{self.name}: the board has version {version} of the protocol, this driver version {messages.VERSION}"
            )
        found = messages.capabilities(payload)
        if found is None:
            raise DriverError(
                f"{self.name}: the board's HELLO reply has {len(payload)} bytes, not those of version {version}"
            )
        wrong = {
            f"dac_bits = {found.dac_bits}, not in 8 … 16": not 8 <= found.dac_bits <= 16,
            "full scale = 0 µA": found.full_scale_ua == 0,
            f"counter_bits = {found.counter_bits}, not in 16 … 32": not 16 <= found.counter_bits <= 32,
            f"watchdog range = {found.watchdog_min_ms} … {found.watchdog_max_ms} ms": not (
                1 <= found.watchdog_min_ms <= found.watchdog_max_ms
            ),
        }
        if said := [text for text, holds in wrong.items() if holds]:
            raise DriverError(f"{self.name}: the board's HELLO reply is invalid: {'; '.join(said)}")
        return found

    def configure(self, watchdog_ms: int, found: messages.Capabilities) -> None:
        """Set the board's watchdog.

        Raises:
            DriverError: outside the board's range, refused, or no reply.
        """
        if not found.watchdog_min_ms <= watchdog_ms <= found.watchdog_max_ms:
            raise DriverError(
                f"{self.name}: driver.watchdog_ms = {watchdog_ms} ms: the board allows "
                f"{found.watchdog_min_ms} to {found.watchdog_max_ms} ms"
            )
        for _ in range(ATTEMPTS):
            self.send(messages.configure(watchdog_ms))
            reply = self.receive(messages.configure_reply, REPLY_S)
            if reply is not None:
                if reply != watchdog_ms:
                    refused = "refused it" if reply == 0 else f"has set {reply} ms"
                    raise DriverError(f"{self.name}: driver.watchdog_ms = {watchdog_ms} ms: the board {refused}")
                return
        raise DriverError(f"{self.name}: the board does not reply to CONFIGURE ({self._silence()})")

    def prove_off(self, found: messages.Capabilities, *, inputs: bool = False) -> messages.SampleReply:
        """Command zero current and disable, and check the board's confirmation.

        Args:
            found: the board's capabilities. inputs: request a sample with the board's inputs.

        Raises:
            DriverError: no reply, no such inputs, or no confirmation.
        """
        reply = None
        for seq in range(1, ATTEMPTS + 1):
            self.send_off(seq, found.dac_bits)
            self.send(messages.sample(seq, inputs=inputs))
            reply = self.receive(_sample_reply_to(seq, inputs), REPLY_S)
            if reply is not None and reply.command_seq == seq and not reply.status & messages.STATUS_ENABLED:
                return reply
        if reply is None and inputs:
            raise DriverError(
                f"{self.name}: safety.enable = true: the board does not reply to SAMPLE_INPUTS; its firmware "
                f"{found.firmware_text} has no enable input: load a newer one (docs/protocols/serial-dac.md)"
            )
        if reply is None:
            raise DriverError(f"{self.name}: the board does not reply to SAMPLE ({self._silence()})")
        raise DriverError(
            f"{self.name}: the board does not confirm zero current and disable (status {reply.status:#04x})"
        )

    def send_off(self, seq: int, dac_bits: int) -> None:
        """Send COMMAND with mid-scale and enable 0."""
        self.send(messages.command(seq, 1 << (dac_bits - 1), enable=False))

    def flush(self, spoiler: int = 0) -> None:
        """End a partly received frame in the board; a ``spoiler`` other than 0 first makes it invalid.

        Raises:
            DriverError: the port is lost.
        """
        self._write(bytes([spoiler, 0]) if spoiler else b"\0")

    def send(self, payload: bytes) -> None:
        """Send one frame.

        Raises:
            DriverError: the port is lost.
        """
        self._write(frame(payload))

    def receive(self, wanted: Callable[[bytes], _Found | None], timeout_s: float) -> _Found | None:
        """The result of ``wanted`` for the first payload that it accepts; None after ``timeout_s``; others are dropped.

        Raises:
            DriverError: the port is lost.
        """
        deadline = time.monotonic() + timeout_s
        while (left := deadline - time.monotonic()) > 0:
            if not select.select([self.descriptor], [], [], left)[0]:
                continue
            try:
                data = os.read(self.descriptor, _CHUNK)
            except BlockingIOError:
                continue
            except OSError as error:
                raise self._gone(error) from error
            if not data:
                raise self._gone(None)
            self.received += len(data)
            for payload in self.decoder.feed(data):
                if (found := wanted(payload)) is not None:
                    return found
        return None

    def _write(self, data: bytes) -> None:
        try:
            os.write(self.descriptor, data)
        except BlockingIOError:
            pass  # a full output buffer leads to a missing reply
        except OSError as error:
            raise self._gone(error) from error

    def _gone(self, error: OSError | None) -> DriverError:
        return DriverError(f"{self.name}: the port is lost ({error.strerror if error else 'closed'})")

    def _silence(self) -> str:
        if not self.received:
            return "nothing was received; is the board powered, and is this its port?"
        bad = self.decoder.bad_coding + self.decoder.bad_crc
        return (
            f"{self.received} bytes were received, with {bad} bad frames and no reply; "
            "is driver.baud that of the board, and does it have the protocol of docs/protocols/serial-dac.md?"
        )


def _sample_reply_to(seq: int, inputs: bool) -> Callable[[bytes], messages.SampleReply | None]:
    """A function that returns the reply to one SAMPLE, and None for other payloads."""

    def wanted(payload: bytes) -> messages.SampleReply | None:
        reply = messages.sample_reply(payload, inputs=inputs)
        return reply if reply is not None and reply.seq == seq else None

    return wanted
