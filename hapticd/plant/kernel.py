"""One simulated device as compiled kernels on one block of memory: amplifier, shaft, encoder, hand.

The block is a contiguous float64 buffer ``f``; ``i = f.view(int64)`` is the same memory as integers. The indices
below are its layout, so that the loopback driver, the simulated hardware and the Python class share one plant.

Instants are (ns, fraction of a ns): an int64 and a float64 in [0, 1), so that a period such as 1/3 ms has no drift over
any number of ticks. A commanded current takes effect T_A = 2 δ_A/ω_A later (eq. 5); between two such changes the force is
constant and the motion is exact (:mod:`hapticd.plant.exact`, with a hand's stiffness :mod:`hapticd.plant.spring`); or it
reaches a second-order current loop (:mod:`hapticd.plant.lagged`). Effects of the catalogue that are edits of that model
(another inertia, a bias, a delay) keep it exact; with the others the motion is that of :mod:`hapticd.plant.closed_loop`.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from hapticd.effects import dropped_samples
from hapticd.jit import effect_term, njit
from hapticd.plant import layout as effects
from hapticd.plant.amplifier import converter_grid, quantise_current
from hapticd.plant.closed_loop import advance_with_effects, stays_with_effects
from hapticd.plant.electrical import delivered
from hapticd.plant.lagged import SPAN_WORDS, lagged_motion, parts_per_time, prepare
from hapticd.plant.noise import next_uniform
from hapticd.plant.numeric import edited_base, measured, needs_effect_terms
from hapticd.plant.resolution import substeps_for
from hapticd.plant.spring import propagate_about_rest

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
"""Sum of device and grip, kg m² or kg."""
VISCOUS = 7
"""Sum of device and grip, N m s/rad or N s/m."""
COULOMB = 8
"""N m or N."""
STIFFNESS = 9
"""Of the grip, N m/rad or N/m, about HAND_REST."""
HAND_REST = 10
"""Rest position of the grip's spring, rad or m."""
TORQUE_CONSTANT = 11
"""N m/A or N/A."""
LAG_NS = 12
"""Time in ns until a command takes effect, or reaches the current loop: T_A for an amplifier that is a delay."""
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
"""i64: commands that met a full queue and replaced the newest one waiting."""
BIAS = 21
"""Constant torque or force of the device itself, N m or N."""
AIM = 22
"""Present set point of the amplifier, A; without a current loop CURRENT follows it at once."""
AGE = 23
"""Time for which the plant has moved, s, for effects that depend on time."""
HAS_EFFECT_TERMS = 24
"""i64: 1 if an effect is on that the closed form does not cover."""
LONGEST_STEP = 25
"""Longest substep of such effects, s."""
LINK = 26
"""i64: state of the random numbers for lost commands."""
CURRENT_RATE = 27
"""Derivative of CURRENT over the current loop's ω, A."""
NATURAL = 28
"""ω of a current loop without other effects, rad/s; 0 for none."""
DAMPING = 29
"""Its damping ratio δ."""
FINEST = 30
"""Parts per second into which its motion is divided if the shaft may stop."""
HEADER_WORDS = 32

QUEUE_LENGTH = 4096
"""Commands that can wait inside T_A; a power of two."""
_MASK = QUEUE_LENGTH - 1
# The dither uses the same seed, and the two must not be correlated.
_OF_LINK = 0x6C696E6B
_EXTERNAL = effects.index_of("external_force")
_TRANSPORT_DELAY = effects.index_of("transport_delay.t_d")
_LOSS = effects.index_of("dropped_samples.p")
_LAG = effects.index_of("amplifier_lag.f_a")
_LAG_DAMPING = effects.index_of("amplifier_lag.delta")
_is_lost = effect_term(dropped_samples.is_lost)
# Divided by, not multiplied with 1e-9, which is not exact in a double: 10⁶ ns are then exactly the double 0.001 s.
_NS_PER_SECOND = 1e9
_COUNT_LIMIT = 2.0**62
_DUE_NS = HEADER_WORDS
_DUE_FRAC = _DUE_NS + QUEUE_LENGTH
_DUE_CURRENT = _DUE_FRAC + QUEUE_LENGTH
DEVICE = _DUE_CURRENT + QUEUE_LENGTH
"""First element of the device vector (`hapticd.plant.layout`)."""
_STATE = DEVICE + effects.SIZE
_SPAN = _STATE + effects.STATE
PLANT_SIZE = _SPAN + SPAN_WORDS
"""Words of the block."""


