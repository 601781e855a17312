"""The bus while the drive is brought up: opening it, listening for other masters, and finding who is there."""

from __future__ import annotations

import threading
import time
from typing import Any, Final

import can
import canopen

from drivers.canopen import layout as w
from drivers.canopen.options import Options
from drivers.interface import DriverError

LISTEN_S: Final = 0.1
"""Silence that is waited for before the first frame: a master at 10 Hz or faster gives itself away."""
_ECHO_S: Final = 0.2
"""Longest wait for our own frame to come back."""
_SCAN_S: Final = 0.3
_NOTIFIER_S: Final = 0.02
_SYNC_S: Final = 0.25
_SYNCS: Final = 10
"""SYNC that are measured at least, and for how long."""
_SYNC_ATTEMPTS: Final = 4
"""A machine that is busy hears them late."""
_SYNC_TOLERANCE: Final = 0.05
"""Between the producer's period and the servo's: what the loop's estimate of its grid follows within a fifth of a period."""


class Monitor(can.Listener):
    """Notes what the bring-up must know of the traffic: commands of others, nodes that speak, the last TPDO 1."""

    def __init__(self, node_id: int, *, follows: bool = False) -> None:
        self._node_id, self._follows = node_id, follows
        self._news = threading.Condition()
        self.commands: list[can.Message] = []
        self.nodes: set[int] = set()
        self.booted: set[int] = set()
        self.syncs: list[float] = []
        """When SYNC came, s, where a producer on the bus is followed."""
        self.samples = 0
        self.sample = b""

    def on_message_received(self, msg: can.Message) -> None:
        """Sort one frame."""
        if msg.is_error_frame or msg.is_extended_id:
            return
        base, node = msg.arbitration_id & ~0x7F, msg.arbitration_id & 0x7F
        with self._news:
            if self._follows and msg.arbitration_id == w.SYNC and not msg.is_remote_frame:
                self.syncs.append(msg.timestamp or time.monotonic())
            elif is_command(msg, self._node_id):
                self.commands.append(msg)
            elif base in (w.GUARD, w.SDO_REPLY) and node and not msg.is_remote_frame:
                self.nodes.add(node)
                if base == w.GUARD and bytes(msg.data) == b"\0":
                    self.booted.add(node)
            elif msg.arbitration_id == w.TPDO1 + self._node_id:
                self.samples += 1
                self.sample = bytes(msg.data)
            self._news.notify_all()

    def on_error(self, exc: Exception) -> None:
        """The bus cannot be read any more: what is waited for does not come, and whoever waits for it says so."""

    def wait_sample(self, before: int, timeout_s: float) -> bytes | None:
        """The TPDO 1 after the first ``before`` ones, or None when it does not come in time."""
        with self._news:
            return self.sample if self._news.wait_for(lambda: self.samples > before, timeout_s) else None

    def wait_command(self, identifier: int, timeout_s: float) -> bool:
        """Whether a command with an identifier has been heard, or is heard in time."""
        with self._news:
            return self._news.wait_for(
                lambda: any(heard.arbitration_id == identifier for heard in self.commands), timeout_s
            )


def is_command(message: can.Message, node_id: int) -> bool:
    """Whether only a master sends this: NMT, SYNC, our drive's RPDO 1, a request to it, or a guarding request."""
    identifier = message.arbitration_id
    if message.is_remote_frame:
        return identifier == w.GUARD + node_id
    return identifier in (w.NMT, w.SYNC, w.RPDO1 + node_id, w.SDO_REQUEST + node_id)


def open_bus(options: Options) -> can.BusABC:
    """Open the python-can bus.

    Raises:
        DriverError: there is no such interface or channel; with the next step.
    """
    arguments: dict[str, Any] = {"interface": options.interface, "channel": options.channel, **options.bus}
    if options.interface not in ("socketcan", "unix_seqpacket", "udp_multicast", "virtual"):
        arguments.setdefault("bitrate", options.bitrate)
    try:
        return can.Bus(**arguments)
    except Exception as exception:
        hint = (
            f"; is it up? sudo ip link set {options.channel} up type can bitrate {options.bitrate}"
            if options.interface == "socketcan"
            else ""
        )
        raise DriverError(
            f"CAN interface {options.interface}, channel {options.channel}: {exception or type(exception).__name__}{hint}"
        ) from exception


