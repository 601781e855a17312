"""An effect from outside that changes friction and is counted in theory, for the tests."""

from __future__ import annotations

import math

from hapticd.effects import Effect, Parameter, relative


def friction(speed: float, torque: float, time: float, a: float, t_d: float, v: float) -> float:
    return a * 2.0e-3 * (1.0 - math.exp(-time / t_d)) * math.exp(-speed / v)


EFFECT = Effect(
    slug="drying_grease",
    summary="Grease dries.",
    law="c → c + a 2 mN m (1 − exp(−t/t_d)) exp(−|ω|/v)",
    parameters=(
        relative("a", 0.0, 10.0),
        Parameter("t_d", "s", "s", neutral=1.0, lower=1e-3, upper=1e6, scale="log"),
        Parameter("v", "rad/s", "m/s", neutral=10.0, lower=1e-3, upper=1e6, scale="log"),
    ),
    acts_on="friction",
    source="Made up.",
    where_it_shows="Friction that grows.",
    example="a: 0.5",
    equivalent_to=("thermal_drift",),
    in_loop=lambda loop, values: {"coulomb": loop.coulomb * (1.0 + 0.0 * values["t_d"])},
    damping=lambda values: float(values["a"]) * 2.0e-3 / float(values["v"]),
    friction=friction,
)

NOT_AN_EFFECT = 24


def with_nothing(**changes: object) -> Effect:
    fields = {name: getattr(EFFECT, name) for name in EFFECT.__dataclass_fields__}
    return Effect(**{**fields, "equivalent_to": (), **changes})


NAMELESS_RELATION = with_nothing(slug="nameless_relation", near=("nobody",))
LAWLESS = with_nothing(slug="lawless", friction=None)
MISPLACED = with_nothing(slug="misplaced", acts_on="input")
SHORT = with_nothing(slug="short", friction=lambda speed, torque, time: 0.0)
CLASH = with_nothing(slug="stribeck")
LENGTHY = with_nothing(slug="lengthy", parameters=(Parameter("a", "", "", 0.0, 0.0, 1.0, length=57),))
UNCOMPILABLE = with_nothing(slug="uncompilable", friction=lambda speed, torque, time, a, t_d, v: str(speed).upper())
