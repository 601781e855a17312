"""Compiled injected faults: the due ones, their effect on frames, and those common to all devices."""

from __future__ import annotations

from typing import Any

import numba
from numpy.typing import NDArray

from hapticd.jit import njit
from hapticd.plant import kernel
from sim_hw import kinds, log
from sim_hw import layout as w
from sim_hw._held import hold, next_held
from sim_hw._motion import instant_ns, log_row, move_to
from sim_hw.layout import BYTES, I64, SIM, Sim


@njit(numba.types.UniTuple(I64, 2)(SIM), counted=False)
def next_fault(sim: Sim) -> tuple[int, int]:
    """Row of the waiting fault that is due first, and its instant; −1 and FAR_NS if there is none.

    A fault whose origin has not occurred is not due.
    """
    first, first_ns = -1, w.FAR_NS
    for row in range(sim.faults.shape[0]):
        if sim.faults[row, w.FAULT_STATE] == w.WAITING:
            due = instant_ns(sim, sim.faults[row, w.FAULT_FROM], sim.faults[row, w.FAULT_AT_NS])
            if due < first_ns:
                first, first_ns = row, due
    return first, first_ns


@njit(I64(SIM), counted=False)
def next_event_ns(sim: Sim) -> int:
    """Instant of the next held frame or the next fault; FAR_NS for none."""
    return min(next_held(sim)[1], next_fault(sim)[1])


@njit(numba.types.UniTuple(I64, 4)(SIM), counted=False)
def begin_fault(sim: Sim) -> tuple[int, int, int, int]:
    """Begin the next fault, which the device then applies.

    It applies the faults common to all devices: frozen counter, encoder glitch, silence, released enable. All but frame
    faults get their FAULT_INJECTED row here (code: number of the kind, detail: row in the script's list), at their instant.

    Returns:
        Its kind, its row, its instant, and its end: FAR_NS for a permanent one.
    """
    row, due = next_fault(sim)
    fault = sim.faults[row]
    duration = fault[w.FAULT_DURATION_NS]
    until = w.FAR_NS if duration == w.FAR_NS else due + duration
    kind = fault[w.FAULT_KIND]
    if kind <= kinds.LAST_FRAME_FAULT:
        fault[w.FAULT_STATE] = w.ACTIVE
        return kind, row, due, until
    fault[w.FAULT_STATE] = w.OVER
    move_to(sim, due)
    if kind == kinds.FREEZE_COUNTER:
        sim.s[w.FROZEN_COUNTS] = kernel.plant_counts(sim.f, sim.i) + sim.s[w.COUNTS_OFFSET]
        sim.s[w.FROZEN_UNTIL_NS] = until
    elif kind == kinds.ENCODER_GLITCH:
        sim.s[w.GLITCH_COUNTS] = fault[w.FAULT_COUNTS]
        sim.s[w.GLITCH_LEFT] = fault[w.FAULT_COUNT]
    elif kind == kinds.SILENT:
        sim.s[w.SILENT_UNTIL_NS] = until
    elif kind == kinds.RELEASED:
        sim.s[w.RELEASED_UNTIL_NS] = until
    log_row(sim, due, log.FAULT_INJECTED, kind, row)
    return kind, row, due, until


@njit(numba.types.UniTuple(I64, 2)(SIM, I64, I64), counted=False)
def frame_fate(sim: Sim, frame: int, ns: int) -> tuple[int, int]:
    """Effect on one frame: bits ``1 << kind`` of the frame faults that apply to it, and its delay in ns.

    Each reduces the fault's ``count`` by one and writes a FAULT_INJECTED row (code: kind, detail: the frame's bit).
    """
    fate = 0
    delay = 0
    for row in range(sim.faults.shape[0]):
        if sim.faults[row, w.FAULT_STATE] != w.ACTIVE or (sim.faults[row, w.FAULT_FRAMES] & frame) == 0:
            continue
        kind = sim.faults[row, w.FAULT_KIND]
        fate |= 1 << kind
        if kind == kinds.DELAY:
            delay += sim.faults[row, w.FAULT_DELAY_NS]
        sim.faults[row, w.FAULT_LEFT] -= 1
        if sim.faults[row, w.FAULT_LEFT] == 0:
            sim.faults[row, w.FAULT_STATE] = w.OVER
        log_row(sim, ns, log.FAULT_INJECTED, kind, frame)
    return fate, delay


@njit(I64(SIM), counted=False)
def random_bits(sim: Sim) -> int:
    """31 reproducible random bits (the linear congruential generator of POSIX ``rand48``)."""
    sim.s[w.RANDOM] = (sim.s[w.RANDOM] * 0x5DEECE66D + 0xB) & 0xFFFFFFFFFFFF
    return sim.s[w.RANDOM] >> 17


@njit((SIM, BYTES, I64), counted=False)
def corrupt(sim: Sim, frame: NDArray[Any], length: int) -> None:
    """Flip one random bit among the first ``length`` bytes of a frame."""
    position = random_bits(sim) % (8 * length)
    frame[position >> 3] ^= 1 << (position & 7)


@njit(numba.types.UniTuple(I64, 2)(SIM, I64, BYTES, I64, I64, I64), counted=False)
def pass_frame(sim: Sim, frame: int, data: NDArray[Any], size: int, due_ns: int, now: int) -> tuple[int, int]:
    """Apply the faults to a frame: number of copies that pass now, and the bits of its faults.

    The others are held (see :func:`sim_hw._held.hold`) or dropped.

    Args:
        frame: bit of its kind. data: the frame; a corrupted one gets one inverted bit.
        size: its bytes, with the delimiter. due_ns: its instant without a fault.
    """
    fate, delay = frame_fate(sim, frame, now)
    if fate & kinds.DROPPED:
        return 0, fate
    if fate & kinds.CORRUPTED and size > 1:
        corrupt(sim, data, size - 1)
    copies = 2 if fate & kinds.DUPLICATED else 1
    due = w.FAR_NS if fate & kinds.REORDERED else due_ns + delay
    if due <= now:
        return copies, fate
    for _ in range(copies):
        hold(sim, due, frame, data, size)
    return 0, fate
