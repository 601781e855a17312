"""The current acts later: i(t − T_d)."""

from __future__ import annotations

from hapticd.effects.parameters import magnitude
from hapticd.effects.spec import Effect, Notes

EFFECT = Effect(
    slug="transport_delay",
    summary="The command takes longer to reach the motor than the model says.",
    law="i(t) → i(t − t_d)",
    parameters=(magnitude("t_d", ("s", "s"), 1.0),),
    acts_on="timing",
    source="Bus cycles, buffered converters and drive firmware.",
    where_it_shows=(
        "After every change of the command the shaft follows late by the same time: the error is the change times t_d. "
        "Loops ring or grow that should not."
    ),
    example="t_d: 5.0e-4",
    notes=Notes(
        told_apart=(
            "`amplifier_lag` at low frequency is a delay of delta / (π f_a); it differs in the shape of the first "
            "fraction of a millisecond, and when it rings."
        ),
        shown_by="steps, and a chirp up to a large part of the servo rate, with a fine encoder.",
        simulated="Closed form.",
    ),
    grid=lambda scale: [{"t_d": periods * scale.period_s} for periods in (0.3, 1.0, 2.0, 4.0, 8.0)],
    near=("amplifier_lag",),
    in_loop=lambda loop, values: {"delay": loop.delay + values["t_d"]},
)
