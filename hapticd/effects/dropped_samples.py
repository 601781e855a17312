"""A command is lost at random, and the last one stays."""

from __future__ import annotations

from hapticd.effects.parameters import NUMBER
from hapticd.effects.spec import Effect, Notes, Parameter


def is_lost(draw: float, p: float) -> bool:
    """Whether the link loses a command, for a random number uniform in [-1, 1)."""
    return 0.5 * (draw + 1.0) < p


EFFECT = Effect(
    slug="dropped_samples",
    summary="The command of a tick is lost with probability p; the last one stays.",
    law="u_k = u_(k−1) with probability p, independently each tick",
    parameters=(Parameter("p", *NUMBER, neutral=0.0, lower=0.0, upper=0.99, required=True),),
    acts_on="timing",
    source="Packet loss with hold-last-sample: Schenato 2009.",
    where_it_shows="Single ticks, at random, with a residual of K_t (u_k − u_{k−1}); none in the others.",
    example="p: 0.02",
    notes=Notes(
        told_apart="`transport_delay` acts in every tick.",
        shown_by="commands that change much from tick to tick.",
        simulated="Closed form.",
    ),
    grid=lambda scale: [{"p": 0.03}, {"p": 0.15}],
    near=("transport_delay",),
    accuracy=8e-2,  # bias of p in the filter, which approximates lost commands by a normal distribution
)
