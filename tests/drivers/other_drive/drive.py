"""The drive: durand's node with the objects of CiA 402 and Copley, its state machine, its power stage, its watchdogs."""

from __future__ import annotations

import heapq
import itertools
import time
from collections.abc import Callable, Mapping
from typing import Any

import durand
from durand.scheduler import VirtualScheduler
from durand.services.nmt import StateEnum
from durand.services.sdo.server import SDODomainAbort

from tests.drivers.other_drive import states
from tests.drivers.other_drive.axis import Axis, approach, held_within, signed
from tests.drivers.other_drive.book import Book
from tests.drivers.other_drive.objects import CYCLIC_TORQUE, FIRST_INPUT, OBJECTS, RECORDS, Objects, key_of
from tests.drivers.other_drive.troubles import FRAME_KINDS, KINDS, FrameTrouble
from tests.drivers.other_drive.wires import Frame, Wire

_TURN_S = 1e-3
_REACTION_NS = 1_000_000
_FOREVER = 1 << 62
_REGISTERS = {1: 0x01, 2: 0x02, 3: 0x04, 4: 0x08, 8: 0x10, 15: 0x80}
"""Bit of the error register (0x1001) by the class of an error code; any other one is the device profile's, bit 5."""


class Drive:
    """One drive on a wire; durand's network of it too.

    Args:
        wire: the bus. node_id: 1…127. axis: what it moves. book: what happens is written there.
        script: hand, start and faults (docs/reference/simulated-hardware.md). ``start`` has three keys more, each by object:
            ``refuse_read`` and ``refuse_write`` (SDO abort code), ``slow`` (s that an answer takes); and ``sto``: the enable
            switch opens Safe Torque Off as well as the first digital input.
    """

    def __init__(
        self,
        wire: Wire,
        node_id: int = 1,
        axis: Axis | None = None,
        book: Book | None = None,
        script: Mapping[str, Any] | None = None,
    ) -> None:
        self._wire, self._node_id = wire, node_id
        self._axis = axis or Axis()
        self._book = book or Book(None)
        script = script or {}
        start = script.get("start") or {}
        self._values = {key_of(name): value for name, value in (start.get("override") or {}).items()}
        self._missing = {key_of(name)[0] for name in start.get("missing") or ()}
        self.refused = {
            kind: {key_of(name): code for name, code in (start.get(f"refuse_{kind}") or {}).items()}
            for kind in ("read", "write")
        }
        self.slow = {key_of(name): seconds for name, seconds in (start.get("slow") or {}).items()}
        self.asked: list[tuple[str, int, int]] = []
        """Every SDO transfer that was begun: read or write, index, sub-index."""
        self._axis.angle, self._axis.offset = start.get("position", 0.0), start.get("counts_offset", 0)
        self._axis.current_gain = start.get("current_gain", 1.0)
        self._plan = [dict(fault) for fault in script.get("faults") or ()]
        self._hand = [dict(step) for step in script.get("hand") or ()]
        self._troubles: list[FrameTrouble] = []
        self._later: list[tuple[int, int, bool, Frame]] = []
        self._order = itertools.count()
        self._deaf_until = self._mute_until = self._open_until = 0
        self._sto = bool(start.get("sto"))
        self._glitch, self._twin, self._lie = [0, 0], [0, 0], (1.0, 0.0)
        self._born = self._now = self._axis.at_ns = time.monotonic_ns()
        self._first_enabled: int | None = None
        for fault in [one for one in self._plan if one["kind"] == "wrong_version"]:
            self._plan.remove(fault)
            self._values |= {(0x1000, 0): 0x30191, (0x1018, 1): 0xFFFF}
        self._power_up()

    def _power_up(self) -> None:
        self.state, self._word, self._since = states.OFF, 0, self._now
        self._demand = self._target = 0.0
        self._guard_toggle, self._guard_due, self._beat_due, self._sync_due = 0, _FOREVER, _FOREVER, _FOREVER
        self._reply_late_ns = 0
        self._listeners: dict[int, Callable[[int, bytes], None]] = {}
        self._scheduler = VirtualScheduler()
        durand.set_scheduler(self._scheduler)
        self.objects = objects = Objects(self._missing)
        for index, (name, kind, access, value) in OBJECTS.items():
            objects[index] = durand.Variable(kind, access, self._values.get((index, 0), value), name=name)
        for index, subs in RECORDS.items():
            objects[index] = record = durand.Record(name=f"0x{index:04X}")
            for sub, (name, kind, access, value) in subs.items():
                record[sub] = durand.Variable(kind, access, self._values.get((index, sub), value), name=name)
        self.node = node = durand.MinimalNode(self, self._node_id, objects)
        own = {(0x1000, 0): 0x00020192, (0x1018, 1): 0xAB, (0x1018, 2): 0x77, **self._values}
        for (index, sub), value in own.items():
            if index in (0x1000, 0x1018, 0x1005):
                objects.write(index, sub, value)
        # As drives come: a TPDO that speaks by itself whenever the statusword changes.
        node.tpdo[2].mapping = [(0x6041, 0)]
        node.sync.callbacks.add(self._sample)
        for tpdo in (0, 1):  # after our own: the sample is taken before it is sent
            node.tpdo[tpdo].transmission_type = 1
        objects.validate_callbacks[0x6060, 0].add(self._check_mode)
        objects.update_callbacks[0x6060, 0].add(lambda mode: objects.write(0x6061, 0, mode))
        objects.update_callbacks[0x6040, 0].add(self._control)
        for index in (0x6071, 0x2340):
            objects.update_callbacks[index, 0].add(lambda _: self._drive_current())
        node.nmt.state_callbacks.add(self._network_state)
        self._show()
        self._write(0)

    # What durand asks of a network.

    def add_subscription(self, cob_id: int, callback: Callable[[int, bytes], None]) -> None:
        """Call back for that identifier."""
        self._listeners[cob_id] = callback

    def remove_subscription(self, cob_id: int, callback: object = None) -> None:
        """No longer."""
        self._listeners.pop(cob_id, None)

    def send(self, cob_id: int, msg: bytes) -> None:
        """Send a frame of the node's."""
        frame = Frame(cob_id, bytes(msg))
        late = self._reply_late_ns if self._kind(frame) == "reply" else 0
        self._pass(frame, outwards=True, late_ns=late)
        if self._twin[1] and cob_id == 0x180 + self._node_id:
            self._twin[1] -= 1
            position = signed(int.from_bytes(msg[2:6], "little") + self._twin[0], 32)
            self._pass(frame._replace(data=msg[:2] + position.to_bytes(4, "little", signed=True) + msg[6:]), True)

    # The bus.

    def serve(self, ended: Callable[[], bool]) -> None:
        """Be a drive until told otherwise; ends at zero current."""
        while not ended():
            frames = self._wire.take(_TURN_S)
            before, self._now = self._now, time.monotonic_ns()
            self._scheduler.run(1e-9 * (self._now - before))
            for frame in frames:
                self._pass(frame, outwards=False)
            while self._later and self._later[0][0] <= self._now:
                _, _, outwards, frame = heapq.heappop(self._later)
                self._deliver(frame, outwards)
            self._turn()
            self._book.turn()
        self._axis.current = 0.0
        self._write(12)
        self._book.close()
        self._wire.cut()

    def _kind(self, frame: Frame) -> str:
        node = self._node_id
        named = {0x80: "sync", 0x180 + node: "tpdo", 0x280 + node: "tpdo", 0x200 + node: "rpdo"}
        return {**named, 0x600 + node: "request", 0x580 + node: "reply"}.get(frame.cob, "other")

    def _pass(self, frame: Frame, outwards: bool, late_ns: int = 0) -> None:
        """Through what the script has in store for it."""
        kind, passing = self._kind(frame), [(late_ns, frame)]
        for trouble in self._troubles:
            if trouble.hits(kind):
                passing = list(trouble.change(kind, frame))
                self._write(6, trouble.number)
                break
        for late, changed in passing:
            if late:
                heapq.heappush(self._later, (self._now + late, next(self._order), outwards, changed))
            else:
                self._deliver(changed, outwards)

    def _deliver(self, frame: Frame, outwards: bool) -> None:
        if self._now < (self._mute_until if outwards else self._deaf_until):
            return
        if outwards:
            self._wire.put(frame)
        elif frame.remote:
            if frame.cob == 0x700 + self._node_id:
                self._answer_guard()
        elif frame.cob >> 7 == 0x0E:
            self._take_heartbeat(frame)
        elif self._kind(frame) != "request" or self._takes_request(frame.data):
            if frame.cob == 0x80 and frame.data:
                self._emergency(0x8240)
            elif (listener := self._listeners.get(frame.cob)) is not None:
                listener(frame.cob, frame.data)

    def _takes_request(self, data: bytes) -> bool:
        """Note the beginning of an SDO transfer; whether it may go on."""
        kind = {1: "write", 2: "read"}.get(data[0] >> 5)
        if kind is None:
            return True
        key = int.from_bytes(data[1:3], "little"), data[3]
        self.asked.append((kind, *key))
        self._reply_late_ns = round(1e9 * self.slow.get(key, 0.0))
        code = self.refused[kind].get(key)
        if code is not None:
            self.send(0x580 + self._node_id, b"\x80" + data[1:4] + code.to_bytes(4, "little"))
        return code is None

    # Watchdogs.

    def _answer_guard(self) -> None:
        if self.objects.read(0x1017, 0):
            return  # one or the other (CiA 301)
        self.send(0x700 + self._node_id, bytes([self._guard_toggle | self.node.nmt.state]))
        self._guard_toggle ^= 0x80
        life_ms = self.objects.read(0x100C, 0) * self.objects.read(0x100D, 0)
        self._guard_due = self._now + 1_000_000 * life_ms if life_ms else _FOREVER

    def _take_heartbeat(self, frame: Frame) -> None:
        watched = self.objects.read(0x1016, 1) if 0x1016 not in self._missing else 0
        if watched & 0xFFFF and watched >> 16 & 0x7F == frame.cob & 0x7F:
            self._beat_due = self._now + 1_000_000 * (watched & 0xFFFF)

    def _check_watchdogs(self) -> None:
        if 0x1016 in self._missing or not self.objects.read(0x1016, 1) & 0xFFFF:
            self._beat_due = _FOREVER
        if not self.objects.read(0x100C, 0) * self.objects.read(0x100D, 0):
            self._guard_due = _FOREVER
        if self._now < min(self._guard_due, self._beat_due):
            return
        self._guard_due = self._beat_due = _FOREVER
        self._write(5)
        self._lose_master(0x8130)
        if self.node.nmt.state == StateEnum.OPERATIONAL and self.objects.read(0x1029, 1) == 0:
            self.node.nmt.set_state(StateEnum.PRE_OPERATIONAL)

    def _lose_master(self, code: int) -> None:
        """Abort connection option code, 0x6007."""
        option = self.objects.read(0x6007, 0)
        if option == 1:
            self._fail(code)
        elif option in (2, 3):
            self._enter(states.OFF if self.state != states.FAULTY else self.state)

    def _network_state(self, state: StateEnum) -> None:
        if state == StateEnum.STOPPED and self.state == states.ENABLED:
            self._lose_master(0x8100)
        elif state == StateEnum.INITIALISATION:
            self._node_id = self.node.node_id  # LSS may have given it another
            self._enter(states.OFF)

    # State machine.

    def _control(self, word: int) -> None:
        before, self._word = self._word, word
        new = states.after(self.state, word, before, self.objects.read(0x605A, 0))
        if self._is_inhibited and new in states.POWERED:
            new = states.OFF
        if self.state == states.FAULTY and new != states.FAULTY:
            self.objects.write(0x603F, 0, 0)
            self.node.emcy.set(0, 0)
        self._enter(new)
        self._write(2, 0, word)

    def _enter(self, state: str) -> None:
        if state == self.state:
            return
        old, self.state, self._since = self.state, state, self._now
        if state == states.ENABLED:
            self._first_enabled = self._first_enabled or self._now
            self._write(3)
        self._drive_current()
        if old == states.ENABLED:
            self._write(4, states.NUMBERS[state])
        self._write(9, states.NUMBERS[state], states.NUMBERS[old])
        self._show()

    def _fail(self, code: int) -> None:
        if self.state in (states.REACTING, states.FAULTY):
            return
        self.objects.write(0x603F, 0, code)
        self._enter(states.REACTING)
        self._emergency(code)

    def _emergency(self, code: int) -> None:
        self._write(7, code)
        self.node.emcy.set(code, 0x01 | _REGISTERS.get(code >> 12, 0x20))

    def _check_mode(self, mode: int) -> None:
        if not 1 <= mode <= 32 or not self.objects.read(0x6502, 0) >> mode - 1 & 1:
            raise SDODomainAbort(0x06090030, (0x6060, 0))

    def _show(self) -> None:
        """The statusword: supply is on, commands are taken; in cyclic torque bit 12 says that it follows, bit 11 limited."""
        word = states.SHOWN[self.state] | 0x0210
        if self.state == states.ENABLED:
            word |= 0x1000 | (0x0800 if self._is_limited() else 0)
        word |= 0x4000 if abs(self._axis.speed) > 0.1 else 0
        if word != self.objects.read(0x6041, 0):
            self.objects.write(0x6041, 0, word)

    @property
    def _is_open(self) -> bool:
        """Whether nobody holds the enable."""
        return self._now < self._open_until

    @property
    def _is_inhibited(self) -> bool:
        """Safe Torque Off: no power stage, whatever the controlword says."""
        return self._sto and self._is_open

    # Power stage.

    @property
    def _ampere_per_permille(self) -> float:
        return 1e-6 * self.objects.read(0x6076, 0) / self._axis.torque_constant

    def _wanted(self) -> float:
        """Current in A that the target means, before limits."""
        if self.objects.read(0x2300, 0) == 1:
            return 0.01 * self.objects.read(0x2340, 0)
        if self.objects.read(0x6060, 0) != CYCLIC_TORQUE:
            return 0.0
        return float(self.objects.read(0x6071, 0)) * self._ampere_per_permille

    def _limits(self) -> tuple[float, float]:
        return self.objects.read(0x6072, 0) * self._ampere_per_permille, 0.01 * self.objects.read(0x2110, 0)

    def _is_limited(self) -> bool:
        return abs(self._wanted()) > min(self._limits())

    def _drive_current(self) -> None:
        """Bring the current to where it belongs now, by the ramps since the last time."""
        elapsed = 1e-9 * (self._now - self._axis.at_ns)
        self._axis.move_to(self._now)
        if self.state != states.ENABLED:
            self._demand = 0.0
        else:
            self._target = held_within(self._wanted(), self._limits())
            slope = self.objects.read(0x6087, 0) * self._ampere_per_permille
            ramps = [ramp for ramp in (slope, 1e-3 * self.objects.read(0x2113, 0)) if ramp]
            # A ramp that has no time to pass in still holds: none of the step is taken yet.
            self._demand = approach(self._demand, self._target, max(min(ramps) * elapsed, 1e-12) if ramps else 0.0)
        if self._demand != self._axis.current:
            self._axis.current = self._demand
            self._write(11)

    def _sample(self) -> None:
        """SYNC: everything that a TPDO may carry, of this instant."""
        self._drive_current()
        counter = self._axis.counter
        if self._glitch[1]:
            self._glitch[1] -= 1
            counter = signed(counter + self._glitch[0], 32)
        told = self._lie[0] * self._axis.current + self._lie[1]
        per = self._ampere_per_permille or 1.0
        self._show()
        for index, value in (
            *((0x6063, counter), (0x6064, counter), (0x221C, round(100 * told))),
            (0x60FD, 0 if self._is_open else FIRST_INPUT),
            *((0x6077, round(told / per)), (0x6074, round(self._demand / per))),
        ):
            self.objects.write(index, 0, value)
        self._write(1, 0, self.objects.read(0x6041, 0))

    def _turn(self) -> None:
        """What goes on by itself."""
        self._drive_current()
        if self.state == states.REACTING and self._now - self._since > _REACTION_NS:
            self._enter(states.FAULTY)
        elif self.state == states.STOPPING and self.objects.read(0x605A, 0) < 5:
            self._enter(states.OFF)
        self._check_watchdogs()
        self._show()
        if self.objects.read(0x1005, 0) & 1 << 30 and (period := 1000 * self.objects.read(0x1006, 0)):
            if self._sync_due == _FOREVER:
                self._sync_due = self._now
            if self._now >= self._sync_due:
                self._sync_due += period
                self._wire.put(Frame(0x80))
                self.node.sync.callbacks.call()
        else:
            self._sync_due = _FOREVER
        for step in [one for one in self._hand if self._is_due(one)]:
            self._hand.remove(step)
            self._axis.hand = step["force"]
            self._write(8)
        for fault in [one for one in self._plan if self._is_due(one)]:
            self._plan.remove(fault)
            self._strike(fault)

    # Faults.

    def _is_due(self, planned: Mapping[str, Any]) -> bool:
        begin = {"enabled": self._first_enabled, "signal": None}.get(planned.get("from", ""), self._born)
        return begin is not None and self._now >= begin + 1e9 * planned["at_s"]

    def signalled(self) -> None:
        """The next fault that waits for a signal is due as long after this as it says."""
        waiting = [one for one in self._plan if one.get("from") == "signal"]
        if waiting:
            waiting[0]["at_s"] += 1e-9 * (time.monotonic_ns() - self._born)
            waiting[0]["from"] = "start"

    def _strike(self, fault: dict[str, Any]) -> None:
        kind, until = fault["kind"], _FOREVER
        if isinstance(fault.get("duration_s", "forever"), int | float):
            until = self._now + round(1e9 * fault["duration_s"])
        if kind in FRAME_KINDS:
            self._troubles.append(FrameTrouble(fault))
            return
        if kind == "power_up":
            self._axis.offset -= self._axis.true_counts
            self._power_up()
            return
        self._write(6, KINDS.index(kind))
        if kind == "freeze_counter":
            self._axis.held_until_ns = until
        elif kind == "encoder_glitch":
            self._glitch = [fault["counts"], fault.get("count", 1)]
        elif kind == "second_node":
            self._twin = [fault["counts"], fault.get("count", 1)]
        elif kind == "measured_current":
            self._lie = fault.get("factor", 1.0), fault.get("current", 0.0)
        elif kind == "silent":
            self._mute_until = until
        elif kind == "enable_released":
            self._open_until = until
            if self._is_inhibited and self.state in states.POWERED:
                self._enter(states.OFF)
        elif kind == "bus_off":
            self._wire.bus_off()
            self._mute_until = self._deaf_until = until
        elif kind == "unplug":
            self._wire.cut()
        elif kind == "emcy":
            self._fail(fault["code"])
        elif kind == "leave_operation_enabled":
            self._enter(states.OFF)
        elif kind == "reboot":
            self._enter(states.OFF)
            self._write(10)
            self._mute_until = self._deaf_until = self._now + round(1e9 * fault.get("off_s", 0.1))
            self._plan.append({"kind": "power_up", "at_s": 1e-9 * (self._mute_until - self._born)})
        elif kind == "foreign_sdo":
            index, sub = key_of(fault["object"])
            size = fault.get("size", 1)
            head = bytes([0x23 | (4 - size) << 2]) + index.to_bytes(2, "little") + bytes([sub])
            value = (fault["value"] % (1 << 8 * size)).to_bytes(4, "little")
            self._listeners[0x600 + self._node_id](0x600 + self._node_id, head + value)
        else:
            raise ValueError(f"this drive has no fault {kind!r}")

    def _write(self, event: int, code: int = 0, detail: int = 0) -> None:
        self._book.write(self._now, event, self._axis, self._target, code, detail)