def init_plant(
    config: Config, position: float = 0.0, velocity: float = 0.0, *, current_loop: bool = False
) -> NDArray[np.float64]:
    """A new block for a config's ``plant``, ``hand``, ``amplifier`` and ``encoder``, at instant 0 with zero current.

    The grip's spring has its rest at the virtual spring's origin: it acts in parallel with it (Sec. III-B). With
    ``dac_bits`` 0 the converter is ideal, without full scale; ``peak_current`` still limits.

    Args:
        config: resolved configuration.
        position: true initial position, rad or m.
        velocity: true initial velocity, rad/s or m/s.
        current_loop: whether the amplifier is a second-order current loop, and not its delay (5). With the
            effect ``amplifier_lag`` it is always the delay, and that effect is the current loop behind it.

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
    f[DAC_STEP], i[DAC_MAX_CODE] = converter_grid(amplifier.dac_bits, amplifier.dac_full_scale)
    f[SATURATION] = amplifier.peak_current or math.inf
    f[RAW_RESOLUTION] = config.raw_resolution
    i[INVERT] = int(config.encoder.invert)
    f[DEVICE:_STATE] = effects.neutral_vector()
    f[_STATE:_SPAN] = effects.initial_state(position, velocity)
    if config.plant.effects or (current_loop and amplifier.bandwidth_hz):
        _add_effects(f, i, config, current_loop)
    return f


def _add_effects(f: NDArray[np.float64], i: NDArray[np.int64], config: Config, current_loop: bool) -> None:
    """Add a config's effects to a block: as an edit of the base model or its current loop, or else as terms."""
    p = f[DEVICE:_STATE]
    p[:] = effects.device_vector(config)
    (
        f[INERTIA],
        f[VISCOUS],
        f[COULOMB],
        f[TORQUE_CONSTANT],
        f[BIAS],
        f[STIFFNESS],
        f[HAND_REST],
    ) = edited_base(p)
    f[LAG_NS] += p[_TRANSPORT_DELAY] * 1e9
    if current_loop and config.amplifier.bandwidth_hz and p[_LAG] == math.inf:
        p[_LAG], p[_LAG_DAMPING] = config.amplifier.bandwidth_hz, config.amplifier.damping_ratio
        f[LAG_NS] -= config.amplifier.delay * 1e9
    lag, p[_LAG] = p[_LAG], math.inf
    i[HAS_EFFECT_TERMS] = int(needs_effect_terms(p))
    if i[HAS_EFFECT_TERMS] or lag == math.inf:
        p[_LAG] = lag
    else:
        f[NATURAL], f[DAMPING] = 2.0 * math.pi * lag, p[_LAG_DAMPING]
        f[FINEST] = parts_per_time(f[NATURAL], config.period)
    f[LONGEST_STEP] = config.period / substeps_for(p, config.period)
    i[LINK] = config.dither.seed ^ _OF_LINK


@njit("void(float64[::1], float64)", counted=False)
def _move_with_effect_terms(f: NDArray[Any], dt: float) -> None:
    p = f[DEVICE:_STATE]
    state = f[_STATE:_SPAN]
    p[_EXTERNAL] = f[HAND_FORCE]
    state[effects.THETA], state[effects.OMEGA] = f[POSITION], f[VELOCITY]
    advance_with_effects(p, state, f[AGE], dt, f[LONGEST_STEP], f[AIM])
    f[POSITION], f[VELOCITY] = state[effects.THETA], state[effects.OMEGA]
    f[CURRENT] = state[effects.MOTOR_CURRENT]
    f[AGE] += dt


