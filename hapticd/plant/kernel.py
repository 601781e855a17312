"""One simulated device as compiled kernels on one block of memory: amplifier, shaft, encoder, hand.

The block is a contiguous float64 buffer ``f``; ``i = f.view(int64)`` is the same memory read as integers. The word numbers
below are its layout, so that the loopback driver, the simulated hardware and the Python class share one plant.

Instants are (ns, fraction of a ns): an int64 and a float64 in [0, 1), so that a period such as 1/3 ms loses nothing over
any number of ticks. A commanded current takes effect T_A = 2 δ_A/ω_A later (eq. 5); between two such switches the force is
constant and the motion is exact (:mod:`hapticd.plant.exact`, with a hand's stiffness :mod:`hapticd.plant.spring`).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from hapticd.jit import njit
from hapticd.plant.amplifier import quantise_current
from hapticd.plant.exact import propagate
from hapticd.plant.spring import propagate_with_stiffness

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from hapticd.config import Config

POSITION = 0
"""True position, rad or m."""
VELOCITY = 1
"""True velocity, rad/s or m/s."""
TIME_NS = 2
"""i64: present instant, whole ns."""
TIME_FRAC = 3
"""Present instant, fraction of a ns."""
CURRENT = 4
"""Current in the motor now, A."""
HAND_FORCE = 5
"""External torque or force of a hand, N m or N; may be changed between two advances."""
INERTIA = 6
"""Device and grip together, kg m² or kg."""
VISCOUS = 7
"""Device and grip together, N m s/rad or N s/m."""
COULOMB = 8
"""N m or N."""
STIFFNESS = 9
"""Of the grip, N m/rad or N/m, about HAND_REST."""
HAND_REST = 10
"""Where the grip's spring is relaxed, rad or m."""
TORQUE_CONSTANT = 11
"""N m/A or N/A."""
LAG_NS = 12
"""T_A in ns."""
DAC_STEP = 13
"""A; 0 for none."""
DAC_MAX_CODE = 14
"""i64: largest positive code."""
SATURATION = 15
"""A; infinite for none."""
RAW_RESOLUTION = 16
"""rad or m per count."""
INVERT = 17
"""i64: 1 when the encoder counts backwards."""
QUEUE_HEAD = 18
"""i64: commands put in."""
QUEUE_TAIL = 19
"""i64: commands taken out."""
QUEUE_OVERFLOWS = 20
"""i64: commands that found the queue full and took the place of the newest one waiting."""
HEADER_WORDS = 32

QUEUE_LENGTH = 4096
"""Commands that can wait inside T_A; a power of two."""
_MASK = QUEUE_LENGTH - 1
# Divided by, not multiplied with 1e-9, which no double holds: 10⁶ ns are then the very double 0.001 s.
_NS_PER_SECOND = 1e9
_COUNT_LIMIT = 2.0**62
_DUE_NS = HEADER_WORDS
_DUE_FRAC = _DUE_NS + QUEUE_LENGTH
_DUE_CURRENT = _DUE_FRAC + QUEUE_LENGTH
PLANT_SIZE = _DUE_CURRENT + QUEUE_LENGTH
"""Words of the block."""


def init_plant(config: Config, position: float = 0.0, velocity: float = 0.0) -> NDArray[np.float64]:
    """A new block for a config's ``plant``, ``hand``, ``amplifier`` and ``encoder``, at instant 0 with no current.

    The grip's spring is relaxed at the virtual spring's origin: it acts in parallel with it (Sec. III-B). With
    ``dac_bits`` 0 the converter is ideal and has no full scale either; ``peak_current`` still limits.

    Args:
        config: resolved configuration.
        position: true initial position, rad or m.
        velocity: true initial velocity, rad/s or m/s.

    Returns:
        Shape (PLANT_SIZE,), float64.
    """
    f = np.zeros(PLANT_SIZE)
    i = f.view(np.int64)
    amplifier = config.amplifier
    f[POSITION], f[VELOCITY] = position, velocity
    f[INERTIA] = config.plant.inertia + config.hand.inertia
    f[VISCOUS] = config.plant.viscous + config.hand.damping
    f[COULOMB] = config.plant.coulomb
    f[STIFFNESS] = config.hand.stiffness
    f[HAND_REST] = config.origin_counts * config.raw_resolution
    f[TORQUE_CONSTANT] = amplifier.torque_constant
    f[LAG_NS] = amplifier.delay * 1e9
    bits = amplifier.dac_bits or 0
    if bits and amplifier.dac_full_scale:
        f[DAC_STEP] = math.ldexp(amplifier.dac_full_scale, 1 - bits)
        i[DAC_MAX_CODE] = (1 << (bits - 1)) - 1
    f[SATURATION] = amplifier.peak_current or math.inf
    f[RAW_RESOLUTION] = config.raw_resolution
    i[INVERT] = int(config.encoder.invert)
    return f


