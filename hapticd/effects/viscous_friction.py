"""The viscous friction is not the model's: b → b(1 + r)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from hapticd.effects.parameters import relative
from hapticd.effects.spec import Effect, LoopNumbers, Notes, Scale, Values


def viscous(nominal: float, r: float) -> float:
    """Return the viscous friction that the device has."""
    return nominal * (1.0 + r)


def _grid(scale: Scale) -> Iterable[Values]:
    return [{"r": 0.05}]


def _reach(scale: Scale) -> float:
    return scale.torque / (scale.viscous * scale.speeds[-1])


def _in_loop(loop: LoopNumbers, values: Values) -> Mapping[str, float]:
    return {"viscous": viscous(loop.viscous, values["r"])}


EFFECT = Effect(
    slug="viscous_friction",
    summary="The viscous friction differs from the model's.",
    law="b → b (1 + r)",
    parameters=(relative("r", -1.0, 20.0),),
    acts_on="base",
    source="Eq. 1.",
    where_it_shows="A residual torque proportional to velocity.",
    example="r: 3",
    notes=Notes(
        in_data=(
            "A residual torque proportional to velocity: constant-current runs settle at another speed, or decay at "
            "another rate."
        ),
        told_apart=(
            "`quadratic_drag` bends over speed; `asymmetric_viscous` differs between the directions. One speed alone "
            "tells none of them apart."
        ),
        shown_by="steady motion at several speeds in both directions.",
        simulated="Closed form.",
    ),
    amplitude="r",
    reach=_reach,
    grid=_grid,
    near=("quadratic_drag", "asymmetric_viscous"),
    in_loop=_in_loop,
)
