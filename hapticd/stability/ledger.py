"""The energy ledger of Sec. VI: stored, dissipated and generated energy of an exact motion, period by period.

The energies of each interval [l, l + 1), l = h + τ_D, in which the force of one sample acts (52):

* stored H_T (35) at its ends; with a hand's stiffness ½κξ² is added;
* dissipated E_β = β∫ξ̇² and E_σ = σ∫|ξ̇| (28, 36), integrated exactly (`hapticd.stability.segments`);
* generated E_g (29): the paper's parts of sampling and delay (43, 53) and of quantisation (44, 54) together;
* the work of the hand ∫φ_H ξ̇ (26).

Each is computed separately, so that the balance (26) checks all of them: `Ledger.residual`.
Units: KΔ², ticks and periods; multiply with `Scales.energy` for joules.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import from_dtype, types
from numpy.typing import ArrayLike, NDArray

from hapticd.jit import njit
from hapticd.stability.numbers import Dimensionless
from hapticd.stability.segments import move
from hapticd.stability.storage import FloatArray, potential, rho, storage

_f8 = types.float64
_F = types.Array(_f8, 1, "C")

#: Position in ticks at which a growing motion ends, as in the simulator.
LIMIT = 1e9
#: State at the beginning of an interval, force in it, and results.
_INTERVAL = np.dtype([(name, "f8") for name in ("xi", "xi_dot", "sampled", "force", "viscous", "path", "low", "high")])
_table = types.Array(from_dtype(_INTERVAL), 1, "C")


@njit(types.int64(_f8, _f8, _f8, _f8, _f8, _f8, _f8, _F, _table))
def _record(
    mu: float,
    beta: float,
    sigma: float,
    kappa: float,
    tau_d: float,
    xi: float,
    xi_dot: float,
    hand: NDArray[np.float64],
    table: NDArray[Any],
) -> int:
    """Fill one row per interval; row 0 is the coast before the first force, the last row only the final state.

    Args:
        hand: (periods,) force φ_H, constant from sample to sample. table: (periods + 2,) of `_INTERVAL`.

    Returns:
        Number of complete rows.
    """
    whole = math.floor(tau_d)
    fraction = tau_d - whole
    periods = len(hand)
    table[0].xi = table[0].low = table[0].high = xi
    table[0].xi_dot = xi_dot
    for h in range(periods):
        table[h + 1].sampled, table[h + 1].force = xi, -np.floor(xi) - 0.5
        # the rows of this period: one until h + fraction, the next one after it
        for part in range(2):
            row = table[max(h - whole + part, 0)]
            dt = fraction if part == 0 else 1.0 - fraction
            if part == 1 and h - whole + part > 0:
                row.xi = row.low = row.high = xi
                row.xi_dot = xi_dot
            if dt == 0.0:
                continue
            xi, xi_dot, drag, path, low, high = move(xi, xi_dot, dt, row.force + hand[h], mu, beta, sigma, kappa)
            row.viscous += drag
            row.path += path
            row.low, row.high = min(row.low, low), max(row.high, high)
        if not abs(xi) <= LIMIT:
            periods = h + 1
            break
    # With a fractional delay the interval of the newest force is incomplete: the row ends at its beginning.
    rows = max(periods - whole + (0 if fraction > 0.0 else 1), 1)
    if fraction == 0.0 or rows == 1:
        table[rows].xi, table[rows].xi_dot = xi, xi_dot
    return rows


@dataclass(frozen=True)
class Ledger:
    """Energies of a motion; n intervals, in units of KΔ².

    With a delay the first interval is the coast [0, τ_D) in which no force acts yet (`coasts`): all energy that the
    quantised spring stores in it counts as generated. The others hold one force each.

    Attributes:
        numbers: the operating point.
        tau: (n + 1,) times of the ends of the intervals, in periods.
        xi: (n + 1,) positions there, in ticks. xi_dot: (n + 1,) velocities, in ticks per period.
        sampled: (n,) position ξ(h) whose force acts.
        force: (n,) that force φ_A = −⌊ξ(h)⌋ − ½.
        viscous: (n,) dissipated E_β. coulomb: (n,) dissipated E_σ.
        generated: (n,) E_g (29, 42).
        hand: (n,) work of the hand.
        low: (n,) lowest position in the interval. high: (n,) highest position.
        coasts: whether the first interval is the coast.
    """

    numbers: Dimensionless
    tau: FloatArray
    xi: FloatArray
    xi_dot: FloatArray
    sampled: FloatArray
    force: FloatArray
    viscous: FloatArray
    coulomb: FloatArray
    generated: FloatArray
    hand: FloatArray
    low: FloatArray
    high: FloatArray
    coasts: bool

    @property
    def stored(self) -> FloatArray:
        """(n + 1,) stored energy H_T (35) at the ends of the intervals."""
        return storage(self.xi, self.xi_dot, self.numbers.mu, self.numbers.kappa)

    @property
    def dissipated(self) -> FloatArray:
        """(n,) E_d = E_β + E_σ (36)."""
        return self.viscous + self.coulomb

    @property
    def residual(self) -> FloatArray:
        """(n,) remainder of the balance (26): ΔH_T + E_d − E_g − ∫φ_Hξ̇; rounding, if all is right."""
        return np.diff(self.stored) + self.dissipated - self.generated - self.hand

    @property
    def scale(self) -> FloatArray:
        """(n,) the largest energy in each interval, which rounding is compared with."""
        H = self.stored
        terms = (H[:-1], H[1:], np.abs(self.generated), self.dissipated, np.abs(self.hand))
        return np.asarray(np.maximum.reduce(terms))


def ledger(numbers: Dimensionless, xi_0: float, xi_dot_0: float, periods: int, hand_force: ArrayLike = 0.0) -> Ledger:
    """Simulate a motion and compute its energies.

    Args:
        numbers: the operating point.
        xi_0: initial position in ticks. xi_dot_0: initial velocity in ticks per period.
        periods: number; fewer if the motion exceeds 10⁹ ticks.
        hand_force: φ_H; one number or, without delay, (periods,), constant from sample to sample.

    Raises:
        ValueError: no spring, too few periods for one interval of force, or a hand's force that changes with a delay.
    """
    if math.isinf(numbers.mu):
        raise ValueError("there is no spring, so there are no energies to compute")
    if periods < math.ceil(numbers.tau_d) + 1:
        raise ValueError(
            f"{periods} periods are too few: with tau_d = {numbers.tau_d:g} they contain no interval of force"
        )
    hand = np.broadcast_to(np.asarray(hand_force, dtype=np.float64), (periods,)).copy()
    if numbers.tau_d > 0.0 and np.any(hand != hand[0]):
        raise ValueError("with a delay the hand's force must be constant")
    table = np.zeros(periods + 2, _INTERVAL)
    n = numbers
    rows = _record(n.mu, n.beta, n.sigma, n.kappa, n.tau_d, float(xi_0), float(xi_dot_0), hand, table)
    first = 0 if n.tau_d > 0.0 else 1
    body, xi = table[first:rows], table["xi"][first : rows + 1]
    start, displacement = xi[:-1], np.diff(xi)
    tau = np.arange(first, rows + 1, dtype=np.float64) - 1.0 + n.tau_d
    tau[0] = 0.0
    made = generated(np.floor(start) - np.floor(body["sampled"]), rho(start), displacement)
    if first == 0:
        made[0] = potential(xi[1]) - potential(xi[0])
    return Ledger(
        numbers=n,
        tau=tau,
        xi=xi,
        xi_dot=table["xi_dot"][first : rows + 1],
        sampled=body["sampled"],
        force=body["force"],
        viscous=body["viscous"],
        coulomb=n.sigma * body["path"],
        generated=made,
        hand=hand[: rows - first] * displacement,
        low=body["low"],
        high=body["high"],
        coasts=first == 0,
    )


def generated(ticks_late: FloatArray, rho: FloatArray, displacement: FloatArray) -> FloatArray:
    """E_g (29) of a motion under one force: ∫(⌊χ⌋ − ⌊ξ(h)⌋)dχ, in a form that does not cancel far from the origin.

    Args:
        ticks_late: ⌊ξ(l)⌋ − ⌊ξ(h)⌋, from the sampled tick to the one in which the motion begins.
        rho: ρ(l), position within that tick. displacement: ξ(τ₁) − ξ(l).
    """
    reach = rho + displacement
    n = np.floor(reach)
    return np.asarray(ticks_late * displacement + 0.5 * n * (n - 1.0) + n * (reach - n))
