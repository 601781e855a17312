"""A model as MJCF for MuJoCo, and a Python module beside it for what MJCF cannot say.

The file stands alone: what it only approximates, or leaves out, the module does exactly once it is installed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING

from hapticd.export._python_module import module_text
from hapticd.export.axis_numbers import axis_numbers
from hapticd.export.plain.numbers import Numbers

if TYPE_CHECKING:
    from hapticd.config import Config

_MASS = 1e-3
"""Of a body that turns about its centre: any."""
_GRAVITY = 9.81
_LEVER = 0.1
"""Share of the inertia that the mass of a pendulum has about the axis at most."""
_LONGEST_STEP_S = 1e-4
_CONTACT_STEPS = 20.0
"""A contact's natural period, in steps over 2π."""

_NOT_SAID = (
    "viscous_asymmetry", "stribeck_share", "load_friction", "warming", "breakaway", "ripple", "hand_inertia",
    "hand_damping", "hand_stiffness", "lag_hz", "dac_step", "command_step", "lost", "eccentricity",
)  # fmt: skip
"""Numbers that no element of MJCF has."""

_WITH_DELAY, _WITH_POLYNOMIALS = "3.5", "3.7"
"""MuJoCo from which on actuators have a delay, and joints quadratic damping."""


@dataclass(frozen=True)
class Mjcf:
    """The MJCF file's text, and that of the module beside it; None where MJCF says it all."""

    xml: str
    module: str | None


def mjcf(config: Config, remarks: list[str], module: str) -> Mjcf:
    """A config's axis for MuJoCo.

    Args:
        config: the model.
        remarks: what is said at the head of both files, a sentence each.
        module: name of the module beside it.
    """
    n = axis_numbers(config)
    step = min(n.longest_part_s, _LONGEST_STEP_S)
    says_all = _says_all(n, is_linear=config.is_linear)
    hint = [] if says_all else [f"What only the module has: import {module}; {module}.install(model)"]
    xml = _xml(n, step, config.is_linear, [*remarks, *hint])
    return Mjcf(xml, None if says_all else _module(config, n, remarks))


def _number(value: float) -> str:
    return f"{value:.9g}"


def _xml(n: Numbers, step: float, is_linear: bool, remarks: list[str]) -> str:
    joint = {
        "name": "joint",
        "type": "slide" if is_linear else "hinge",
        "axis": "1 0 0" if is_linear else "0 -1 0",
    }
    own = n.inertia - n.load_inertia
    # In the body, not in the joint's armature: how hard a friction is goes by the bodies alone.
    place, mass, lever_inertia = "0 0 0", own if is_linear else _MASS, 0.0
    if n.gravity and not is_linear:
        lever = _LEVER * own * _GRAVITY / n.gravity
        mass = n.gravity / (_GRAVITY * lever)
        lever_inertia = mass * lever * lever
        # At the position where it hangs the mass is below the axis; a positive angle lifts it.
        place = f"{_number(-lever * math.sin(n.gravity_rest))} 0 {_number(-lever * math.cos(n.gravity_rest))}"
    joint["damping"] = _number(n.viscous + n.damping) + (f" {_number(n.drag)} 0" if n.drag > 0.0 else "")
    joint["frictionloss"] = _number(n.coulomb)
    # Stops within a step, and holds: the nearest to stiction that MuJoCo's friction can be.
    joint["solreffriction"] = f"-1 {_number(-1.0 / step)}"
    joint["solimpfriction"] = "0.9999 0.9999 0.001 0.5 2"
    if n.stiffness:
        joint["stiffness"], joint["springref"] = _number(n.stiffness), _number(n.rest)
    actuator = ["    " + _motor(n, step)]
    if n.bias:
        actuator.append(
            f'    <general name="bias" joint="joint" biastype="affine" biasprm="{_number(n.bias)} 0 0" gainprm="0"/>'
        )
    gravity = f"0 0 {_number(-_GRAVITY) if lever_inertia else 0}"
    lines = [
        "<!--",
        *(f"  {remark}" for remark in remarks),
        *(f"  Needs MuJoCo {oldest} or later." for oldest in _oldest(n)),
        "  ctrl of the actuator 'command' is the commanded current in A.",
        "-->",
        '<mujoco model="axis">',
        '  <compiler angle="radian" autolimits="true"/>',
        f'  <option timestep="{_number(step)}" integrator="implicitfast" gravity="{gravity}"/>',
        "  <worldbody>",
        '    <body name="motor">',
        f"      {_inertial(place, mass, own - lever_inertia)}",
        f"      <joint {_attributes(joint)}/>",
        *(f"      {line}" for line in _load(n, joint, step, is_linear)),
        "    </body>",
        "  </worldbody>",
        "  <actuator>",
        *actuator,
        "  </actuator>",
        "  <sensor>",
        '    <jointpos name="position" joint="joint"/>',
        '    <jointvel name="velocity" joint="joint"/>',
        "  </sensor>",
        "</mujoco>",
    ]
    return "\n".join(lines) + "\n"


