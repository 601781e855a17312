"""Table II: six haptic devices and a human operator, recomputed from the printed columns and compared.

The columns are stored as printed, because the last digit gives the rounding interval: a printed μ, β or σ that no
unrounded values of its row can give is not a rounding difference.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from decimal import Decimal
from typing import Final

from hapticd.stability.numbers import Loop
from hapticd.stability.tuning import grip_damping

#: True period of Delta and Omega, printed as 0.33 ms: only 1/3 ms gives their printed μ.
THIRD_OF_A_MILLISECOND: Final = 1e-3 / 3.0


@dataclass(frozen=True)
class Device:
    """A row of Table II, as printed.

    Attributes:
        name: device name; `slug` is the name of its preset.
        inertia: m in kg.
        viscous: b in N s/m.
        coulomb: c in N.
        resolution: Δ in µm.
        period: T in ms.
        stiffness: largest K rendered without oscillation and without a hand, in N/m.
        mu: printed μ.
        beta: printed β.
        sigma: printed σ.
        slug: preset name.
        note: why printed and recomputed numbers differ, if not by rounding alone.
    """

    name: str
    inertia: str
    viscous: str
    coulomb: str
    resolution: str
    period: str
    stiffness: str
    mu: str
    beta: str
    sigma: str
    slug: str
    note: str = ""

    @property
    def loop(self) -> Loop:
        """The row in SI units, with T = 1/3 ms where 0.33 ms is printed."""
        period = THIRD_OF_A_MILLISECOND if self.period == "0.33" else float(self.period) * 1e-3
        return replace(self.loop_as_printed, period=period)

    @property
    def loop_as_printed(self) -> Loop:
        """The row in SI units, every column exactly as printed."""
        return Loop(
            inertia=float(self.inertia),
            viscous=float(self.viscous),
            coulomb=float(self.coulomb),
            stiffness=float(self.stiffness),
            resolution=float(self.resolution) * 1e-6,
            period=float(self.period) * 1e-3,
        )


@dataclass(frozen=True)
class Comparison:
    """One printed number of Table II and its recomputed value.

    Attributes:
        device: device name.
        quantity: ``mu``, ``beta`` or ``sigma``.
        printed: the number in the paper.
        recomputed: from the printed columns, T = 1/3 ms for 0.33 ms.
        recomputed_as_printed: from the printed columns, T as printed.
        low: smallest value that columns rounding to the printed ones can give.
        high: largest such value.
        explained: whether the printed number, within its own rounding, lies in [low, high].
        note: the explanation in words.
    """

    device: str
    quantity: str
    printed: float
    recomputed: float
    recomputed_as_printed: float
    low: float
    high: float
    explained: bool
    note: str

    @property
    def difference(self) -> float:
        """(recomputed − printed)/printed."""
        return self.recomputed / self.printed - 1.0


_SAME_PERIOD = "μ follows with T = 1/3 ms; T is printed rounded to 0.33 ms"
_DIGITS = "the printed numbers come from columns with more digits than are printed"

TABLE_II: Final = (
    Device("Delta", "0.250", "0.01", "0.883", "30", "0.33", "14500", "155.2", "0.002", "2.03", "delta", _SAME_PERIOD),
    Device(
        "Freedom 6", "0.250", "0.01", "0.06", "20", "1", "2400", "104.2", "0.025", "1.25", "freedom6",
        "β: b/(KT) = 0.01/(2400·10⁻³) = 0.0042, six times less than the printed 0.025; no rounding explains it",
    ),
    Device(
        "Impulse Engine", "0.032", "0.02", "0.024", "31.4", "0.2", "800", "1007.8", "0.13", "0.97", "impulse_engine",
        _DIGITS,
    ),
    Device(
        "MIT Toolhandle", "0.119", "0.001", "0.034", "20.1", "1", "3125", "38.19", "0.0003", "0.54", "mit_toolhandle",
        _DIGITS,
    ),
    Device("Omega", "0.220", "0.01", "0.147", "10", "0.33", "14500", "136.6", "0.002", "1.01", "omega", _SAME_PERIOD),
    Device("Phantom 1.0", "0.072", "0.005", "0.038", "29.1", "1", "1015", "70.55", "0.004", "1.29", "phantom", _DIGITS),
)  # fmt: skip


@dataclass(frozen=True)
class Hand:
    """A hand's impedance in parallel with the device, SI units."""

    inertia: float
    damping: float
    stiffness: float


#: The last row of Table II: m in kg, b in N s/m, K in N/m.
HUMAN_OPERATOR: Final = Hand(inertia=0.150, damping=4.8, stiffness=600.0)


def rounding(printed: str) -> tuple[float, float]:
    """The interval of numbers that round to the printed one: ± half a unit of its last digit."""
    half = Decimal((0, (5,), int(Decimal(printed).as_tuple().exponent) - 1))
    return float(Decimal(printed) - half), float(Decimal(printed) + half)


def compare(device: Device) -> list[Comparison]:
    """μ, β and σ of a row: printed, recomputed, and whether rounding of the columns explains the difference."""
    columns = (device.inertia, device.viscous, device.coulomb, device.resolution, device.stiffness)
    m, b, c, delta, K = (rounding(column) for column in columns)
    delta = (delta[0] * 1e-6, delta[1] * 1e-6)
    literal, ours = device.loop_as_printed, device.loop
    # sampling periods are set, not measured: 1 ms and 0.2 ms are exact, only 1/3 ms had to be rounded
    T = min(literal.period, ours.period), max(literal.period, ours.period)
    ranges = {
        "mu": (m[0] / (K[1] * T[1] ** 2), m[1] / (K[0] * T[0] ** 2)),
        "beta": (b[0] / (K[1] * T[1]), b[1] / (K[0] * T[0])),
        "sigma": (c[0] / (K[1] * delta[1]), c[1] / (K[0] * delta[0])),
    }
    rows = []
    for quantity, (low, high) in ranges.items():
        printed = getattr(device, quantity)
        least, most = rounding(printed)
        value, value_as_printed = getattr(ours.numbers, quantity), getattr(literal.numbers, quantity)
        rows.append(
            Comparison(
                device=device.name,
                quantity=quantity,
                printed=float(printed),
                recomputed=value,
                recomputed_as_printed=value_as_printed,
                low=low,
                high=high,
                explained=least <= high and most >= low,
                note="" if least <= value_as_printed <= most else device.note,
            )
        )
    return rows


def grip_fraction(loop: Loop, hand: Hand = HUMAN_OPERATOR) -> float:
    """Smallest fraction of a hand's damping that brings β to ½ + τ_D, from E to A (Sec. III-B).

    Returns:
        0 if the device has enough damping; above 1 if this hand is not enough; infinite for a hand without damping.
    """
    missing = grip_damping(loop)
    if missing == 0.0:
        return 0.0
    return missing / hand.damping if hand.damping > 0.0 else math.inf
