"""A loop with everything that the servo renders as one record; its commands and its energy; from a configuration."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from hapticd.jit import njit
from hapticd.plant.amplifier import converter_grid
from hapticd.plant.lagged import overshoot
from hapticd.stability._current_loop import current_loop
from hapticd.stability._damped import sprung
from hapticd.stability.damping import passive_viscous, velocity_filter
from hapticd.stability.numbers import Dimensionless, Loop
from hapticd.stability.outcome import STRETCHES

if TYPE_CHECKING:
    from hapticd.config import Config

#: Position in ticks at which a run ends as growing, if growth was not proven before.
LIMIT: Final = 1e9

#: A loop and the start of its motion; neutral values: `blank`.
LOOP: Final = np.dtype(
    [
        ("mu", "f8"),
        ("beta", "f8"),
        ("sigma", "f8"),
        ("tau_d", "f8"),
        ("kappa", "f8"),
        ("bias", "f8"),  # ½, or 0 without the half tick
        ("side", "f8"),  # of a wall: 1 positive, −1 negative; 0 for both
        ("beta_v", "f8"),  # virtual damping B/(KT)
        ("periods", "i8"),  # over which the damper takes its difference
        ("keep", "f8"),  # decay of its low-pass per period; 0 for the plain difference
        ("waveform", "i8"),  # of the dither, an index into `WAVEFORMS`
        ("position_dither", "f8"),  # its peak in ticks
        ("force_dither", "f8"),  # its peak in ticks of force
        ("turns", "f8"),  # change of its phase per period
        ("phase", "f8"),  # at the start, turns
        ("seed", "i8"),
        ("grain", "i8"),  # counts per tick, for position dither
        ("step", "f8"),  # of the converter, ticks of force; 0 for none
        ("codes", "f8"),  # its largest code
        ("clip", "f8"),  # largest force, ticks
        ("natural", "f8"),  # ω of a current loop behind τ_D, rad per period; 0 for none
        ("ratio", "f8"),  # its damping ratio δ
        ("counts", "i8"),  # per tick, for the passivity controller; 0 for no controller
        ("stiffest", "f8"),  # its α T in units of K
        ("force_limit", "f8"),  # limit of the sum with its force, ticks of force
        ("ticks", "?"),  # whether the position is quantised
        ("xi", "f8"),  # initial position, ticks
        ("xi_dot", "f8"),  # initial velocity, ticks per period
        ("known", "?"),  # whether the servo has run before, at the constant velocity `past`, ticks per period
        ("past", "f8"),
        ("far", "f8"),  # position at which a run ends as growing, ticks
        ("search", "i8"),  # first window of a search, periods; 0: it ends only at rest, `far` and the horizon
    ],
    align=True,
)
WAVEFORMS: Final = ("none", "sine", "triangle", "square", "uniform")
UNIFORM: Final = WAVEFORMS.index("uniform")

#: Result of a run. ``outcome`` is an index into `OUTCOMES`, ``reason`` one of `hapticd.stability.sampled_loop`. ``cycle``:
#: periods after which it recurs, 0 if not found. ``amplitude`` (ticks, half of peak to peak, turning points located
#: exactly) and ``omega`` (rad per period, π times the mean number of reversals) are of one cycle if it recurs, of the last
#: window of a search that settles, else of the last twelfth of the horizon; 0 at rest, an infinite amplitude where it grows.
RUN: Final = np.dtype(
    [
        ("outcome", "i8"),
        ("reason", "i8"),
        ("periods", "i8"),
        ("cycle", "i8"),
        ("rose", "?"),
        ("xi", "f8"),
        ("xi_dot", "f8"),
        ("amplitude", "f8"),
        ("omega", "f8"),
        ("centre", "f8"),  # ticks, middle of its range
        ("lean", "f8"),  # mean force, ticks: not 0 if the halves of a cycle differ in length
        ("added", "f8"),  # largest force that the passivity controller added, ticks
        ("largest", "f8"),  # largest force requested, ticks
        ("peaks", "f8", STRETCHES),
    ],
    align=True,
)

_SIDES: Final = {"both": 0.0, "positive": 1.0, "negative": -1.0}


def blank(shape: int | tuple[int, ...]) -> NDArray[Any]:
    """Loops of eq. 2 and nothing else, of `LOOP`; μ, β, σ, τ_D, κ and the start are 0."""
    loops = np.zeros(shape, LOOP)
    loops["bias"], loops["periods"], loops["grain"], loops["ticks"] = 0.5, 1, 1, True
    loops["clip"], loops["force_limit"], loops["far"] = np.inf, np.inf, LIMIT
    return loops


@njit(inline=True)
def energy(x: float, v: float, mu: float) -> float:
    """H_T (35) in units of KΔ²."""
    tick = math.floor(x)
    return 0.5 * mu * v * v + (0.5 * tick * tick + (tick + 0.5) * (x - tick))


@njit(inline=True)
def stored(ticks: bool, mu: float, kappa: float, x: float, v: float) -> float:
    """Energy of a state in KΔ², with that of a hand's stiffness; without ticks the spring's is ½ξ²."""
    own = energy(x, v, mu) if ticks else 0.5 * (mu * v * v + x * x)
    return own + 0.5 * kappa * x * x if kappa > 0.0 else own


@njit(inline=True)
def wave(waveform: int, phase: float) -> float:
    """Sine, triangle or square of unit peak at ``phase`` turns, 0 ≤ phase < 1, rising from 0 (square: +1 first)."""
    if waveform == 1:
        return math.sin(2.0 * math.pi * phase)
    if waveform == 2:
        quarter = phase + 0.25
        return 1.0 - 4.0 * abs(quarter - math.floor(quarter) - 0.5)
    return 1.0 if phase < 0.5 else -1.0


@njit(inline=True)
def read(loop: Any, x: float, dither: float) -> float:
    """Position that the spring uses: the tick, with position dither the tick of count plus dither."""
    if loop.position_dither > 0.0:
        return float(math.floor(math.floor(x * loop.grain) / loop.grain + loop.position_dither * dither))
    return float(math.floor(x)) if loop.ticks else x


@njit(inline=True)
def asked(loop: Any, read: float, velocity: float) -> float:
    """Force of spring and damper for a position and a velocity, in ticks; a wall does not pull."""
    force = -(read + loop.bias) - loop.beta_v * velocity if loop.ticks else -read - loop.beta_v * velocity
    if (loop.side > 0.0 and (read < 0.0 or force > 0.0)) or (loop.side < 0.0 and (read >= 0.0 or force < 0.0)):
        return 0.0
    return float(force)


@njit(inline=True)
def delivered(loop: Any, force: float) -> float:
    """The force after converter and saturation, in ticks."""
    force = max(-loop.clip, min(loop.clip, force))
    if loop.step > 0.0:
        force = loop.step * max(-loop.codes - 1.0, min(loop.codes, np.rint(force / loop.step)))
        force = max(-loop.clip, min(loop.clip, force))
    return float(force)


@njit(inline=True)
def stays(loop: Any, x: float, force: float) -> bool:
    """Whether stiction holds a mass at rest at x, under this force and every force that dither can make of it."""
    low = delivered(loop, asked(loop, read(loop, x, 1.0), 0.0) - loop.force_dither)
    high = delivered(loop, asked(loop, read(loop, x, -1.0), 0.0) + loop.force_dither)
    pull, sigma = loop.kappa * x, loop.sigma
    if loop.natural > 0.0 and low != high:
        beyond = 0.5 * (high - low) * (overshoot(loop.ratio) - 1.0)
        low, high = low - beyond, high + beyond
    return bool(abs(low - pull) <= sigma and abs(high - pull) <= sigma and abs(force - pull) <= sigma)


#: Fields that are neutral in a bare loop; `periods`, `keep` and `seed` are then not used.
_NEUTRAL: Final = ("kappa", "side", "beta_v", "position_dither", "force_dither", "step", "counts", "natural")


def is_bare(loops: NDArray[Any]) -> NDArray[np.bool_]:
    """Whether each loop (n,) is the spring of eq. 7–9 and nothing else."""
    bare = loops["ticks"] & (loops["bias"] == 0.5) & np.isinf(loops["clip"])
    for name in _NEUTRAL:
        bare = bare & (loops[name] == 0)
    return np.asarray(bare)


def bare_loop(numbers: Dimensionless) -> NDArray[Any]:
    """The spring of eq. 2 at an operating point, at rest at its origin; (1,) of `LOOP`."""
    loop = blank(1)
    for name in ("mu", "beta", "sigma", "tau_d", "kappa"):
        loop[name] = getattr(numbers, name)
    return loop


def record_of(config: Config, loop: Loop) -> NDArray[Any]:
    """The loop of a configuration, at rest at its origin; (1,) of `LOOP`."""
    loop = sprung(loop)
    numbers, scales, spring, dither = loop.numbers, loop.scales, config.spring, config.dither
    amplifier = config.amplifier
    per_ampere = amplifier.torque_constant / scales.force
    record = bare_loop(numbers)
    record["tau_d"], record["natural"], record["ratio"] = current_loop(config, loop)
    record["bias"] = 0.5 if spring.half_tick_bias else 0.0
    record["side"] = _SIDES[spring.side]
    record["beta_v"] = loop.damping / (loop.stiffness * loop.period)
    if loop.damping > 0.0:
        record["periods"], record["keep"] = velocity_filter(spring, loop.period)
    record["grain"] = config.encoder.decimation
    if dither.target != "none" and dither.amplitude > 0.0:
        record["waveform"], record["seed"] = WAVEFORMS.index(dither.waveform), dither.seed
        record["turns"] = dither.frequency_hz * loop.period
        if dither.target == "position":
            record["position_dither"] = dither.amplitude
        else:
            record["force_dither"] = dither.amplitude * per_ampere
    step, codes = converter_grid(amplifier.dac_bits, amplifier.dac_full_scale)
    record["step"], record["codes"] = step * per_ampere, codes
    record["clip"] = amplifier.peak_current * per_ampere if amplifier.peak_current else np.inf
    if config.safety.passivity == "control":
        record["counts"] = config.encoder.decimation
        record["stiffest"] = 2.0 * passive_viscous(config) / (loop.stiffness * loop.period)
        record["force_limit"] = record["clip"]
    return record