@njit("void(float64[::1], float64)", counted=False)
def _move_behind_current_loop(f: NDArray[Any], dt: float) -> None:
    made, given = f[_SPAN:PLANT_SIZE], f[HAND_FORCE] + f[BIAS]
    if made[0] != dt:  # most periods are equal
        prepare(f[NATURAL], f[DAMPING], f[INERTIA], f[VISCOUS], f[FINEST], dt, made)
    constant, stretch = f[TORQUE_CONSTANT], f[POSITION] - f[HAND_REST] if f[STIFFNESS] > 0.0 else f[POSITION]
    after, f[VELOCITY], force, rate, _, _ = lagged_motion(
        stretch, f[VELOCITY], constant * f[CURRENT] + given, constant * f[CURRENT_RATE], constant * f[AIM] + given,
        f[INERTIA], f[VISCOUS], f[COULOMB], f[STIFFNESS], made,
    )  # fmt: skip
    # a shaft held by stiction keeps its position exactly
    if after != stretch:
        f[POSITION] = after + f[HAND_REST] if f[STIFFNESS] > 0.0 else after
    f[CURRENT], f[CURRENT_RATE] = (force - given) / constant, rate / constant


@njit("void(float64[::1], int64[::1], float64)", inline=True, counted=False)
def _move(f: NDArray[Any], i: NDArray[Any], dt: float) -> None:
    if i[HAS_EFFECT_TERMS] != 0:
        _move_with_effect_terms(f, dt)
        return
    if f[NATURAL] > 0.0:
        _move_behind_current_loop(f, dt)
        return
    force = f[CURRENT] * f[TORQUE_CONSTANT] + f[HAND_FORCE] + f[BIAS]
    f[POSITION], f[VELOCITY] = propagate_about_rest(
        f[POSITION], f[VELOCITY], dt, force, f[INERTIA], f[VISCOUS], f[COULOMB], f[STIFFNESS], f[HAND_REST]
    )


@njit("void(float64[::1], float64)", inline=True, counted=False)
def _take_effect(f: NDArray[Any], current: float) -> None:
    f[AIM] = current
    if f[DEVICE + _LAG] == math.inf and f[NATURAL] == 0.0:
        f[CURRENT] = current


@njit("void(float64[::1], int64[::1], int64, float64)", inline=True, counted=False)
def plant_advance(f: NDArray[Any], i: NDArray[Any], ns: int, frac: float) -> None:
    """Move the shaft to an instant, with every change of the current before it; an instant in the past does nothing."""
    while i[QUEUE_TAIL] < i[QUEUE_HEAD]:
        slot = i[QUEUE_TAIL] & _MASK
        due_ns, due_frac = i[_DUE_NS + slot], f[_DUE_FRAC + slot]
        if (due_ns - ns) + (due_frac - frac) > 0.0:
            break
        dt = (due_ns - i[TIME_NS]) + (due_frac - f[TIME_FRAC])
        if dt > 0.0:
            _move(f, i, dt / _NS_PER_SECOND)
            i[TIME_NS] = due_ns
            f[TIME_FRAC] = due_frac
        _take_effect(f, f[_DUE_CURRENT + slot])
        i[QUEUE_TAIL] += 1
    dt = (ns - i[TIME_NS]) + (frac - f[TIME_FRAC])
    if dt > 0.0:
        _move(f, i, dt / _NS_PER_SECOND)
        i[TIME_NS] = ns
        f[TIME_FRAC] = frac


