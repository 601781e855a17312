"""A command is lost now and then, and the last one stays."""

from __future__ import annotations

from hapticd.effects.parameters import NUMBER
from hapticd.effects.spec import Effect, Notes, Parameter


def is_lost(draw: float, p: float) -> bool:
    """Whether the link loses a command for which it drew a number uniform in [-1, 1)."""
    return 0.5 * (draw + 1.0) < p


EFFECT = Effect(
    slug="dropped_samples",
    summary="The command of a tick is lost with probability p; the last one stays.",
    law="u_k = u_(k−1) with probability p, independently each tick",
    parameters=(Parameter("p", *NUMBER, neutral=0.0, lower=0.0, upper=0.99, required=True),),
    acts_on="timing",
    source="Packet loss with hold-last-sample: Schenato 2009.",
    where_it_shows="Single ticks with a residual proportional to the change of the command; none elsewhere.",
    example="p: 0.02",
    notes=Notes(
        in_data="Single ticks with a kick of K_t (u_k − u_{k−1}), at random; all others are right.",
        told_apart="`transport_delay` is there in every tick.",
        shown_by="commands that change much from tick to tick.",
        simulated="Closed form.",
    ),
    grid=lambda scale: [{"p": 0.03}, {"p": 0.15}],
    near=("transport_delay",),
    accuracy=8e-2,  # lost commands are taken as normally distributed, and seen in cells: p comes out so much too high
)
