"""The current acts later: i(t − T_d)."""

from __future__ import annotations

from hapticd.plant.effects.spec import EffectSpec, parameters_of

EFFECT = EffectSpec(
    slug="transport_delay",
    summary="The command takes longer to reach the motor than the model says.",
    law="i(t) → i(t − t_d)",
    parameters=parameters_of("transport_delay"),
    source="Bus cycles, buffered converters and drive firmware.",
    where_it_shows="Residuals after every change of the command, proportional to the change; the loop loses phase.",
    near=("amplifier_lag",),
    exact=True,
)