def _oldest(n: Numbers) -> list[str]:
    return [_WITH_POLYNOMIALS] if n.drag > 0.0 else [_WITH_DELAY] if n.delay_s > 0.0 else []


def _inertial(place: str, mass: float, inertia: float) -> str:
    size = _number(inertia)
    return f'<inertial pos="{place}" mass="{_number(mass)}" diaginertia="{size} {size} {size}"/>'


def _attributes(values: dict[str, str]) -> str:
    return " ".join(f'{name}="{value}"' for name, value in values.items())


def _motor(n: Numbers, step: float) -> str:
    motor = {"name": "command", "joint": "joint", "gear": _number(n.torque_constant), "gainprm": "1"}
    if n.current_limit < math.inf:
        motor["ctrlrange"] = f"{_number(-n.current_limit)} {_number(n.current_limit)}"
    if n.lag_hz < math.inf:
        motor["dyntype"], motor["dynprm"] = "filterexact", _number(n.lag_ratio / (math.pi * n.lag_hz))
    if n.delay_s > 0.0:
        motor["delay"], motor["nsample"] = _number(n.delay_s), str(math.ceil(n.delay_s / step) + 1)
    return f"<general {_attributes(motor)}/>"


def _load(n: Numbers, joint: dict[str, str], step: float, is_linear: bool) -> list[str]:
    """The body behind a play or a coupling; its joint's position is relative to the motor."""
    if not n.load_inertia:
        return []
    own = {"name": "load", "type": joint["type"], "axis": joint["axis"]}
    if n.play:
        natural = 1.0 / (_CONTACT_STEPS * step)
        ratio = _ratio_of(n.restitution)
        own["range"] = f"{_number(-0.5 * n.play)} {_number(0.5 * n.play)}"
        own["solreflimit"] = f"{_number(-natural * natural)} {_number(-2.0 * ratio * natural)}"
        own["solimplimit"] = "0.9999 0.9999 0.001 0.5 2"
    else:
        own["stiffness"], own["damping"] = _number(n.coupling_stiffness), _number(n.coupling_damping)
    return [
        '<body name="load">',
        f"  {_inertial('0 0 0', n.load_inertia if is_linear else _MASS, n.load_inertia)}",
        f"  <joint {_attributes(own)}/>",
        "</body>",
    ]


def _ratio_of(restitution: float) -> float:
    """Damping ratio of a contact that rebounds so: exp(−πζ/√(1 − ζ²)); without a rebound it is critical."""
    if restitution <= 0.0:
        return 1.0
    decay = -math.log(restitution)
    return decay / math.hypot(math.pi, decay)


def _says_all(n: Numbers, *, is_linear: bool) -> bool:
    """Whether MJCF says all there is."""
    neutral = {field.name: field.default for field in fields(Numbers)}
    others = any(getattr(n, name) != neutral[name] for name in _NOT_SAID)
    return not others and n.drag >= 0.0 and not (is_linear and n.gravity)


def _module(config: Config, n: Numbers, remarks: list[str]) -> str:
    """The module: it takes the motor, the friction's change and every torque that MJCF has no element for."""
    left = replace(
        n, bias=0.0, stiffness=0.0, damping=0.0, drag=min(n.drag, 0.0), gravity=n.gravity if config.is_linear else 0.0
    )
    head = "\n".join(["What MJCF cannot say of an axis, as MuJoCo's callback for passive forces.", "", *remarks])
    return module_text(config, head, ("mujoco_callback",), left)
