"""The numbers of one axis."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Numbers:
    """An axis in SI units: rad, N m, kg m² of a rotary one; m, N, kg of a linear one. What is not given is not there."""

    inertia: float
    """Of all that moves."""
    torque_constant: float
    """Torque or force per ampere."""
    viscous: float = 0.0
    viscous_asymmetry: float = 0.0
    """a of b (1 + a sgn(v))."""
    damping: float = 0.0
    """Of a hand that holds on all the time."""
    coulomb: float = 0.0
    """Friction in motion, and what holds the axis at rest."""
    stribeck_share: float = 0.0
    """s of c (1 + s exp(−(v/v_s)²))."""
    stribeck_speed: float = 1.0
    load_friction: float = 0.0
    """Share of the motor's torque that is Coulomb friction besides."""
    drag: float = 0.0
    """d of −d v|v|; d < 0 lowers the rest of the friction, and never pushes."""
    warming: float = 0.0
    """r of c (1 + r (1 − exp(−t/t_w)))."""
    warming_time_s: float = 1.0
    breakaway: float = 0.0
    """Way over which friction is elastic before it slides (LuGre); 0: stiction."""
    bristle_damping: float = 0.0
    bias: float = 0.0
    """Constant torque."""
    stiffness: float = 0.0
    rest: float = 0.0
    """Where the spring is relaxed."""
    gravity: float = 0.0
    """m g l of −m g l sin(x − rest)."""
    gravity_rest: float = 0.0
    ripple: tuple[tuple[float, float, float], ...] = ()
    """Order, amplitude and phase of each wave of the torque over the position."""
    ripple_proportion: float = 0.0
    """Part of the ripple that is in proportion to the current in A."""
    hand_inertia: float = 0.0
    hand_damping: float = 0.0
    hand_stiffness: float = 0.0
    hand_rest: float = 0.0
    hand_on_s: float = 0.0
    hand_off_s: float = math.inf
    """A hand that holds the axis for some time."""
    load_inertia: float = 0.0
    """Part of the inertia that is behind a play or a coupling."""
    play: float = 0.0
    """Whole width of the play between motor and load."""
    restitution: float = 0.0
    """Speed at which the two part, in that at which they met."""
    coupling_stiffness: float = 0.0
    coupling_damping: float = 0.0
    delay_s: float = 0.0
    """From a command to the current, or to the current loop."""
    lag_hz: float = math.inf
    """Natural frequency of the current loop."""
    lag_ratio: float = 0.7
    """Its damping ratio."""
    dac_step: float = 0.0
    """Of the converter, A; 0: ideal."""
    dac_codes: int = 0
    """Its largest code."""
    command_step: float = 0.0
    """Of another grid that the command passes, A."""
    current_limit: float = math.inf
    """Largest current, A."""
    lost: float = 0.0
    """Probability that a command is lost and the last one stays."""
    eccentricity: float = 0.0
    """e of the measured position x + e sin(x + phase)."""
    eccentricity_phase: float = 0.0
    resolution: float = 0.0
    """Position of one encoder count; 0: none is known."""
    counts_backwards: bool = False
    longest_part_s: float = 1e-4
    """Into parts no longer than this a step is divided."""
