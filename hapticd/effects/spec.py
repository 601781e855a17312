"""The records of which the catalogue consists."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final, Literal, NamedTuple, Protocol, get_args

Values = Mapping[str, Any]
"""Parameters by name: a number, or a list of numbers."""

ActsOn = Literal["base", "friction", "force", "input", "timing", "memory", "measurement"]
"""What an effect changes: a number of eq. 1; friction; the torques on the shaft; the current's size; its timing; states of
the device besides position and velocity; what the encoder measures."""

ACTS_ON: Final[tuple[str, ...]] = get_args(ActsOn)
"""In the order of the documentation."""


@dataclass(frozen=True)
class Parameter:
    """One parameter of an effect.

    Attributes:
        name: key in YAML and in ``gap.json``.
        unit: for a rotary device; "" for a pure number.
        unit_linear: for a linear device.
        neutral: value while the effect is off, and default of an optional parameter.
        lower: smallest value that a config may give.
        upper: largest value that a config may give.
        scale: "log" for a positive magnitude that a search varies by factors, "linear" otherwise.
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
        """The value, or the bound that it exceeds."""
        return min(max(value, self.lower), self.upper)


@dataclass(frozen=True)
class Scale:
    """Magnitudes in a record and its model, for the start values of a fit.

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
        slowest: half of the speed below which a reversal has one sample at each side [rad/s or m/s]: a law with this speed
            acts up to about twice it, and a slower one is not seen.
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
    slowest: float = 0.0


class LoopNumbers(Protocol):
    """The numbers of a loop in the stability criterion, SI units (`hapticd.stability.numbers.Loop`)."""

    @property
    def inertia(self) -> float:
        """Moving inertia."""

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
        """Error of a command, besides the encoder's."""

    @property
    def hand_stiffness(self) -> float:
        """Stiffness of a hand in parallel with the virtual spring."""


class Complaint(NamedTuple):
    """A problem of parameters that are each valid alone."""

    parameter: str
    message: str
    limit: float | None = None
    unit: str | None = None


@dataclass(frozen=True)
class Notes:
    """Further paragraphs of an effect's page; Markdown.

    Attributes:
        told_apart: differences from similar effects.
        shown_by: the motion that shows it.
        in_theory: how the stability criterion counts it, if not obvious.
        simulated: how it is simulated, with its accuracy.
    """

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
        source: of the law.
        where_it_shows: its trace in recorded data.
        example: parameters as in a config: ``s: 0.4, omega_s: 3.0``.
        notes: the rest of its page.
        amplitude: the parameter in which its force is linear, at least for small values; "" for none.
        reach: for the scale of a record, limit of its first parameter in a fit if that is beyond its bounds: a
            base parameter near zero may be wrong by a large factor.
        grid: start values of a fit, for the scale of a record; none if they are found otherwise.
        equivalent_to: effects with the same law in other parameters.
        near: effects that only a suitable experiment distinguishes from it.
        contains: simpler effects that are limits of this one, over any motion or over a small one.
        excludes: effects that a device with this one cannot have.
        rotary_only: whether its law is in an angle, and so has no meaning on a linear device.
        accuracy: relative error of its simulation; 0 in closed form. No estimate of its parameters is better than that.
        in_loop: from a loop and all parameters, the numbers of the loop that it changes, in the worst case for stability;
            empty if it cannot harm. Without it the stability criterion leaves the effect out, and says so.
        in_loop_exact: whether it changes nothing else in the loop, so that a proof holds.
        joint_check: problems of parameters that are each within their bounds.
        stiffness: from all parameters, the largest slope of its torque over the position [N m/rad or N/m], 0 while off; a
            tick is divided so that every oscillation is resolved.
        damping: likewise over the velocity [N m s/rad or N s/m], for a `force` or `friction` that depends on it.
        force: law of an effect that the plant's kernels do not know by name: the torque or force [N m or N] on the shaft
            as ``force(position, velocity, time, current, *parameters)``, lists element by element. Plain Python on floats
            and `math`, which is compiled; 0 where the first parameter is neutral.
        friction: likewise its addition to the Coulomb friction, ``friction(speed, torque, time, *parameters)``, at a speed
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
        """Number of elements of all parameters."""
        return sum(parameter.length for parameter in self.parameters)

    def complete(self, values: Values) -> dict[str, Any]:
        """All parameters: those given, and the neutral values of the rest; lists in full length."""
        whole: dict[str, Any] = {}
        for p in self.parameters:
            given = values.get(p.name, p.neutral if p.length == 1 else ())
            whole[p.name] = given if p.length == 1 else (*given, *[p.neutral] * (p.length - len(given)))
        return whole

    def starts(self, scale: Scale) -> tuple[dict[str, float], ...]:
        """Start values of a fit to a record of that scale: finite, different, within the bounds."""
        bounds = {p.name: p for p in self.parameters}
        found: list[dict[str, float]] = []
        for values in self.grid(scale):
            if all(map(math.isfinite, values.values())):
                start = {name: bounds[name].clamped(value) for name, value in values.items()}
                if start not in found:
                    found.append(start)
        return tuple(found)
