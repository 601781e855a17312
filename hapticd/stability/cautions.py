"""Warnings: what the theory leaves out of a configuration, or what disturbs its prediction."""

from __future__ import annotations

import math
from collections.abc import Iterator

from drivers import declared_step, max_rate
from hapticd.config import Config
from hapticd.effects.catalogue import CATALOGUE
from hapticd.plant.amplifier import converter_grid
from hapticd.stability.criterion import sampling_bound_ok, sampling_ratio
from hapticd.stability.numbers import Loop

FEW_COUNTS = 4.0
"""The encoder hardly resolves a speed limit of fewer counts per period."""


def cautions(config: Config, loop: Loop, xi_dot_max: float | None, deflection: float | None) -> tuple[str, ...]:
    """Warnings, each a sentence with the numbers behind it.

    Args:
        config: the configuration. loop: the same in SI units, with the driver's latency.
        xi_dot_max: velocity bound of the motion in ticks per period. deflection: where it is released, in ticks.
    """
    found = [*_outside_the_theory(config), *_interface(config, loop)]
    if loop.stiffness > 0.0:
        found += [*_theory(loop), *_motion(config, loop, xi_dot_max, deflection)]
    return tuple(found)


def uncounted(config: Config) -> tuple[str, ...]:
    """Effects of the plant that the theory leaves out. The loop's numbers contain the worst case of the others."""
    return tuple(listed.name for listed in config.plant.effects if CATALOGUE[listed.name].in_loop is None)


def _outside_the_theory(config: Config) -> Iterator[str]:
    spring = config.spring
    if spring.stiffness == 0.0 and spring.damping == 0.0:
        yield "spring.stiffness is 0: no spring is rendered, nothing can become unstable"
    if spring.side != "both":
        yield (
            f"spring.side is {spring.side}: if no theorem proves a motion on this wall, the region is that of a two-sided "
            "spring"
        )
    if left_out := uncounted(config):
        yield f"plant.effects ({', '.join(left_out)}) are outside the theory; 'hapticd simulate' includes them"


def _interface(config: Config, loop: Loop) -> Iterator[str]:
    limit, reason = max_rate(config)
    if config.servo.rate_hz > limit:
        yield f"servo.rate_hz is {config.servo.rate_hz:g} Hz, but {reason}"
    speed, unit = config.safety.max_velocity, "m/s" if config.is_linear else "rad/s"
    if speed and speed < FEW_COUNTS * config.count_speed:
        yield (
            f"safety.max_velocity = {speed:g} {unit} is {speed / config.count_speed:.3g} counts per period, and one count "
            f"per period is {config.count_speed:.3g} {unit}: the trip allows for one count, so near the limit it comes late "
            "or never; use a finer encoder, a slower servo or a higher limit"
        )
    amplifier = config.amplifier
    converter, own = converter_grid(amplifier.dac_bits, amplifier.dac_full_scale)[0], declared_step(config)
    if loop.stiffness > 0.0:
        step = max(converter, own) * amplifier.torque_constant
        if step > loop.scales.force:
            unit = "N" if config.is_linear else "N m"
            of = f"the {amplifier.dac_bits}-bit converter" if converter >= own else f"driver {config.driver.name}"
            yield (
                f"one step of {of} is {step:.3g} {unit}, more than the "
                f"{loop.scales.force:.3g} {unit} of one encoder tick: the command is coarser than the encoder, and Coulomb "
                f"friction must hold {loop.numbers.quantum:.3g} ticks"
            )
    if config.dither.target != "none":
        yield f"dither is on: Coulomb friction must hold {loop.numbers.quantum:.3g} ticks of force instead of ½"


def _theory(loop: Loop) -> Iterator[str]:
    n = loop.numbers
    if not sampling_bound_ok(n):
        yield (
            f"the sampling bound (11) is violated: the servo samples only {sampling_ratio(n):.3g} times as fast as twice "
            f"the spring's own oscillation (μ = {n.mu:.3g}, should be at least 1); sample faster or make the spring softer"
        )


def _motion(config: Config, loop: Loop, xi_dot_max: float | None, deflection: float | None) -> Iterator[str]:
    scales, safety, linear = loop.scales, config.safety, config.is_linear
    speed_unit, unit = ("m/s", "m") if linear else ("rad/s", "rad")
    if xi_dot_max is not None and safety.max_velocity:
        speed = float(scales.xi_dot_to_velocity(xi_dot_max))
        if speed > safety.max_velocity:
            yield (
                f"this motion reaches {speed:.3g} {speed_unit}: the daemon would trip on safety.max_velocity = "
                f"{safety.max_velocity:g} {speed_unit}"
            )
    if deflection is None:
        return
    displacement = abs(float(scales.xi_to_position(deflection)))
    if safety.max_excursion and displacement > safety.max_excursion:
        yield f"the deflection is {displacement:.3g} {unit}, beyond safety.max_excursion = {safety.max_excursion:g} {unit}"
    pull = abs(math.floor(deflection) + 0.5) * scales.force + loop.hand_stiffness * displacement
    if pull <= loop.coulomb:
        yield (
            f"a release from {deflection:g} ticks does not move at all: the spring pulls with "
            f"{abs(math.floor(deflection) + 0.5):g} ticks of force, and Coulomb friction holds {loop.numbers.sigma:.4g}"
        )
    amplifier = config.amplifier
    limits = [amplifier.peak_current or math.inf]
    if amplifier.dac_bits and amplifier.dac_full_scale:
        limits.append(amplifier.dac_full_scale)
    current = abs(math.floor(deflection) + 0.5) * scales.force / amplifier.torque_constant
    if current > min(limits):
        yield (
            f"the spring needs {current:.3g} A there, but the amplifier's limit is {min(limits):g} A: the force is smaller "
            "than in the theory"
        )
