"""A drive for bring-up tests: canopen's own LocalNode as SDO server and PDO codec, behind the other end of a Unix socket.

It can be made to lie: ``overrides`` are what reads answer, ``aborts`` the objects that it refuses to write or read.
"""

from __future__ import annotations

import socket
import threading
from pathlib import Path
from typing import Any

import can
import canopen

from drivers.canopen.profile import FOLDER
from drivers.seqpacket_bus import SeqpacketBus
from tests.polling import PATIENCE_S

OBJECTS: dict[tuple[int, int], int] = {
    (0x1018, 1): 0xAB,
    (0x6041, 0): 0x0250,
    (0x6063, 0): 1234,
    (0x6075, 0): 2000,
    (0x6076, 0): 58,
    (0x6087, 0): 1000,
    (0x6502, 0): 1 << 9,
}
_STATES = {0x00: 0x0250, 0x06: 0x0231, 0x07: 0x0233, 0x0F: 0x0237, 0x02: 0x0250}


class _PeerBus(SeqpacketBus):
    def __init__(self, connected: socket.socket) -> None:
        self._socket = connected
        self.channel_info = "peer"
        can.BusABC.__init__(self, channel="peer")


class FakeDrive(can.Listener):
    """Listens on ``path`` for one client and is the drive (and the bus) for it."""

    def __init__(self, path: Path, node_id: int = 1, eds: Path = FOLDER / "copley.eds", **objects: Any) -> None:
        self.path, self.node_id = path, node_id
        self.node = canopen.LocalNode(node_id, canopen.import_od(str(eds), node_id))
        self.aborts: dict[tuple[int, int], int] = objects.pop("aborts", {})
        self.write_aborts: dict[tuple[int, int], int] = objects.pop("write_aborts", {})
        self.overrides: dict[tuple[int, int], int] = objects.pop("overrides", {})
        self.keeps: dict[tuple[int, int], int] = objects.pop("keeps", {})
        self.stuck = objects.pop("stuck", False)
        self.mute = objects.pop("mute", False)
        self.sends_first: list[can.Message] = objects.pop("sends_first", [])
        assert not objects, objects
        self.heard: list[can.Message] = []
        self._put({**OBJECTS, **self.overrides})
        self.node.add_read_callback(self._on_read)
        self.node.add_write_callback(self._on_write)
        self._listening = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._listening.bind(str(path))
        self._listening.listen(1)
        self.network = canopen.Network()
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def _put(self, values: dict[tuple[int, int], int]) -> None:
        for (index, sub), value in values.items():
            if (variable := self.node.object_dictionary.get_variable(index, sub)) is not None:
                self.node.data_store.setdefault(index, {})[sub] = variable.encode_raw(value)

    def value(self, index: int, sub: int = 0) -> int:
        variable = self.node.object_dictionary.get_variable(index, sub)
        assert variable is not None
        return int(variable.decode_raw(self.node.get_data(index, sub)))

    def _on_read(self, index: int, subindex: int, od: Any) -> Any:
        if (index, subindex) in self.aborts:
            raise canopen.SdoAbortedError(self.aborts[index, subindex])
        if (index, subindex) in self.keeps:
            return self.keeps[index, subindex]
        if index == 0x6061 and (0x6061, 0) not in self.overrides:
            return self.value(0x6060)
        return None

    def _on_write(self, index: int, subindex: int, od: Any, data: bytes) -> None:
        key = (index, subindex)
        if key in self.aborts or key in self.write_aborts:
            raise canopen.SdoAbortedError({**self.aborts, **self.write_aborts}[key])
        if index == 0x6040:
            self.control(int.from_bytes(data[:2], "little"))

    def control(self, word: int) -> None:
        if self.stuck:
            return
        if self.value(0x6041) & 0x08:
            if word & 0x80:
                self._put({(0x6041, 0): 0x0250})
            return
        self._put({(0x6041, 0): _STATES.get(word, 0x0250)})

    def _serve(self) -> None:
        self._listening.settimeout(PATIENCE_S)
        try:
            connected, _ = self._listening.accept()
        except OSError:
            return
        bus = _PeerBus(connected)
        self.network.bus = bus
        for message in self.sends_first:
            bus.send(message)
        if not self.mute:
            self.network.add_node(self.node)
        self.network.notifier = can.Notifier(bus, [*self.network.listeners, self], 0.02)

    def on_message_received(self, msg: can.Message) -> None:
        self.heard.append(msg)
        if self.mute:
            return
        if msg.is_remote_frame:
            return
        if msg.arbitration_id == 0x80:
            sample = self.value(0x6041).to_bytes(2, "little") + self.value(0x6063).to_bytes(4, "little", signed=True)
            self.send(0x180 + self.node_id, sample + bytes(2))
        elif msg.arbitration_id == 0x200 + self.node_id:
            self.control(int.from_bytes(msg.data[:2], "little"))

    def on_error(self, exc: Exception) -> None:
        """The client has gone."""

    def send(self, identifier: int, data: bytes) -> None:
        self.network.send_message(identifier, data)

    def close(self) -> None:
        self._listening.close()
        self._thread.join()
        if self.network.notifier is not None:
            self.network.notifier.stop()
        if self.network.bus is not None:
            self.network.bus.shutdown()
