"""A command is lost now and then, and the last one stays."""

from __future__ import annotations

from hapticd.jit import njit
from hapticd.plant.effects.spec import EffectSpec, parameters_of

EFFECT = EffectSpec(
    slug="dropped_samples",
    summary="The command of a tick is lost with probability p; the last one stays.",
    law="u_k = u_(k−1) with probability p, independently each tick",
    parameters=parameters_of("dropped_samples"),
    source="Packet loss with hold-last-sample: Schenato 2009.",
    where_it_shows="Single ticks with a residual proportional to the change of the command; none elsewhere.",
    near=("transport_delay",),
    exact=True,
)


@njit("boolean(float64, float64)", inline=True)
def is_lost(draw: float, p: float) -> bool:
    """Whether the link loses a command for which it drew a number uniform in [-1, 1)."""
    return 0.5 * (draw + 1.0) < p
