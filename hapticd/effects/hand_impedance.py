"""A hand that holds the device for a part of the record: inertia, damper and spring in parallel."""

from __future__ import annotations

import math
from collections.abc import Iterator

from hapticd.effects.parameters import DAMPING, INERTIA, STIFFNESS, magnitude, shift
from hapticd.effects.spec import Complaint, Effect, Notes, Parameter, Values


def is_gripped(time: float, on_s: float, off_s: float) -> bool:
    """Whether the hand holds the device at a time."""
    return on_s <= time < off_s


def until_switch(time: float, span: float, on_s: float, off_s: float) -> float:
    """Return the part of `span` after `time` until the hand next takes or releases the device."""
    if time < on_s < time + span:
        return on_s - time
    if time < off_s < time + span:
        return off_s - time
    return span


def _joint_check(values: Values) -> Iterator[Complaint]:
    on_s = float(values.get("on_s", 0.0))
    if on_s >= values.get("off_s", math.inf):
        yield Complaint("off_s", f"must be above on_s = {on_s:.15g} s", on_s, "s")


EFFECT = Effect(
    slug="hand_impedance",
    summary="A hand holds the device for part of the record: inertia, damper and spring in parallel.",
    law=(
        "J → J + m_h, b → b + b_h, torque −k_h (θ − rest), for on_s ≤ t < off_s; the hand takes hold at the shaft's "
        "velocity"
    ),
    parameters=(
        magnitude("m_h", INERTIA, 1e3, required=False),
        magnitude("b_h", DAMPING, 1e4, required=False),
        magnitude("k_h", STIFFNESS, 1e6, required=False),
        Parameter("on_s", "s", "s", neutral=0.0, lower=0.0, upper=1e9),
        Parameter("off_s", "s", "s", neutral=1e9, lower=0.0, upper=1e9),
        shift("rest"),
    ),
    acts_on="force",
    source="Sec. III-B of the paper; Kuchenbecker, Park and Niemeyer 2003.",
    where_it_shows=(
        "Between two instants the device has more inertia, more damping, or a stiffness; before and after it has not."
    ),
    example="m_h: 2.0e-6, b_h: 1.0e-4, k_h: 0.01",
    notes=Notes(
        told_apart="`return_spring`, `inertia_error` and `viscous_friction` last for the whole record.",
        shown_by=(
            "a record that begins and ends without the hand, with motion rich enough to separate inertia, damper and "
            "spring."
        ),
        simulated="Closed form; the instants of grip and release are located inside a tick.",
    ),
    near=("return_spring", "inertia_error", "viscous_friction"),
    contains=("inertia_error", "viscous_friction", "return_spring"),
    joint_check=_joint_check,
)
