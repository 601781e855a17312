"""What each format can say of each effect: exactly, approximately, or not at all; in this one place."""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Final, Literal, get_args

from hapticd.effects.catalogue import OWN_SLUGS

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

Format = Literal["mjcf", "urdf", "fmu", "python"]
FORMATS: Final[tuple[Format, ...]] = get_args(Format)
How = Literal["exact", "approximated", "refused"]


@dataclass(frozen=True)
class Saying:
    """How a format says an effect.

    Attributes:
        how: ``exact``: the law is the catalogue's; what differs is the solver's step. ``approximated``: another law that
            comes near. ``refused``: left out.
        where: the element, attribute or file that has it; "" where it is left out.
        why: what is approximated, or why it is left out; "" for an exact one.
    """

    how: How
    where: str = ""
    why: str = ""


def _exact(where: str) -> Saying:
    return Saying("exact", where)


def _near(where: str, why: str) -> Saying:
    return Saying("approximated", where, why)


def _refused(why: str) -> Saying:
    return Saying("refused", "", why)


_MODULE = "the module"
_OTHER_DRAWS = "as often, at other commands"
_ONE_FRICTION = "a joint has one Coulomb and one viscous friction"
_NO_INPUT = "what comes before the torque is the controller's"
_NO_FIELD = "a joint has no torque over its position"
_ONE_MASS = "one rigid body"

_PYTHON: Final[Mapping[str, Saying]] = {
    **dict.fromkeys(OWN_SLUGS, _exact("class Axis")),
    "dropped_samples": _near("class Axis", _OTHER_DRAWS),
}
_MJCF: Final[Mapping[str, Saying]] = {
    "inertia_error": _exact("body inertial"),
    "viscous_friction": _exact("joint damping"),
    "coulomb_friction": _exact("joint frictionloss"),
    "torque_constant_error": _exact("motor gear"),
    "asymmetric_coulomb": _exact("general biasprm"),
    "constant_bias": _exact("general biasprm"),
    "gravity": _exact("a mass off the axis; linear: " + _MODULE),
    "return_spring": _exact("joint stiffness, springref"),
    "transport_delay": _exact("motor delay, one step at least; " + _MODULE),
    "current_saturation": _exact("motor ctrlrange"),
    "backlash": _near("a second joint with a range", "the contact is a stiff spring and damper"),
    "flexible_coupling": _exact("a second joint with stiffness and damping"),
    "quadratic_drag": _exact("joint damping, second number; d < 0: " + _MODULE),
    "dropped_samples": _near(_MODULE, _OTHER_DRAWS),
    "presliding": _near(_MODULE, "the bristle is explicit; alone, stiction"),
    "amplifier_lag": _near("motor dyntype filterexact; " + _MODULE, "alone, first order"),
    **dict.fromkeys(
        (
            "asymmetric_viscous",
            "stribeck",
            "load_dependent_friction",
            "thermal_drift",
            "torque_ripple",
            "hand_impedance",
            "dac_quantization",
            "encoder_eccentricity",
        ),
        _exact(_MODULE),
    ),
}
_URDF: Final[Mapping[str, Saying]] = {
    "inertia_error": _exact("link inertial"),
    "viscous_friction": _exact("joint dynamics damping"),
    "coulomb_friction": _exact("joint dynamics friction"),
    "current_saturation": _exact("joint limit effort"),
    "torque_constant_error": _near("joint limit effort", "only the limit has it"),
    "gravity": _exact("a mass off the axis"),
    "asymmetric_viscous": _near("joint dynamics damping", "the mean of both directions"),
    "stribeck": _near("joint dynamics friction", "without the change near rest"),
    "quadratic_drag": _refused("damping is linear in the speed"),
    "thermal_drift": _near("joint dynamics friction", "that of the cold device"),
    "load_dependent_friction": _near("joint dynamics friction", "without current"),
    "presliding": _near("joint dynamics friction", "without the elastic way"),
    "asymmetric_coulomb": _refused(_ONE_FRICTION),
    "constant_bias": _refused("a joint has no constant torque"),
    "return_spring": _refused("a joint has no spring"),
    "torque_ripple": _refused(_NO_FIELD),
    "hand_impedance": _refused("nothing comes and goes in a URDF"),
    "backlash": _near("link inertial", "without play: " + _ONE_MASS),
    "flexible_coupling": _near("link inertial", "without spring: " + _ONE_MASS),
    "transport_delay": _refused(_NO_INPUT),
    "amplifier_lag": _refused(_NO_INPUT),
    "dac_quantization": _refused(_NO_INPUT),
    "dropped_samples": _refused(_NO_INPUT),
    "encoder_eccentricity": _refused("a joint's position is the true one"),
}
TABLE: Final[Mapping[Format, Mapping[str, Saying]]] = MappingProxyType(
    {"mjcf": _MJCF, "urdf": _URDF, "fmu": _PYTHON, "python": _PYTHON}
)
"""Format to slug to how it says that effect."""


def sayings(effects: Iterable[str], to: Format) -> dict[str, Saying]:
    """How a format says each of a model's effects, in their order."""
    outside = _refused("its law is of another package: call it beside the exported model")
    return {slug: TABLE[to].get(slug, outside) for slug in effects}


def markdown() -> str:
    """The table, as the documentation has it."""
    columns = {"mjcf": _MJCF, "urdf": _URDF}
    lines = [f"fmu and python have every effect **exact** ({_PYTHON['gravity'].where}), but for these:", ""]
    lines += [f"- {slug}: {said.how}: {said.why}" for slug, said in _PYTHON.items() if said.how != "exact"]
    lines += ["", "| effect | " + " | ".join(columns) + " |", "|---|" + "---|" * len(columns)]
    for slug in OWN_SLUGS:
        cells = [_cell(said[slug]) for said in columns.values()]
        lines.append(f"| [{slug}](../effects/{slug}.md) | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def _cell(said: Saying) -> str:
    where = f" in {said.where}" if said.where else ""
    return f"{said.how}{where}{f': {said.why}' if said.why else ''}"
