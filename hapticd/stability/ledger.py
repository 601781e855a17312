"""The energy ledger of Sec. VI: stored, dissipated and generated energy of an exact motion, period by period.

Every interval [l, l + 1), l = h + τ_D, in which the force of one sample acts (52), is accounted for by itself:

* stored H_T (35) at its ends; with a hand's stiffness ½κξ² is added;
* dissipated E_β = β∫ξ̇² and E_σ = σ∫|ξ̇| (28, 36), integrated exactly (`hapticd.stability.segments`);
* generated E_g (29), split into the part of sampling and delay (43, 53) and the part of quantisation (44, 54);
* the work of the hand ∫φ_H ξ̇ (26).

The last two terms of (54) have the opposite sign of the printed ones; with them, from (33),

    E_gq = (ρ(h) − ½)Δ⌊ξ⌋ − ½(ρ(τ₁) − ρ(l))² + (ρ(h) − ρ(l))(ρ(τ₁) − ρ(l)).

Each of these is computed by itself, so that the balance (26) is a check of all of them: `Ledger.residual`.
In units of KΔ², ticks and periods throughout; times `Scales.energy` they are joules.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import types
from numpy.typing import ArrayLike, NDArray

from hapticd.jit import njit
from hapticd.stability.numbers import Dimensionless
from hapticd.stability.segments import move_with_stiffness
from hapticd.stability.storage import FloatArray, potential, rho, storage

_f8 = types.float64
_F = types.Array(_f8, 1, "C")
_F2 = types.Array(_f8, 2, "C")

#: Where a motion that grows is given up, in ticks, as in the simulator.
LIMIT = 1e9
_POSITION, _VELOCITY, _SAMPLED, _FORCE, _VISCOUS, _PATH, _LOW, _HIGH = range(8)


@njit(types.int64(_f8, _f8, _f8, _f8, _f8, _f8, _f8, _F, _F2))
def _record(
    mu: float,
    beta: float,
    sigma: float,
    kappa: float,
    tau_d: float,
    xi: float,
    xi_dot: float,
    hand: NDArray[np.float64],
    table: NDArray[np.float64],
) -> int:
    """Fill one row an interval; row 0 is the coast before the first force, the last row only the final state.

    Args:
        hand: (periods,) force φ_H, constant from sample to sample. table: (periods + 2, 8).

    Returns:
        How many rows are whole.
    """
    whole = math.floor(tau_d)
    fraction = tau_d - whole
    periods = len(hand)
    table[0, _POSITION], table[0, _VELOCITY] = xi, xi_dot
    table[0, _LOW], table[0, _HIGH] = xi, xi
    for h in range(periods):
        table[h + 1, _SAMPLED] = xi
        table[h + 1, _FORCE] = -np.floor(xi) - 0.5
        # the rows that act in this period: one until h + fraction, the next one after it
        for part in range(2):
            row = max(h - whole + part, 0)
            dt = fraction if part == 0 else 1.0 - fraction
            if part == 1 and row > 0:
                table[row, _POSITION], table[row, _VELOCITY] = xi, xi_dot
                table[row, _LOW], table[row, _HIGH] = xi, xi
            if dt == 0.0:
                continue
            force = table[row, _FORCE] + hand[h]
            xi, xi_dot, drag, path, low, high = move_with_stiffness(xi, xi_dot, dt, force, mu, beta, sigma, kappa)
            table[row, _VISCOUS] += drag
            table[row, _PATH] += path
            table[row, _LOW] = min(table[row, _LOW], low)
            table[row, _HIGH] = max(table[row, _HIGH], high)
        if not abs(xi) <= LIMIT:
            periods = h + 1
            break
    # With a fraction of a period the newest force has not had its whole interval: the row ends at its beginning.
    rows = max(periods - whole + (0 if fraction > 0.0 else 1), 1)
    if fraction == 0.0 or rows == 1:
        table[rows, _POSITION], table[rows, _VELOCITY] = xi, xi_dot
    return rows


@dataclass(frozen=True)
class Ledger:
    """Energies of a motion; n intervals, in units of KΔ².

    With a delay the first interval is the coast [0, τ_D) in which no force acts yet (`coasts`): everything that the
    quantised spring stores then counts as generated. The others hold one force each.

    Attributes:
        numbers: the operating point.
        tau: (n + 1,) times of the ends of the intervals, in periods.
        xi: (n + 1,) positions there, in ticks. xi_dot: (n + 1,) velocities, in ticks per period.
        sampled: (n,) position ξ(h) whose force acts.
        force: (n,) that force φ_A = −⌊ξ(h)⌋ − ½.
        viscous: (n,) dissipated E_β. coulomb: (n,) dissipated E_σ.
        sampling: (n,) generated E_gz (43, 53). quantisation: (n,) generated E_gq (44, 54).
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
    sampling: FloatArray
    quantisation: FloatArray
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
    def generated(self) -> FloatArray:
        """(n,) E_g = E_gz + E_gq (29, 42)."""
        return self.sampling + self.quantisation

    @property
    def residual(self) -> FloatArray:
        """(n,) what the balance (26) leaves over: ΔH_T + E_d − E_g − ∫φ_Hξ̇; rounding, if all is right."""
        return np.diff(self.stored) + self.dissipated - self.generated - self.hand

    @property
    def scale(self) -> FloatArray:
        """(n,) the largest energy in each interval, what its rounding is to be compared with."""
        H = self.stored
        terms = (H[:-1], H[1:], np.abs(self.sampling), np.abs(self.quantisation), self.dissipated, np.abs(self.hand))
        return np.asarray(np.maximum.reduce(terms))


