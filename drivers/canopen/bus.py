"""The bus during bring-up: opening it, listening for other masters, and finding nodes."""

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
"""Time of listening before the first frame: detects a master at 10 Hz or faster."""
ECHO_S: Final = 0.2
"""Longest wait for the return of an own frame."""
_SCAN_S: Final = 0.3
_NOTIFIER_S: Final = 0.02
_SYNC_S: Final = 0.25
_SYNCS: Final = 10
"""Fewest SYNC that are measured, for at least `_SYNC_S`."""
_SYNC_ATTEMPTS: Final = 4
"""Repetitions, because a busy machine receives SYNC late."""
_SYNC_TOLERANCE: Final = 0.05
"""Largest relative difference of the producer's and the servo's period, which the loop's grid follows."""


class Monitor(can.Listener):
    """Records the traffic for bring-up: commands of others, active nodes, the last TPDO 1."""

    def __init__(self, node_id: int, *, follows: bool = False) -> None:
        self._node_id, self._follows = node_id, follows
        self._news = threading.Condition()
        self.commands: list[can.Message] = []
        self.nodes: set[int] = set()
        self.booted: set[int] = set()
        self.syncs: list[float] = []
        """Times of SYNC, s, if the loop follows a producer on the bus."""
        self.samples = 0
        self.sample = b""

    def on_message_received(self, msg: can.Message) -> None:
        """Classify one frame."""
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
        """Nothing: after a read error the waiting functions run into their time-outs."""

    def wait_sample(self, before: int, timeout_s: float) -> bytes | None:
        """The TPDO 1 after the first ``before`` ones, or None after the time-out."""
        with self._news:
            return self.sample if self._news.wait_for(lambda: self.samples > before, timeout_s) else None

    def wait_command(self, identifier: int, timeout_s: float) -> bool:
        """Whether a command with an identifier was received, or is received before the time-out."""
        with self._news:
            return self._news.wait_for(
                lambda: any(heard.arbitration_id == identifier for heard in self.commands), timeout_s
            )


def is_command(message: can.Message, node_id: int) -> bool:
    """Whether only a master sends this frame: NMT, SYNC, the drive's RPDO 1, an SDO request to it, or a guarding request."""
    identifier = message.arbitration_id
    if message.is_remote_frame:
        return identifier == w.GUARD + node_id
    return identifier in (w.NMT, w.SYNC, w.RPDO1 + node_id, w.SDO_REQUEST + node_id)


def open_bus(options: Options) -> can.BusABC:
    """Open the python-can bus.

    Raises:
        DriverError: there is no such interface or channel; with the remedy.
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
    """Start CANopen's receiving thread for the network and the monitor (for bring-up and close only)."""
    if network.bus is not None:
        network.notifier = can.Notifier(network.bus, [*network.listeners, monitor], _NOTIFIER_S)


def stop_listening(network: canopen.Network) -> None:
    """End that thread: from now on only the exchange reads the bus."""
    if network.notifier is not None:
        network.notifier.stop()
        network.notifier = None


def listen_for_master(monitor: Monitor, node_id: int) -> None:
    """Listen before the first frame is sent.

    Raises:
        DriverError: there is another master on this bus.
    """
    time.sleep(LISTEN_S)
    refuse_other_master(monitor, node_id)


def check_sync(monitor: Monitor, rate_hz: float) -> None:
    """Measure the SYNC of the producer that the loop will follow.

    Raises:
        DriverError: there is none, or its period is not that of the servo rate in several measurements.
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
            "servo.clock = sync: no SYNC (0x080) is received; switch its producer on (in a drive: 0x1006 the period in µs, "
            "then bit 30 of 0x1005), or set servo.clock: grid"
        )
    raise DriverError(
        f"servo.clock = sync: SYNC comes every {1e6 * found:.0f} µs ({1.0 / found:.4g} Hz) on average, servo.rate_hz = "
        f"{rate_hz:g} Hz needs {1e6 * period:.0f} µs; correct one of them, and check that only one device produces SYNC"
    )


def refuse_other_master(monitor: Monitor, node_id: int) -> None:
    """Refuse to share the bus.

    Raises:
        DriverError: commands were heard that this driver did not send.
    """
    if monitor.commands:
        heard = monitor.commands[0]
        own = ", or switch off its SYNC production (0x1005, bit 30)" if heard.arbitration_id == w.SYNC else ""
        raise DriverError(
            f"another master is on the bus: {describe_command(heard.arbitration_id, node_id)} was received, and this driver "
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
    """NMT: node to pre-operational. Returns whether the interface returns own frames (udp_multicast does)."""
    network.send_message(w.NMT, bytes([0x80, node_id]))
    monitor.booted.discard(node_id)  # a later boot-up loses settings
    echoes = monitor.wait_command(w.NMT, ECHO_S)
    if echoes:
        monitor.commands.clear()
    return echoes


def nobody_answers(network: canopen.Network, monitor: Monitor, options: Options) -> DriverError:
    """Why the node does not reply: it has another number, or there is no node."""
    network.scanner.search()
    time.sleep(_SCAN_S)
    others = sorted({*network.scanner.nodes, *monitor.nodes} - {options.node_id})
    if others:
        numbers = ", ".join(f"{node}{' (just booted)' if node in monitor.booted else ''}" for node in others)
        return DriverError(
            f"node {options.node_id} does not reply, but there is node {numbers}: set driver.node_id = {others[0]}, or the "
            "node number in the drive"
        )
    return DriverError(
        f"node {options.node_id} does not reply, and no other node does: check the drive's supply, the wiring, the "
        f"termination (120 Ω at both ends) and that its bit rate is driver.bitrate = {options.bitrate} bit/s"
    )
