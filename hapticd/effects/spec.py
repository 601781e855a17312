"""What a file of the catalogue says of its effect."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final, Literal, NamedTuple, Protocol, get_args

Values = Mapping[str, Any]
"""Parameters by name: a number, or a list of numbers."""

ActsOn = Literal["base", "friction", "force", "input", "timing", "memory", "measurement"]
"""What an effect changes: a number of eq. 1; friction; the torques on the shaft; the current's size; its timing; what the
device remembers besides position and velocity; what the encoder sees."""

ACTS_ON: Final[tuple[str, ...]] = get_args(ActsOn)
"""In the order of the documentation."""


@dataclass(frozen=True)
class Parameter:
    """One parameter of an effect.

    Attributes:
        name: key in YAML and in ``gap.json``.
        unit: for a rotary device; "" for a pure number.
        unit_linear: for a linear device.
        neutral: value while the effect is off, and where a config leaves an optional parameter out.
        lower: smallest value that a config may give.
        upper: largest value that a config may give.
        scale: "log" for a positive magnitude that a search should vary by factors, "linear" otherwise.
        required: whether a config must give it.
        length: 1 for a number; otherwise the largest length of a list.
    """

    name: str
    unit: str
    unit_linear: str
    neutral: float
    lower: float
    upper: float
    scale: Literal["linear", "log"] = "linear"
    required: bool = False
    length: int = 1

    def clamped(self, value: float) -> float:
        """The value, or the bound that it passes."""
        return min(max(value, self.lower), self.upper)


@dataclass(frozen=True)
class Scale:
    """How large things are in a record and its model: what a fit's starting values are measured by.

    SI units, rotary or linear. Quantiles are of the whole record, rising.

    Attributes:
        inertia: of the model.
        viscous: of the model.
        coulomb: of the model.
        torque_constant: of the model.
        resolution: one encoder count [rad or m].
        period_s: time between two rows [s].
        duration_s: of the record [s].
        torque: Coulomb friction and the RMS torque of the motor together [N m or N].
        speeds: quantiles 0.1, 0.3, 0.6, 0.9 and 0.99 of the magnitude of the velocity.
        currents: quantiles 0.5, 0.6, 0.8, 0.9, 0.97, 0.995 and 1 of the magnitude of the current [A].
        positions: quantiles 0.01, 0.25, 0.5, 0.75 and 0.99 of the position.
        travel: from the smallest to the largest position.
        is_linear: whether the device is linear.
    """

    inertia: float
    viscous: float
    coulomb: float
    torque_constant: float
    resolution: float
    period_s: float
    duration_s: float
    torque: float
    speeds: tuple[float, float, float, float, float]
    currents: tuple[float, float, float, float, float, float, float]
    positions: tuple[float, float, float, float, float]
    travel: float
    is_linear: bool = False


class LoopNumbers(Protocol):
    """The numbers in SI units that the stability criterion knows of a loop (`hapticd.stability.numbers.Loop`)."""

    @property
    def inertia(self) -> float:
        """Of what moves."""

    @property
    def viscous(self) -> float:
        """Viscous friction."""

    @property
    def coulomb(self) -> float:
        """Coulomb friction."""

    @property
    def stiffness(self) -> float:
        """Of the virtual spring."""

    @property
    def damping(self) -> float:
        """Virtual damping."""

    @property
    def delay(self) -> float:
        """From sample to current [s]."""

    @property
    def force_error(self) -> float:
        """Of a command, beside the encoder's."""

    @property
    def hand_stiffness(self) -> float:
        """Of what holds the shaft besides the virtual spring."""


class Complaint(NamedTuple):
    """What is wrong with parameters that are each valid on their own."""

    parameter: str
    message: str
    limit: float | None = None
    unit: str | None = None


@dataclass(frozen=True)
class Notes:
    """What an effect's page says beyond the catalogue's own sentences; Markdown, a paragraph each.

    Attributes:
        in_data: more of what it does to recorded data.
        told_apart: how it differs from the effects that it is confused with.
        shown_by: the motion that shows it.
        in_theory: how the stability criterion counts it, where that is not plain.
        simulated: how it is simulated, and how exactly.
    """

    in_data: str = ""
    told_apart: str = ""
    shown_by: str = ""
    in_theory: str = ""
    simulated: str = ""


def _no_starts(scale: Scale) -> tuple[Values, ...]:
    return ()


