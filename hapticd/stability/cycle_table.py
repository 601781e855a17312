"""Limit cycles over regions B and C: the describing function's prediction beside exact simulation, with the errors.

The prediction is the cycle that the smallest disturbance grows into (`limit_cycle.predicted_cycle`); the simulation
starts near rest for the same reason. Where they differ by more than 15 % in amplitude or 10 % in frequency, the row
says why: below one tick the loop locks to a whole number 2p of periods, usually several p are possible
(`locked_cycle`), and the describing function, which knows no sampler, names one oscillation among them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from hapticd.stability.limit_cycle import LimitCycle, predicted_cycle
from hapticd.stability.locked_cycle import LockedCycle, locked_cycles
from hapticd.stability.maps import run_points
from hapticd.stability.numbers import Dimensionless
from hapticd.stability.outcome import OUTCOMES
from hapticd.stability.regions import region

#: Errors up to which prediction and simulation count as in agreement.
AMPLITUDE_TOLERANCE: Final = 0.15
FREQUENCY_TOLERANCE: Final = 0.10
# a simulated oscillation is taken for an exact cycle when both its numbers are this close
_SAME: Final = 0.02

BETAS: Final = (0.1, 0.2, 0.3, 0.4, 0.45, 0.55, 0.65, 0.75, 0.9, 1.05, 1.2, 1.5)
SIGMAS: Final = (0.0, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45)


@dataclass(frozen=True)
class Row:
    """One operating point. Amplitudes are half of peak to peak in ticks, ω in rad per period.

    Attributes:
        tau_d: delay τ_D.
        beta: viscous friction β.
        sigma: Coulomb friction σ.
        region: ``B`` or ``C``.
        outcome: of the simulation.
        predicted: the cycle that the describing function predicts; None when it predicts growth without bound.
        amplitude: simulated; infinite when growing.
        omega: simulated; not a number when growing.
        amplitude_error: predicted/simulated − 1; not a number unless both oscillate.
        frequency_error: the same for ω.
        locked: the exact cycle that the simulation is on; None where it is on none of them.
        agrees: both errors are within tolerance, or both say growth.
        why: empty where they agree.
    """

    tau_d: float
    beta: float
    sigma: float
    region: str
    outcome: str
    predicted: LimitCycle | None
    amplitude: float
    omega: float
    amplitude_error: float
    frequency_error: float
    locked: LockedCycle | None
    agrees: bool
    why: str


def cycle_table(
    mu: float = 100.0,
    delays: Sequence[float] = (0.0, 0.25, 1.25),
    betas: Sequence[float] | None = None,
    sigmas: Sequence[float] = SIGMAS,
    xi_dot_0: float = 0.05,
    periods: int = 60_000,
) -> list[Row]:
    """The table.

    Args:
        mu: inertia μ.
        delays: τ_D.
        betas: β of the rows; None for `BETAS` shifted by τ_D, so that both regions are covered with every delay.
        sigmas: σ of the rows, all below ½.
        xi_dot_0: initial velocity in ticks per period, from the origin.
        periods: horizon of the simulation.

    Raises:
        ValueError: a σ of ½ or more, where neither B nor C is.
    """
    if not all(0.0 <= sigma < 0.5 for sigma in sigmas):
        raise ValueError(f"regions B and C have 0 <= sigma < 0.5, got {list(sigmas)!r}")
    rows = []
    for tau_d in delays:
        grid = np.array([(b, s) for b in (betas or [beta + tau_d for beta in BETAS]) for s in sigmas])
        points = run_points(mu, grid[:, 0], grid[:, 1], tau_d, np.full(len(grid), xi_dot_0), periods)
        for (beta, sigma), point in zip(grid.tolist(), points, strict=True):
            outcome = OUTCOMES[point["outcome"]]
            numbers = Dimensionless(mu, beta, sigma, tau_d)
            rows.append(_row(numbers, outcome, float(point["amplitude"]), float(point["omega"])))
    return rows


def _row(numbers: Dimensionless, outcome: str, amplitude: float, omega: float) -> Row:
    predicted = predicted_cycle(numbers)
    exact = locked_cycles(numbers)
    grows = outcome == "growing"
    locked = None if grows else _nearest(exact, amplitude, omega)
    amplitude_error = frequency_error = math.nan
    if predicted is not None and not grows:
        amplitude_error, frequency_error = predicted.amplitude / amplitude - 1.0, predicted.omega / omega - 1.0
        agrees = abs(amplitude_error) <= AMPLITUDE_TOLERANCE and abs(frequency_error) <= FREQUENCY_TOLERANCE
    else:
        agrees = predicted is None and grows
    return Row(
        tau_d=numbers.tau_d,
        beta=numbers.beta,
        sigma=numbers.sigma,
        region=region(numbers),
        outcome=outcome,
        predicted=predicted,
        amplitude=amplitude,
        omega=math.nan if grows else omega,
        amplitude_error=amplitude_error,
        frequency_error=frequency_error,
        locked=locked,
        agrees=agrees,
        why="" if agrees else _why(predicted, exact, locked, grows, amplitude),
    )


def _nearest(exact: Sequence[LockedCycle], amplitude: float, omega: float) -> LockedCycle | None:
    for cycle in exact:
        if abs(cycle.amplitude / amplitude - 1.0) < _SAME and abs(cycle.omega / omega - 1.0) < _SAME:
            return cycle
    return None


def _why(
    predicted: LimitCycle | None,
    exact: Sequence[LockedCycle],
    locked: LockedCycle | None,
    grows: bool,
    amplitude: float,
) -> str:
    if predicted is None:
        return f"no stable cycle is predicted, but the sampled loop has one at {amplitude:.3g} ticks"
    if grows:
        return "a stable cycle is predicted, but the sampled loop grows past it"
    if locked is not None:
        p = [cycle.half_period for cycle in exact]
        return (
            f"locked to {2 * locked.half_period} periods, one of {len(p)} exact cycles ({2 * p[0]} to {2 * p[-1]} periods); "
            f"predicted {2.0 * math.pi / predicted.omega:.2f}"
        )
    if amplitude >= 1.0:
        return "above one tick: sampler and encoder edges together make a ladder of cycles there"
    return "not a symmetric cycle of two equal halves: it wanders between neighbouring exact cycles, or is lopsided"
