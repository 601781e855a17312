"""The simulated drive as an object: memory, object dictionary, SDO server, and the actions of a write to an object."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

from hapticd.plant import kernel
from sim_hw._motion import log_row
from sim_hw._plant import build_sim
from sim_hw.canopen import _mapping, _node, _pdo, _sending, _timeline
from sim_hw.canopen import dictionary as codes
from sim_hw.canopen import layout as w
from sim_hw.canopen._drive import take_up
from sim_hw.canopen._power import CYCLIC_TORQUE, DESIRED_PROGRAMMED_CURRENT
from sim_hw.canopen._sdo import SdoServer
from sim_hw.canopen.dictionary import AbortError, ObjectDictionary
from sim_hw.log import END, START

if TYPE_CHECKING:
    from hapticd.config import Config
    from sim_hw.script import Script

_SDO_SERVER = 0x580
_MANUFACTURER_AREA = 0x2000
_MEASURED = frozenset({0x221C, 0x6063, 0x6064, 0x606C, 0x6077, 0x6078, 0x60FD})
_FOLLOWS_CANOPEN = 30
_PRODUCES_SYNC = 1 << 30
_LONGEST_CURRENT = 0x7FFF
"""Largest value of a Copley current object, 0.01 A."""
WRONG_DEVICE_TYPE = 0x00020191
"""Device type of a wrong device: a CiA 401 I/O module."""
WRONG_VENDOR = 0x0000FFFF


def power_up_values(config: Config, cyclic_torque: bool) -> dict[tuple[int, int], int]:
    """Objects whose power-up values depend on the plant: ratings, limits, encoder; and the supported modes.

    The rated torque is a whole number of mN m, and the rated current gives exactly that torque. The slopes are those of a
    new drive, 1000 ‰/s and the same in mA/s: a haptic loop does not work with them until a master changes them.
    """
    amplifier = config.amplifier
    continuous = amplifier.continuous_current or amplifier.peak_current or 1.0
    torque = max(round(continuous * amplifier.torque_constant * 1e3), 1)
    rated_mA = round(torque / amplifier.torque_constant)
    peak = round((amplifier.peak_current or 0.0) * 100) or _LONGEST_CURRENT
    return {
        (0x2110, 0): min(peak, _LONGEST_CURRENT),
        (0x2111, 0): min(round((amplifier.continuous_current or 0.0) * 100) or peak, _LONGEST_CURRENT),
        (0x2112, 0): min(round(amplifier.peak_time_s * 1e3), 0xFFFF),
        (0x2113, 0): rated_mA,
        (0x6075, 0): rated_mA,
        (0x6076, 0): torque,
        (0x608F, 1): round(config.encoder.counts_per_rev or config.encoder.counts_per_metre or 1),
        (0x6502, 0): 1 << (CYCLIC_TORQUE - 1) if cyclic_torque else 0,
    }


class Drive:
    """One simulated drive, switched on and about to boot.

    Args:
        config: the plant file. script: hand, start, faults. node_id: 1…127.
        cyclic_torque: whether the drive has mode 10; it always has Copley's programmed current.
        override: other power-up values of objects, by (index, sub-index).
        missing: indexes of objects that this drive does not have.
        Invalid values are left out; ``objects.check`` reports them.
    """

    def __init__(
        self,
        config: Config,
        script: Script,
        node_id: int,
        *,
        cyclic_torque: bool = True,
        override: Mapping[tuple[int, int], int] | None = None,
        missing: Iterable[int] = (),
    ) -> None:
        self.machine = w.new_machine(build_sim(config, script), node_id)
        values = power_up_values(config, cyclic_torque) | dict(override or {})
        self.objects = ObjectDictionary(self.machine.d, node_id, values, missing)
        self._sdo = SdoServer(self.read, self.write)
        self._node_id = node_id
        _mapping.compile_pdos(self.objects, self.machine.d)
        start_ns = int(self.machine.sim.i[kernel.TIME_NS])
        log_row(self.machine.sim, start_ns, START, node_id, 0)
        self.machine.d[w.TIMER + w.WAKE_TIMER] = start_ns

    def end(self) -> None:
        """The last row of the log."""
        now = time.monotonic_ns()
        _timeline.advance(self.machine, now)
        log_row(self.machine.sim, now, END, 0, 0)

    def attend(self) -> None:
        """Do the work of Python: SDO requests, and power-up values after a reset."""
        d = self.machine.d
        if d[w.RESET]:
            self.objects.load_defaults(_MANUFACTURER_AREA if d[w.RESET] == w.RESET_COMMUNICATION else 0x10000)
            _mapping.compile_pdos(self.objects, d)
            self._sdo.reset()
            d[w.RESET] = w.NO_RESET
        for low, data in self.machine.sdo[: d[w.SDO_COUNT]].tolist():
            request = (data & (1 << 64) - 1).to_bytes(8, "little")[: (low >> 32) & 0xFF]
            if reply := self._sdo.answer(request):
                cob_id, value = _SDO_SERVER + self._node_id, int.from_bytes(reply, "little", signed=True)
                _sending.send(self.machine, _sending.SDO_REPLY, cob_id, 8, value, time.monotonic_ns())
        d[w.SDO_COUNT] = 0

    def read(self, index: int, subindex: int) -> bytes:
        """Value of an object for the SDO server; measured values are of this instant.

        Raises:
            AbortError: the access is refused.
        """
        if index in _MEASURED:
            _pdo.refresh_inputs(self.machine, time.monotonic_ns())
        return self.objects.read(index, subindex)

    def write(self, index: int, subindex: int, data: bytes) -> None:
        """Write an object for the SDO server, and act on it.

        Raises:
            AbortError: the access is refused; then nothing has changed.
        """
        value = self.objects.decode(index, subindex, data)
        if _mapping.is_pdo_object(index):
            _mapping.check_pdo_write(self.objects, index, subindex, value)
        else:
            self._check(index, subindex, value)
        if index == 0x2183:
            value = self.objects[index, 0] & ~value
        self.objects[index, subindex] = value
        if _mapping.is_pdo_object(index):
            _mapping.compile_pdos(self.objects, self.machine.d)
            return
        now = time.monotonic_ns()
        if index == 0x1017:
            _node.restart_heartbeat(self.machine, now)
        if index in (0x1005, 0x1006):
            _node.restart_sync(self.machine, now)
        take_up(self.machine, index == 0x6040, now)
        _pdo.transmit_events(self.machine, now)

    def _check(self, index: int, subindex: int, value: int) -> None:
        """Rules for single objects in addition to their range in the EDS."""
        refused = (
            (index == 0x1003 and value != 0)
            or (index == 0x1005 and not 0 < value & ~_PRODUCES_SYNC <= 0x7FF)
            or (index == 0x1014 and not 0 < value & 0x7FFFFFFF <= 0x7FF)
            or (index == 0x2300 and value not in (0, DESIRED_PROGRAMMED_CURRENT, _FOLLOWS_CANOPEN))
            or (index == 0x6060 and value != 0 and not (value > 0 and self.objects[0x6502, 0] >> (value - 1) & 1))
        )
        if refused:
            raise AbortError(codes.INVALID_VALUE)
