"""Checks that need more than one key of a configuration."""

from __future__ import annotations

from collections.abc import Iterator
from math import pi

from hapticd.config.problems import Finding
from hapticd.config.sections import Amplifier, Dither, Encoder, Safety, Servo, Spring

MAX_LAG_PERIODS = 4000
"""Capacity of the plant's queue of delayed commands [periods]."""

MAX_ORIGIN_COUNTS = 2**53
"""Counts up to here are exact in double precision."""


def cross_findings(
    servo: Servo, spring: Spring, encoder: Encoder, dither: Dither, amplifier: Amplifier, safety: Safety
) -> Iterator[Finding]:
    """Contradictions between keys that are each valid on their own."""
    yield from _origin(spring, encoder)
    yield from _dither(dither, servo, amplifier)
    yield from _velocity(spring, servo)
    yield from _current(amplifier)
    yield from _lag(amplifier, servo)
    yield from _clock(servo, safety)


def _clock(servo: Servo, safety: Safety) -> Iterator[Finding]:
    if servo.clock == "sync" and safety.missed_exchanges is None:
        message = (
            "must be a number with servo.clock = sync: otherwise a producer that stops would cause no tick and no fault"
        )
        involves = frozenset({"servo.clock", "safety.missed_exchanges"})
        yield Finding("safety.missed_exchanges", None, message, involves=involves)


def _origin(spring: Spring, encoder: Encoder) -> Iterator[Finding]:
    counts = abs(spring.origin) / encoder.raw_resolution
    if counts > MAX_ORIGIN_COUNTS:
        message = f"is {counts:.3g} encoder counts from zero; must be at most {MAX_ORIGIN_COUNTS:.3g}"
        involves = frozenset({"spring.origin", "encoder.counts_per_rev", "encoder.counts_per_metre"})
        yield Finding("spring.origin", spring.origin, message, MAX_ORIGIN_COUNTS, involves=involves)


def _dither(dither: Dither, servo: Servo, amplifier: Amplifier) -> Iterator[Finding]:
    if dither.target == "none":
        return
    involves = frozenset({"dither.target", "dither.waveform", "dither.frequency_hz", "servo.rate_hz"})
    nyquist = servo.rate_hz / 2
    if dither.waveform != "uniform":
        if dither.frequency_hz == 0:
            message = f"must be above 0 Hz for a {dither.waveform} dither"
            yield Finding("dither.frequency_hz", 0.0, message, 0.0, involves=involves)
        elif dither.frequency_hz >= nyquist:
            message = f"must be below {nyquist:.6g} Hz, half of servo.rate_hz"
            yield Finding("dither.frequency_hz", dither.frequency_hz, message, nyquist, involves=involves)
    peak = amplifier.peak_current
    if dither.target == "current" and peak is not None and dither.amplitude > peak:
        message = f"must be at most {peak:.6g} A, amplifier.peak_current"
        involves = frozenset({"dither.target", "dither.amplitude", "amplifier.peak_current"})
        yield Finding("dither.amplitude", dither.amplitude, message, peak, involves=involves)


def _velocity(spring: Spring, servo: Servo) -> Iterator[Finding]:
    nyquist = servo.rate_hz / 2
    if spring.damping and spring.velocity_estimate == "low_pass" and spring.velocity_cutoff_hz >= nyquist:
        message = f"must be below {nyquist:.6g} Hz, half of servo.rate_hz"
        involves = frozenset(
            {"spring.damping", "spring.velocity_estimate", "spring.velocity_cutoff_hz", "servo.rate_hz"}
        )
        yield Finding("spring.velocity_cutoff_hz", spring.velocity_cutoff_hz, message, nyquist, involves=involves)


def _current(amplifier: Amplifier) -> Iterator[Finding]:
    continuous, peak = amplifier.continuous_current, amplifier.peak_current
    if continuous is not None and peak is not None and peak < continuous:
        message = f"must be at least {continuous:.6g} A, amplifier.continuous_current"
        involves = frozenset({"amplifier.peak_current", "amplifier.continuous_current"})
        yield Finding("amplifier.peak_current", peak, message, continuous, involves=involves)
    if amplifier.dac_bits > 0 and amplifier.dac_full_scale == 0:
        message = f"must be above 0 A when amplifier.dac_bits is {amplifier.dac_bits}"
        involves = frozenset({"amplifier.dac_bits", "amplifier.dac_full_scale"})
        yield Finding("amplifier.dac_full_scale", 0.0, message, 0.0, involves=involves)


def _lag(amplifier: Amplifier, servo: Servo) -> Iterator[Finding]:
    periods = amplifier.delay * servo.rate_hz
    if periods > MAX_LAG_PERIODS:
        slowest = amplifier.damping_ratio * servo.rate_hz / (pi * MAX_LAG_PERIODS)
        # rounded up, so that the number in the message is valid
        message = (
            f"is a lag of {periods:.6g} servo periods; must be at most {MAX_LAG_PERIODS}: "
            f"must be at least {1.001 * slowest:.4g} Hz, or 0 for no lag"
        )
        involves = frozenset({"amplifier.bandwidth_hz", "amplifier.damping_ratio", "servo.rate_hz"})
        yield Finding("amplifier.bandwidth_hz", amplifier.bandwidth_hz, message, slowest, involves=involves)