@njit("void(float64[::1], int64[::1], int64, float64, float64)", inline=True, counted=False)
def plant_current(f: NDArray[Any], i: NDArray[Any], ns: int, frac: float, current: float) -> None:
    """Queue a current (A) for the motor: quantised by the DAC, limited, effective T_A later.

    Use it with 0 A to switch the amplifier off, because no link can lose it.

    Commands take effect in the order in which they were given. One that should already act takes effect when
    the shaft next moves; NaN is zero current.
    """
    if math.isnan(current):
        current = 0.0
    if f[DAC_STEP] > 0.0:
        current, _ = quantise_current(current, f[DAC_STEP], i[DAC_MAX_CODE])
    current = delivered(f[DEVICE:_STATE], min(max(current, -f[SATURATION]), f[SATURATION]))
    head = i[QUEUE_HEAD]
    if f[LAG_NS] == 0.0 and head == i[QUEUE_TAIL]:
        plant_advance(f, i, ns, frac)
        _take_effect(f, current)
        return
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


@njit("void(float64[::1], int64[::1], int64, float64, float64)", inline=True, counted=False)
def plant_command(f: NDArray[Any], i: NDArray[Any], ns: int, frac: float, current: float) -> None:
    """Command a current (A) at an instant, over a link that may lose it; otherwise as :func:`plant_current`."""
    if f[DEVICE + _LOSS] > 0.0:
        i[LINK], draw = next_uniform(i[LINK])
        if _is_lost(draw, f[DEVICE + _LOSS]):
            return
    plant_current(f, i, ns, frac, current)


@njit("UniTuple(int64, 2)(float64[::1], int64[::1])", counted=False)
def plant_next_switch(f: NDArray[Any], i: NDArray[Any]) -> tuple[int, int]:
    """Instant (whole ns, rounded up) at which the next waiting command takes effect, and number waiting; 0, 0 for none."""
    waiting = i[QUEUE_HEAD] - i[QUEUE_TAIL]
    if waiting == 0:
        return 0, 0
    slot = i[QUEUE_TAIL] & _MASK
    due = i[_DUE_NS + slot]
    return due + 1 if f[_DUE_FRAC + slot] > 0.0 else due, waiting


@njit("int64(float64[::1], int64[::1])", inline=True, counted=False)
def plant_counts(f: NDArray[Any], i: NDArray[Any]) -> int:
    """The encoder's count: ⌊x/δ⌋, negated if it is inverted.

    Because the floor and not the position is negated, a loop that inverts the sign again gets the same counts. The count
    is limited to ±2⁶², and is −2⁶² for NaN: a jump that no loop takes for a motion.
    """
    level = np.floor(measured(f[DEVICE:_STATE], f[POSITION]) / f[RAW_RESOLUTION])
    if level > _COUNT_LIMIT:
        level = _COUNT_LIMIT
    elif not level >= -_COUNT_LIMIT:
        level = -_COUNT_LIMIT
    counts = int(level)
    return -counts if i[INVERT] != 0 else counts


@njit("boolean(float64[::1], int64[::1])", counted=False)
def plant_stays(f: NDArray[Any], i: NDArray[Any]) -> bool:
    """Whether the shaft is at rest and stiction holds it while the current is constant."""
    if i[HAS_EFFECT_TERMS] != 0:
        f[DEVICE + _EXTERNAL] = f[HAND_FORCE]
        f[_STATE + effects.THETA], f[_STATE + effects.OMEGA] = f[POSITION], f[VELOCITY]
        return stays_with_effects(f[DEVICE:_STATE], f[_STATE:_SPAN], f[AGE], f[AIM])
    current, swing = f[CURRENT], 0.0
    if f[NATURAL] > 0.0:
        current, swing = f[AIM], f[TORQUE_CONSTANT] * math.hypot(f[CURRENT] - f[AIM], f[CURRENT_RATE])
    force = current * f[TORQUE_CONSTANT] + f[HAND_FORCE] + f[BIAS] - f[STIFFNESS] * (f[POSITION] - f[HAND_REST])
    return f[VELOCITY] == 0.0 and abs(force) + swing <= f[COULOMB]
