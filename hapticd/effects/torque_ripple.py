"""Cogging and torque ripple: Σ a_k sin(kθ + φ_k)."""

from __future__ import annotations

from collections.abc import Iterator

from hapticd.effects.parameters import NUMBER, TORQUE, phase
from hapticd.effects.spec import Complaint, Effect, Notes, Parameter, Values

ORDERS = 8
"""Largest number of orders of one entry."""


def gain(current: float, proportion: float) -> float:
    """Return the common factor of all orders."""
    return 1.0 - proportion + proportion * current


def torque(sine: float, amplitude: float) -> float:
    """Return the torque of one order for the sine of its phase, or for the mean of that sine over a path."""
    return amplitude * sine


def _joint_check(values: Values) -> Iterator[Complaint]:
    orders = len(values["orders"])
    for name in ("amplitudes", "phases"):
        if name in values and len(values[name]) != orders:
            yield Complaint(name, f"has {len(values[name])} numbers for {orders} orders")


def _stiffness(values: Values) -> float:
    return float(
        sum(order * amplitude for order, amplitude in zip(values["orders"], values["amplitudes"], strict=True))
    )


EFFECT = Effect(
    slug="torque_ripple",
    summary=(
        "Torque that depends on the angle, several orders a revolution; without current (cogging) or proportional to "
        "it."
    ),
    law=("+ Σ amplitudes_k sin(orders_k θ + phases_k) · (1 − current_proportion + current_proportion · i / 1 A)"),
    parameters=(
        Parameter(
            "orders", "1/rev", "rad/m", neutral=0.0, lower=0.0, upper=1e5, scale="log", required=True, length=ORDERS
        ),
        Parameter("amplitudes", *TORQUE, neutral=0.0, lower=0.0, upper=1e4, scale="log", required=True, length=ORDERS),
        phase("phases", ORDERS),
        Parameter("current_proportion", *NUMBER, neutral=0.0, lower=0.0, upper=1.0),
    ),
    acts_on="force",
    source="Cogging and commutation ripple: Jahns and Soong 1996.",
    where_it_shows="A residual torque periodic in position; its periodogram over the angle has lines at the orders.",
    example="orders: [7, 14], amplitudes: [4.0e-4, 1.0e-4], phases: [0.3, 1.2]",
    notes=Notes(
        told_apart=(
            "Order 1 is `gravity`; `encoder_eccentricity` is periodic too but grows with speed. Cogging "
            "(current_proportion = 0) and ripple of the current (1) are told apart by motion at two currents."
        ),
        shown_by="slow motion over several turns both ways, at two loads.",
        simulated=(
            "Second order: the torque is averaged over the path of each substep, so that its work is that of its potential "
            "(2·10⁻³ of the distance or better in the tests)."
        ),
    ),
    amplitude="amplitudes",
    accuracy=1e-3,
    near=("gravity", "encoder_eccentricity"),
    contains=("gravity",),
    joint_check=_joint_check,
    stiffness=_stiffness,
)
