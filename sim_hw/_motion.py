"""The plant in real time, compiled: motion to an instant, the hand's steps, the counter, the log's rows.

Every event acts on the plant and is logged at its due instant, even if the service is late.
An instant in the past counts as the present one.
"""

from __future__ import annotations

import numba

from hapticd.jit import atomic_load, atomic_store, njit
from hapticd.plant import kernel
from sim_hw import layout as w
from sim_hw import log
from sim_hw.layout import I64, SIM, Sim

_RING_MASK = w.RING_ROWS - 1


@njit((SIM, I64, I64, I64, I64), counted=False)
def log_row(sim: Sim, ns: int, event: int, code: int, detail: int) -> None:
    """Write a row with the plant's present state into the ring; if that is full, count it in LOG_DROPPED."""
    head = sim.s[w.LOG_HEAD]
    if head - atomic_load(sim.s, w.LOG_TAIL) >= w.RING_ROWS:
        sim.s[w.LOG_DROPPED] += 1
        return
    row = sim.ring[head & _RING_MASK]
    row.time_ns = ns
    row.event = event
    row.position = sim.f[kernel.POSITION]
    row.velocity = sim.f[kernel.VELOCITY]
    row.counts = kernel.plant_counts(sim.f, sim.i) + sim.s[w.COUNTS_OFFSET]
    row.command_A = sim.sf[w.COMMAND_A]
    row.applied_A = sim.f[kernel.CURRENT]
    row.code = code
    row.detail = detail
    atomic_store(sim.s, w.LOG_HEAD, head + 1)


@njit(I64(SIM, I64, I64), counted=False)
def instant_ns(sim: Sim, origin: int, offset_ns: int) -> int:
    """Instant of an event in a script; FAR_NS until its origin (0: start, 1: first enable) has occurred."""
    from_ns = sim.s[w.START_NS] if origin == 0 else sim.s[w.ENABLED_NS]
    return w.FAR_NS if from_ns == w.FAR_NS else from_ns + offset_ns


@njit(I64(SIM), counted=False)
def _hand_due_ns(sim: Sim) -> int:
    step = sim.s[w.HAND_NEXT]
    return instant_ns(sim, sim.s[w.HAND_FROM], sim.hand_ns[step]) if step < sim.hand_ns.size else w.FAR_NS


@njit(I64(SIM), counted=False)
def _next_motion_ns(sim: Sim) -> int:
    """Next instant at which the hand or the motor current changes; FAR_NS if none is known."""
    due, waiting = kernel.plant_next_switch(sim.f, sim.i)
    if waiting == 0:
        due = w.FAR_NS
    return min(due, _hand_due_ns(sim))


@njit((SIM, I64), counted=False)
def move_to(sim: Sim, ns: int) -> None:
    """Move the plant to an instant, with every change of hand and current before it, each with a row."""
    while _next_motion_ns(sim) <= ns:
        due = _next_motion_ns(sim)
        before = sim.f[kernel.CURRENT]
        kernel.plant_advance(sim.f, sim.i, due, 0.0)
        if sim.f[kernel.CURRENT] != before:
            log_row(sim, due, log.APPLIED, 0, 0)
        if _hand_due_ns(sim) <= due:
            step = sim.s[w.HAND_NEXT]
            sim.f[kernel.HAND_FORCE] = sim.hand_force[step]
            sim.s[w.HAND_NEXT] = step + 1
            log_row(sim, due, log.HAND, step, 0)
    kernel.plant_advance(sim.f, sim.i, ns, 0.0)


@njit((SIM, I64, numba.float64), counted=False)
def set_current(sim: Sim, ns: int, current: float) -> None:
    """Command a current (A) at an instant; it acts on the motor T_A later. Writes an APPLIED row, but no COMMAND row.

    A plant whose link loses commands (``dropped_samples``) never loses a zero, which may come from the watchdog.
    """
    move_to(sim, ns)
    sim.sf[w.COMMAND_A] = current
    current *= sim.sf[w.CURRENT_GAIN]
    before = sim.f[kernel.CURRENT]
    if current == 0.0:
        kernel.plant_current(sim.f, sim.i, ns, 0.0, current)
    else:
        kernel.plant_command(sim.f, sim.i, ns, 0.0, current)
    if sim.f[kernel.CURRENT] != before:
        log_row(sim, ns, log.APPLIED, 0, 0)


@njit((SIM, I64), counted=False)
def note_enabled(sim: Sim, ns: int) -> None:
    """Write an ENABLE row; the first one is the origin of faults with ``from: enabled``."""
    if sim.s[w.ENABLED_NS] == w.FAR_NS:
        sim.s[w.ENABLED_NS] = ns
    log_row(sim, ns, log.ENABLE, 0, 0)


@njit(I64(SIM, I64), counted=False)
def take_counts(sim: Sim, ns: int) -> int:
    """Move the plant to an instant and return the device's count, with injected faults, not wrapped.

    It does not count a glitch as used: :func:`end_sample` does, after the sample was sent to the host.
    """
    move_to(sim, ns)
    counts = kernel.plant_counts(sim.f, sim.i) + sim.s[w.COUNTS_OFFSET]
    if sim.s[w.FROZEN_UNTIL_NS] > ns:
        counts = sim.s[w.FROZEN_COUNTS]
    if sim.s[w.GLITCH_LEFT] > 0:
        counts += sim.s[w.GLITCH_COUNTS]
    return counts


@njit((SIM,), counted=False)
def end_sample(sim: Sim) -> None:
    """End a sample for the host: one glitch fewer remains."""
    if sim.s[w.GLITCH_LEFT] > 0:
        sim.s[w.GLITCH_LEFT] -= 1
