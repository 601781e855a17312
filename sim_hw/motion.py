"""The shaft in real time, compiled: moving the plant to an instant, the hand's steps, the counter, the log's rows.

Everything is put into the plant and into the log at the instant at which it was due, however late the service comes to it.
Callers go forward in time; an instant in the past counts as the present one.
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
    """Put a row with the plant as it is now into the ring; a full ring counts the loss in LOG_DROPPED."""
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
    """Instant of something scripted; FAR_NS while its origin (0: start, 1: first enable) has not come."""
    from_ns = sim.s[w.START_NS] if origin == 0 else sim.s[w.ENABLED_NS]
    return w.FAR_NS if from_ns == w.FAR_NS else from_ns + offset_ns


@njit(I64(SIM), counted=False)
def _hand_due_ns(sim: Sim) -> int:
    step = sim.s[w.HAND_NEXT]
    return instant_ns(sim, sim.s[w.HAND_FROM], sim.hand_ns[step]) if step < sim.hand_ns.size else w.FAR_NS


@njit(I64(SIM), counted=False)
def _next_motion_ns(sim: Sim) -> int:
    """Next instant at which the hand or the current in the motor changes; FAR_NS when none is known."""
    due, waiting = kernel.plant_next_switch(sim.f, sim.i)
    if waiting == 0:
        due = w.FAR_NS
    return min(due, _hand_due_ns(sim))


@njit((SIM, I64), counted=False)
def move_to(sim: Sim, ns: int) -> None:
    """Move the plant to an instant, through every change of hand and current on the way, each with its row."""
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
    """Command a current (A) at an instant; it reaches the motor T_A later. Writes an APPLIED row, but no COMMAND row.

    A plant whose link loses commands (``dropped_samples``) never loses a zero: that may be the watchdog's.
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
    """The amplifier goes on: an ENABLE row, and the origin of faults with ``from: enabled`` the first time."""
    if sim.s[w.ENABLED_NS] == w.FAR_NS:
        sim.s[w.ENABLED_NS] = ns
    log_row(sim, ns, log.ENABLE, 0, 0)


@njit(I64(SIM, I64), counted=False)
def take_counts(sim: Sim, ns: int) -> int:
    """What the device's counter shows at an instant, injected faults included, not yet wrapped; moves the plant there.

    Looking does not use a glitch up: :func:`end_sample` does, once the host has been sent what was seen.
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
    """A sample has been taken for the host: one glitch less is left."""
    if sim.s[w.GLITCH_LEFT] > 0:
        sim.s[w.GLITCH_LEFT] -= 1
