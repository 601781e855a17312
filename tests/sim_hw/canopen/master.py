"""A small CANopen master for the tests, written apart from the drivers: plain sockets and struct, nothing else."""

import socket
import struct
import time

from tests.polling import PATIENCE_S

FRAME = struct.Struct("<IB3x8s")
REMOTE = 0x40000000
ERROR = 0x20000000
DISABLED, READY, SWITCHED_ON, ENABLED, QUICK_STOP, REACTION, FAULT = 0x40, 0x21, 0x23, 0x27, 0x07, 0x0F, 0x08
READ_DEVICE_TYPE = bytes.fromhex("40 00 10 00 00 00 00 00")
"""SDO request for 0x1000."""


def drive_state(statusword):
    """The statusword's state bits: 0x40 Switch On Disabled, 0x21 Ready, 0x23, 0x27, 0x07, 0x0F, 0x08 Fault."""
    coarse = statusword & 0x4F
    return coarse if coarse in (DISABLED, REACTION, FAULT) else statusword & 0x6F


class SdoAbortError(Exception):
    pass


class Master:
    """One client of the drive's Unix socket."""

    def __init__(self, path, node=1):
        self.node = node
        self.seen = []
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._connect(str(path))

    def _connect(self, path):
        """Again and again until somebody listens there."""
        end = time.monotonic() + PATIENCE_S
        while True:
            try:
                return self._socket.connect(path)
            except (FileNotFoundError, ConnectionRefusedError):
                if time.monotonic() > end:
                    raise
            time.sleep(0.01)

    def close(self):
        self._socket.close()

    def send(self, cob_id, data=b""):
        self._socket.send(FRAME.pack(cob_id, len(data), data.ljust(8, b"\0")))

    def receive(self, timeout=PATIENCE_S):
        """Next frame as (identifier with flags, data), None when none comes in time; EOFError when hung up."""
        self._socket.settimeout(timeout)
        try:
            raw = self._socket.recv(64)
        except TimeoutError:
            return None
        if not raw:
            raise EOFError
        cob_id, length, data = FRAME.unpack(raw)
        self.seen.append((cob_id, data[:length]))
        return self.seen[-1]

    def wait_for(self, cob_id, timeout=PATIENCE_S):
        """Data of the next frame with an identifier."""
        end = time.monotonic() + timeout
        while (left := end - time.monotonic()) > 0:
            frame = self.receive(left)
            if frame is not None and frame[0] == cob_id:
                return frame[1]
        raise TimeoutError(f"no frame 0x{cob_id:X} within {timeout} s")

    def settle(self):
        """All frames that come until the drive has dealt with everything sent before; SDO must be possible."""
        before = len(self.seen)
        self.read(0x1018, 1)
        return self.seen[before:-1]

    def unanswered(self, cob_id, reply_id, data=b""):
        """Whether a frame brings no reply before the answer to a guarding request sent after it."""
        self.send(cob_id, data)
        before = len(self.seen)
        self.guard()
        return reply_id not in [frame[0] for frame in self.seen[before:]]

    def wait_for_hang_up(self):
        """Take in frames until the drive closes the connection."""
        end = time.monotonic() + PATIENCE_S
        try:
            while time.monotonic() < end:
                self.receive()
        except EOFError:
            return
        raise AssertionError("never hung up")

    # SDO ------------------------------------------------------------------

    def request(self, data):
        self.send(0x600 + self.node, data)
        return self.wait_for(0x580 + self.node)

    def read(self, index, sub=0, signed=False):
        reply = self.request(struct.pack("<BHB4x", 0x40, index, sub))
        if reply[0] == 0x80:
            raise SdoAbortError(int.from_bytes(reply[4:], "little"))
        return int.from_bytes(reply[4 : 8 - (reply[0] >> 2 & 3)], "little", signed=signed)

    def read_text(self, index):
        length = int.from_bytes(self.request(struct.pack("<BHB4x", 0x40, index, 0))[4:], "little")
        text, toggle = b"", 0
        while True:
            reply = self.request(bytes([0x60 | toggle]) + bytes(7))
            text += reply[1 : 8 - (reply[0] >> 1 & 7)]
            toggle ^= 0x10
            if reply[0] & 1:
                assert len(text) == length
                return text.decode()

    def write(self, index, sub, value, size):
        payload = (value & (1 << 8 * size) - 1).to_bytes(size, "little").ljust(4, b"\0")
        reply = self.request(struct.pack("<BHB", 0x23 | (4 - size) << 2, index, sub) + payload)
        if reply[0] == 0x80:
            raise SdoAbortError(int.from_bytes(reply[4:], "little"))

    def refused(self, index, sub, value, size):
        """Abort code of a write that must be refused."""
        try:
            self.write(index, sub, value, size)
        except SdoAbortError as abort:
            return abort.args[0]
        raise AssertionError(f"0x{index:04X}:{sub} took {value}")

    # Services -------------------------------------------------------------

    def nmt(self, command):
        self.send(0, bytes([command, self.node]))

    def guard(self):
        self.send(0x700 + self.node | REMOTE)
        return self.wait_for(0x700 + self.node)[0]

    def state(self):
        return drive_state(self.read(0x6041))

    def control(self, word):
        """Controlword by SDO; the state after it."""
        self.write(0x6040, 0, word, 2)
        return self.state()

    def wait_state(self, state, timeout=PATIENCE_S):
        """Ask until the drive is in a state that it enters by itself; the states before it."""
        end, before = time.monotonic() + timeout, set()
        while (now := self.state()) != state:
            before.add(now)
            assert time.monotonic() < end, f"state 0x{now:02X} instead of 0x{state:02X}"
        return before

    def map_pdo(self, communication, mapping, cob_id, kind, entries):
        """The order that CiA 301 asks for: not valid, count 0, entries, count, type, valid."""
        self.write(communication, 1, cob_id | 1 << 31, 4)
        self.write(mapping, 0, 0, 1)
        for sub, entry in enumerate(entries, 1):
            self.write(mapping, sub, entry, 4)
        self.write(mapping, 0, len(entries), 1)
        self.write(communication, 2, kind, 1)
        self.write(communication, 1, cob_id, 4)

    def bring_up(self, mode=10, slope=0, enable=True):
        """Torque mode with the PDOs of a haptic loop, up to Operation Enabled; ``mode`` 0 is programmed current."""
        self.nmt(128)
        self.write(0x6087, 0, slope, 4)
        self.write(0x2113, 0, slope, 4)
        if mode:
            self.write(0x6060, 0, mode, 1)
        else:
            self.write(0x2300, 0, 1, 2)
        actual, target = (0x60770010, 0x60710010) if mode else (0x221C0010, 0x23400010)
        self.map_pdo(0x1800, 0x1A00, 0x180 + self.node, 1, [0x60410010, 0x60640020, actual])
        self.map_pdo(0x1400, 0x1600, 0x200 + self.node, 255, [0x60400010, target])
        self.nmt(1)
        if enable:
            self.enable()
            assert self.state() == ENABLED

    def enable(self):
        """Up to Operation Enabled, without a look at whether the drive stays there."""
        for word in (0x06, 0x07, 0x0F):
            self.command(word, 0)

    def command(self, control, target):
        self.send(0x200 + self.node, struct.pack("<Hh", control, target))

    def sync(self, timeout=PATIENCE_S):
        """SYNC and its TPDO1: statusword, counts, current or torque."""
        self.send(0x80)
        return struct.unpack("<Hih", self.wait_for(0x180 + self.node, timeout))
