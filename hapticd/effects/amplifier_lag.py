"""A second-order current loop behind the base model's delay."""

from __future__ import annotations

import math

from hapticd.effects.parameters import NUMBER
from hapticd.effects.spec import Effect, Notes, Parameter

EFFECT = Effect(
    slug="amplifier_lag",
    summary=("The amplifier's current loop has a finite bandwidth, in addition to the base model's delay T_A."),
    law="i'' = (2π f_a)² (u − i) − 2 delta (2π f_a) i', u the current of the base model",
    parameters=(
        Parameter("f_a", "Hz", "Hz", neutral=math.inf, lower=1.0, upper=1e6, scale="log", required=True),
        Parameter("delta", *NUMBER, neutral=0.7, lower=0.01, upper=10.0, scale="log"),
    ),
    acts_on="timing",
    source="A second-order current loop, which the base model approximates by the delay T_A = 2 δ/ω (eq. 5).",
    where_it_shows=(
        "After every change of the command the current rises gradually, with delta < 0.7 beyond its goal and back, within "
        "a few 1/f_a; slow commands are late by delta / (π f_a). A first-order lag of time constant τ is a large delta "
        "with delta / (π f_a) = τ."
    ),
    example="f_a: 250",
    notes=Notes(
        told_apart=(
            "`transport_delay` is the same at low frequency. `flexible_coupling` rings at a frequency of the mechanics, "
            "also when the current does not change."
        ),
        shown_by="steps and a chirp beyond f_a as far as the servo rate allows.",
        in_theory="As the delay T_A = 2 δ/ω (5); explored exactly, without a proof.",
        simulated="The current loop is exact; with effects that have terms, the torque is its mean over each substep.",
    ),
    grid=lambda scale: [{"f_a": share / scale.period_s, "delta": 0.7} for share in (0.01, 0.03, 0.08, 0.2)],
    near=("transport_delay",),
    # a lag is not a delay: the proof for a delay does not hold for it
    in_loop_exact=False,
    in_loop=lambda loop, values: {"delay": loop.delay + values["delta"] / (math.pi * values["f_a"])},
)