def ledger(numbers: Dimensionless, xi_0: float, xi_dot_0: float, periods: int, hand_force: ArrayLike = 0.0) -> Ledger:
    """Run a motion and account for its energy.

    Args:
        numbers: the operating point.
        xi_0: initial position in ticks. xi_dot_0: initial velocity in ticks per period.
        periods: how many; fewer where the motion leaves the limit of 10⁹ ticks.
        hand_force: φ_H; one number or, without delay, (periods,) numbers, each constant from sample to sample.

    Raises:
        ValueError: no spring, no whole interval of force in so few periods, or a hand's force that changes under delay.
    """
    if math.isinf(numbers.mu):
        raise ValueError("without a spring there is nothing to account for")
    if periods < math.ceil(numbers.tau_d) + 1:
        raise ValueError(f"{periods} periods hold no whole interval of force with tau_d = {numbers.tau_d:g}")
    hand = np.broadcast_to(np.asarray(hand_force, dtype=np.float64), (periods,)).copy()
    if numbers.tau_d > 0.0 and np.any(hand != hand[0]):
        raise ValueError("with a delay the hand's force must be constant")
    table = np.zeros((periods + 2, 8))
    n = numbers
    rows = _record(n.mu, n.beta, n.sigma, n.kappa, n.tau_d, float(xi_0), float(xi_dot_0), hand, table)
    first = 0 if n.tau_d > 0.0 else 1
    body = table[first:rows]
    position, velocity = table[first : rows + 1, _POSITION], table[first : rows + 1, _VELOCITY]
    tau = np.arange(first, rows + 1, dtype=np.float64) - 1.0 + n.tau_d
    tau[0] = 0.0
    sampling, quantisation = _generated(body, position, coasts=first == 0)
    work = hand[: rows - first] * np.diff(position)
    return Ledger(
        numbers=n,
        tau=tau,
        xi=position.copy(),
        xi_dot=velocity.copy(),
        sampled=body[:, _SAMPLED].copy(),
        force=body[:, _FORCE].copy(),
        viscous=body[:, _VISCOUS].copy(),
        coulomb=n.sigma * body[:, _PATH],
        sampling=sampling,
        quantisation=quantisation,
        hand=work,
        low=body[:, _LOW].copy(),
        high=body[:, _HIGH].copy(),
        coasts=first == 0,
    )


def _generated(table: FloatArray, position: FloatArray, *, coasts: bool) -> tuple[FloatArray, FloatArray]:
    """E_gz (43, 53) and E_gq (44, 54 with the corrected signs) of every interval."""
    start, end, sampled = position[:-1], position[1:], table[:, _SAMPLED]
    way = end - start
    rho_h, rho_l, rho_end = rho(sampled), rho(start), rho(end)
    ticks = np.floor(end) - np.floor(start)
    sampling = 0.5 * way * way + (start - sampled) * way
    quantisation = (rho_h - 0.5) * ticks - 0.5 * (rho_end - rho_l) ** 2 + (rho_h - rho_l) * (rho_end - rho_l)
    if coasts:
        # no force at all: −φ_Q = ξ + (½ − ρ) is all that is generated
        sampling[0] = way[0] * 0.5 * (start[0] + end[0])
        quantisation[0] = float(potential(end[0]) - potential(start[0])) - sampling[0]
    return sampling, quantisation
