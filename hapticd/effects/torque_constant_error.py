"""The torque constant is not the model's: K_t → K_t(1 + r)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from hapticd.effects.parameters import relative
from hapticd.effects.spec import Effect, LoopNumbers, Notes, Scale, Values


def torque_constant(nominal: float, r: float) -> float:
    """Return the torque constant that the motor has."""
    return nominal * (1.0 + r)


def _grid(scale: Scale) -> Iterable[Values]:
    return [{"r": 0.05}]


def _in_loop(loop: LoopNumbers, values: Values) -> Mapping[str, float]:
    return {"stiffness": torque_constant(loop.stiffness, values["r"])}


EFFECT = Effect(
    slug="torque_constant_error",
    summary="The motor gives more or less torque per ampere than the model says.",
    law="K_t → K_t (1 + r)",
    parameters=(relative("r", -0.8, 4.0),),
    acts_on="base",
    source="Winding tolerance and magnet temperature, ±10 % on most motor data sheets.",
    where_it_shows="A residual torque proportional to the current, also at rest.",
    example="r: -0.1",
    notes=Notes(
        in_data="The residual torque is a constant share of K_t i, in motion and at breakaway.",
        told_apart=(
            "`inertia_error` leaves breakaway where it is; `load_dependent_friction` changes sign between driving and "
            "braking; `current_saturation` shows at large currents only."
        ),
        shown_by="ramps through breakaway and steps, both ways.",
        in_theory="The virtual spring is as much stiffer as the motor is stronger.",
        simulated="Closed form.",
    ),
    amplitude="r",
    grid=_grid,
    near=("inertia_error",),
    in_loop=_in_loop,
)
