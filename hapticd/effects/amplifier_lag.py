"""A second-order current loop behind the base model's delay."""

from __future__ import annotations

import math

from hapticd.effects.parameters import NUMBER
from hapticd.effects.spec import Effect, Notes, Parameter

EFFECT = Effect(
    slug="amplifier_lag",
    summary=(
        "The amplifier's current loop has a bandwidth of its own, behind the base model's delay T_A, which stays."
    ),
    law="i'' = (2π f_a)² (u − i) − 2 delta (2π f_a) i', u the current of the base model",
    parameters=(
        Parameter("f_a", "Hz", "Hz", neutral=math.inf, lower=1.0, upper=1e6, scale="log", required=True),
        Parameter("delta", *NUMBER, neutral=0.7, lower=0.01, upper=10.0, scale="log"),
    ),
    acts_on="timing",
    source="A current loop of second order, which the base model takes as the delay T_A = 2 δ/ω (eq. 5).",
    where_it_shows=(
        "Residuals after every change of the command that fade, or ring, within a few 1/f_a; a first-order lag of "
        "time constant τ is delta large with delta / (π f_a) = τ."
    ),
    example="f_a: 250",
    notes=Notes(
        in_data=(
            "After every change of the command the current comes gradually, with delta < 0.7 past its goal and back; slow "
            "commands come late by delta / (π f_a)."
        ),
        told_apart=(
            "`transport_delay` is the same at low frequency. `flexible_coupling` rings at a frequency of the mechanics, "
            "also when the current does not change."
        ),
        shown_by="steps and a chirp beyond f_a as far as the servo rate allows.",
        in_theory="As the amplifier itself: T_A = 2 δ/ω (5); explored as it is, proven not.",
        simulated="The current loop is exact; beside effects with terms the torque is its mean over each substep.",
    ),
    grid=lambda scale: [{"f_a": share / scale.period_s, "delta": 0.7} for share in (0.01, 0.03, 0.08, 0.2)],
    near=("transport_delay",),
    # a lag is not a delay: what is proven of the one does not hold for the other
    in_loop_exact=False,
    in_loop=lambda loop, values: {"delay": loop.delay + values["delta"] / (math.pi * values["f_a"])},
)