@njit("void(float64[::1], float64)", counted=False)
def _move(f: NDArray[Any], dt: float) -> None:
    force = f[CURRENT] * f[TORQUE_CONSTANT] + f[HAND_FORCE]
    if f[STIFFNESS] == 0.0:
        f[POSITION], f[VELOCITY] = propagate(f[POSITION], f[VELOCITY], dt, force, f[INERTIA], f[VISCOUS], f[COULOMB])
    else:
        before = f[POSITION] - f[HAND_REST]
        after, f[VELOCITY] = propagate_with_stiffness(
            before, f[VELOCITY], dt, force, f[INERTIA], f[VISCOUS], f[COULOMB], f[STIFFNESS]
        )
        # A shaft that stiction holds keeps its position to the bit: it may lie on an edge of the encoder.
        if after != before:
            f[POSITION] = after + f[HAND_REST]


@njit("void(float64[::1], int64[::1], int64, float64)", counted=False)
def plant_advance(f: NDArray[Any], i: NDArray[Any], ns: int, frac: float) -> None:
    """Move the shaft to an instant, through every switch of the current on the way; an instant in the past does nothing."""
    while i[QUEUE_TAIL] < i[QUEUE_HEAD]:
        slot = i[QUEUE_TAIL] & _MASK
        due_ns, due_frac = i[_DUE_NS + slot], f[_DUE_FRAC + slot]
        if (due_ns - ns) + (due_frac - frac) > 0.0:
            break
        dt = (due_ns - i[TIME_NS]) + (due_frac - f[TIME_FRAC])
        if dt > 0.0:
            _move(f, dt / _NS_PER_SECOND)
            i[TIME_NS] = due_ns
            f[TIME_FRAC] = due_frac
        f[CURRENT] = f[_DUE_CURRENT + slot]
        i[QUEUE_TAIL] += 1
    dt = (ns - i[TIME_NS]) + (frac - f[TIME_FRAC])
    if dt > 0.0:
        _move(f, dt / _NS_PER_SECOND)
        i[TIME_NS] = ns
        f[TIME_FRAC] = frac


@njit("void(float64[::1], int64[::1], int64, float64, float64)", counted=False)
def plant_command(f: NDArray[Any], i: NDArray[Any], ns: int, frac: float, current: float) -> None:
    """Command a current (A) at an instant: onto the DAC's grid, into saturation, and into the motor T_A later.

    Commands take effect in the order in which they were given. One whose effect is already past takes effect as soon as
    the shaft next moves; not-a-number is zero current.
    """
    if math.isnan(current):
        current = 0.0
    if f[DAC_STEP] > 0.0:
        current, _ = quantise_current(current, f[DAC_STEP], i[DAC_MAX_CODE])
    current = min(max(current, -f[SATURATION]), f[SATURATION])
    head = i[QUEUE_HEAD]
    if head - i[QUEUE_TAIL] == QUEUE_LENGTH:
        i[QUEUE_OVERFLOWS] += 1
        head -= 1
    slot = head & _MASK
    due = frac + f[LAG_NS]
    whole = np.floor(due)
    i[_DUE_NS + slot] = ns + int(whole)
    f[_DUE_FRAC + slot] = due - whole
    f[_DUE_CURRENT + slot] = current
    i[QUEUE_HEAD] = head + 1
    if f[LAG_NS] == 0.0:
        plant_advance(f, i, ns, frac)


@njit("int64(float64[::1], int64[::1])", counted=False)
def plant_counts(f: NDArray[Any], i: NDArray[Any]) -> int:
    """What the encoder counts: ⌊x/δ⌋, negated when it is mounted the other way round.

    Negating the floor, not the position, makes a loop that undoes the sign see the same counts as without it. The count
    ends at ±2⁶², and is −2⁶² for not-a-number: a jump that no loop takes for a movement.
    """
    level = np.floor(f[POSITION] / f[RAW_RESOLUTION])
    if level > _COUNT_LIMIT:
        level = _COUNT_LIMIT
    elif not level >= -_COUNT_LIMIT:
        level = -_COUNT_LIMIT
    counts = int(level)
    return -counts if i[INVERT] != 0 else counts


@njit("boolean(float64[::1], int64[::1])", counted=False)
def plant_stays(f: NDArray[Any], i: NDArray[Any]) -> bool:
    """Whether the shaft is at rest and stiction holds it for as long as the current stays as it is."""
    force = f[CURRENT] * f[TORQUE_CONSTANT] + f[HAND_FORCE] - f[STIFFNESS] * (f[POSITION] - f[HAND_REST])
    return f[VELOCITY] == 0.0 and abs(force) <= f[COULOMB]