def listen(network: canopen.Network, monitor: Monitor) -> None:
    """Start the thread that receives for the network and the monitor (CANopen's, for bring-up and close only)."""
    if network.bus is not None:
        network.notifier = can.Notifier(network.bus, [*network.listeners, monitor], _NOTIFIER_S)


def stop_listening(network: canopen.Network) -> None:
    """End that thread: from here on the exchange alone reads the bus."""
    if network.notifier is not None:
        network.notifier.stop()
        network.notifier = None


def listen_for_master(monitor: Monitor, node_id: int) -> None:
    """Listen before the first frame is sent.

    Raises:
        DriverError: another master drives this bus.
    """
    time.sleep(LISTEN_S)
    refuse_other_master(monitor, node_id)


def check_sync(monitor: Monitor, rate_hz: float) -> None:
    """Measure the producer whose SYNC the loop is to follow.

    Raises:
        DriverError: there is none, or its period is not that of the servo rate, however often it is measured.
    """
    period, found = 1.0 / rate_hz, 0.0
    for _ in range(_SYNC_ATTEMPTS):
        before = len(monitor.syncs)
        time.sleep(max(_SYNC_S, _SYNCS * period))
        times = monitor.syncs[before:]
        if len(times) < _SYNCS // 2:
            continue
        found = (times[-1] - times[0]) / (len(times) - 1)
        if abs(found - period) <= _SYNC_TOLERANCE * period:
            return
    if not found:
        raise DriverError(
            "servo.clock = sync: no SYNC (0x080) comes; switch its producer on (in a drive: 0x1006 the period in µs, then "
            "bit 30 of 0x1005), or take servo.clock: grid"
        )
    raise DriverError(
        f"servo.clock = sync: SYNC comes every {1e6 * found:.0f} µs ({1.0 / found:.4g} Hz) on average, servo.rate_hz = "
        f"{rate_hz:g} Hz asks for {1e6 * period:.0f} µs; set one of them, and see that one device alone produces SYNC"
    )


def refuse_other_master(monitor: Monitor, node_id: int) -> None:
    """Refuse to share the bus.

    Raises:
        DriverError: commands were heard that this driver did not send.
    """
    if monitor.commands:
        heard = monitor.commands[0]
        own = ", or have the drive no longer produce it (0x1005, bit 30)" if heard.arbitration_id == w.SYNC else ""
        raise DriverError(
            f"another master is on the bus: {describe_command(heard.arbitration_id, node_id)} was heard, and this driver "
            f"did not send it; stop the other program or device first{own}"
        )


def describe_command(identifier: int, node_id: int) -> str:
    """A master's frame in words."""
    names = {
        w.NMT: "NMT",
        w.SYNC: "SYNC",
        w.RPDO1 + node_id: f"RPDO 1 to node {node_id}",
        w.SDO_REQUEST + node_id: f"an SDO request to node {node_id}",
        w.GUARD + node_id: f"a guarding request to node {node_id}",
    }
    return f"{names.get(identifier & 0x7FF, 'a command')} (0x{identifier & 0x7FF:03x})"


def stop_node(network: canopen.Network, monitor: Monitor, node_id: int) -> bool:
    """NMT: node to pre-operational. Returns whether the interface gives our own frames back (udp_multicast does)."""
    network.send_message(w.NMT, bytes([0x80, node_id]))
    monitor.booted.discard(node_id)  # from here on it would lose what is set
    echoes = monitor.wait_command(w.NMT, _ECHO_S)
    if echoes:
        monitor.commands.clear()
    return echoes


def nobody_answers(network: canopen.Network, monitor: Monitor, options: Options) -> DriverError:
    """Why the node does not answer: it has another number, or nobody is there at all."""
    network.scanner.search()
    time.sleep(_SCAN_S)
    others = sorted({*network.scanner.nodes, *monitor.nodes} - {options.node_id})
    if others:
        numbers = ", ".join(f"{node}{' (just booted)' if node in monitor.booted else ''}" for node in others)
        return DriverError(
            f"node {options.node_id} does not answer, but there is node {numbers}: set driver.node_id = {others[0]}, or the "
            "drive's own number"
        )
    return DriverError(
        f"node {options.node_id} does not answer, and no other node does: check the drive's supply, the wiring, the "
        f"termination (120 Ω at both ends) and that its bit rate is driver.bitrate = {options.bitrate} bit/s"
    )
