"""Delayed frames, compiled: a slow line or an injected fault holds them until their instant."""

from __future__ import annotations

from typing import Any

import numba
from numpy.typing import NDArray

from hapticd.jit import njit
from sim_hw import layout as w
from sim_hw.layout import BYTES, I64, SIM, Sim


@njit((SIM, I64, I64, BYTES, I64), counted=False)
def hold(sim: Sim, due_ns: int, frame: int, data: NDArray[Any], length: int) -> None:
    """Hold a copy of a frame until ``due_ns`` (FAR_NS: until :func:`release`); it is lost if no slot is free.

    Args:
        sim: the device. due_ns: when it is forwarded. frame: bit of its kind, see :mod:`sim_hw.kinds`.
        data: uint8, of which the first ``length`` (at most HELD_BYTES) are stored.
    """
    order = 0
    free = -1
    for slot in range(w.HELD_SLOTS):
        if sim.held[slot, w.HELD_DUE_NS] == 0:
            free = slot
        else:
            order = max(order, sim.held[slot, w.HELD_ORDER])
    if free < 0:
        return
    sim.held[free, w.HELD_DUE_NS] = due_ns
    sim.held[free, w.HELD_ORDER] = order + 1
    sim.held[free, w.HELD_FRAME] = frame
    sim.held[free, w.HELD_LENGTH] = length
    for n in range(length):
        sim.held_bytes[free, n] = data[n]


@njit(numba.types.UniTuple(I64, 2)(SIM), counted=False)
def next_held(sim: Sim) -> tuple[int, int]:
    """Slot of the frame that is due first (of equal ones the older), and its instant; −1 and FAR_NS for none."""
    first, first_ns = -1, w.FAR_NS
    for slot in range(w.HELD_SLOTS):
        due = sim.held[slot, w.HELD_DUE_NS]
        earlier = due == first_ns and first >= 0 and sim.held[slot, w.HELD_ORDER] < sim.held[first, w.HELD_ORDER]
        if due > 0 and (due < first_ns or earlier):
            first, first_ns = slot, due
    return first, first_ns


@njit((SIM, I64, I64), counted=False)
def release(sim: Sim, frame: int, ns: int) -> None:
    """Release frames that waited for a frame of this kind, which has passed: they follow it at ``ns``."""
    for slot in range(w.HELD_SLOTS):
        if sim.held[slot, w.HELD_DUE_NS] == w.FAR_NS and sim.held[slot, w.HELD_FRAME] == frame:
            sim.held[slot, w.HELD_DUE_NS] = ns


@njit(I64(SIM, I64, BYTES), counted=False)
def take(sim: Sim, slot: int, data: NDArray[Any]) -> int:
    """Copy a held frame into ``data``, free its slot, and return its length."""
    length = sim.held[slot, w.HELD_LENGTH]
    for n in range(length):
        data[n] = sim.held_bytes[slot, n]
    sim.held[slot, w.HELD_DUE_NS] = 0
    return length