@dataclass(frozen=True)
class Effect:
    """One effect of the catalogue.

    Attributes:
        slug: name in configs and in ``gap.json``.
        summary: what it is, in one sentence.
        law: the formula, in the symbols of the parameters.
        parameters: in the order of the device vector.
        acts_on: what it changes.
        source: where the law comes from.
        where_it_shows: what it does to recorded data.
        example: parameters as in a config: ``s: 0.4, omega_s: 3.0``.
        notes: the rest of its page.
        amplitude: the parameter in which its force is linear, at least while small; "" for none.
        reach: for the scale of a record, how far its first parameter may go in a fit where that is beyond its bounds: a
            base parameter of next to nothing is wrong by a large factor.
        grid: parameters from which a fit may start, for the scale of a record; none where they are found by other means.
        equivalent_to: effects with the very same law in other parameters.
        near: effects that only the right experiment tells apart.
        contains: simpler effects that are limits of this one, over any motion or over a small one.
        excludes: effects that a device with this one cannot have.
        rotary_only: whether its law is in an angle, and on a linear device would be the sine of a metre.
        accuracy: relative error of its simulation; 0 in closed form. No estimate of its parameters is better than that.
        in_loop: from a loop and all parameters, the numbers of the loop that it changes, at its worst for stability; none
            at all where it can do no harm. Without it the stability criterion leaves the effect out, and says so.
        in_loop_exact: whether those numbers are all that it does to the loop, so that a proof for them holds.
        joint_check: what is wrong with parameters that are each within their bounds.
        stiffness: from all parameters, the largest slope of its torque over the position [N m/rad or N/m], 0 while off; a
            tick is divided so that no swing in it is missed.
        damping: likewise over the velocity [N m s/rad or N s/m], for a `force` or `friction` that depends on it.
        force: law of an effect that the plant's kernels do not know by name: the torque or force [N m or N] on the shaft
            as ``force(position, velocity, time, current, *parameters)``, lists element by element. Plain Python on floats
            and `math`, which is compiled; 0 where the first parameter is neutral.
        friction: likewise what it adds to the Coulomb friction, ``friction(speed, torque, time, *parameters)``, at a speed
            ≥ 0 (0: stiction) under a motor torque.
    """

    slug: str
    summary: str
    law: str
    parameters: tuple[Parameter, ...]
    acts_on: ActsOn
    source: str
    where_it_shows: str
    example: str
    notes: Notes = Notes()
    amplitude: str = ""
    reach: Callable[[Scale], float] | None = None
    grid: Callable[[Scale], Iterable[Values]] = _no_starts
    equivalent_to: tuple[str, ...] = ()
    near: tuple[str, ...] = ()
    contains: tuple[str, ...] = ()
    excludes: tuple[str, ...] = ()
    rotary_only: bool = False
    accuracy: float = 0.0
    in_loop: Callable[[LoopNumbers, Values], Mapping[str, float]] | None = None
    in_loop_exact: bool = True
    joint_check: Callable[[Values], Iterable[Complaint]] | None = None
    stiffness: Callable[[Values], float] | None = None
    damping: Callable[[Values], float] | None = None
    force: Callable[..., float] | None = None
    friction: Callable[..., float] | None = None

    @property
    def is_hooked(self) -> bool:
        """Whether the plant calls its law through a pointer, instead of knowing it by name."""
        return self.force is not None or self.friction is not None

    @property
    def size(self) -> int:
        """Numbers that its parameters take in all."""
        return sum(parameter.length for parameter in self.parameters)

    def complete(self, values: Values) -> dict[str, Any]:
        """All parameters: those given, and the neutral values of the rest; lists in full length."""
        whole: dict[str, Any] = {}
        for p in self.parameters:
            given = values.get(p.name, p.neutral if p.length == 1 else ())
            whole[p.name] = given if p.length == 1 else (*given, *[p.neutral] * (p.length - len(given)))
        return whole

    def starts(self, scale: Scale) -> tuple[dict[str, float], ...]:
        """Different finite parameters, within their bounds, from which a fit to a record of that scale may start."""
        bounds = {p.name: p for p in self.parameters}
        found: list[dict[str, float]] = []
        for values in self.grid(scale):
            if all(map(math.isfinite, values.values())):
                start = {name: bounds[name].clamped(value) for name, value in values.items()}
                if start not in found:
                    found.append(start)
        return tuple(found)
