"""The theorem, tested: random trajectories under each form of the criterion, simulated exactly.

Operating points are drawn where a criterion allows them, half of them on its very edge, motions start at the origin,
anywhere near it or just below an encoder edge, and every trajectory is checked for the velocity and acceleration bounds
that the theorem presupposes before it is counted. Under the corrected and the sharp criterion energy must never rise.
Under the paper's (12) and (19) it does, at some; how many depends on how they are drawn, so `draw` says it exactly.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapticd.stability.criterion import Criterion, dissipation_margin, xi_ddot_bound
from hapticd.stability.map_kernel import HORIZON, RECURRED, REST
from hapticd.stability.outcome import decide
from hapticd.stability.storage import FloatArray, storage, velocity_bound
from tests.stability import theorem_kernel as kernel

#: A bound counts as kept up to the rounding of the simulation.
_ROUNDING: Final = 1e-9
#: Where delay and inertia leave no σ that suffices (or only absurd ones), nothing is drawn.
_LARGEST_SHARE: Final = 0.9
_BATCH: Final = 1000


@dataclass(frozen=True)
class Draw:
    """Trajectories to check, all arrays (n,), in ticks and periods.

    Attributes:
        mu: inertia μ.
        beta: viscous friction β.
        sigma: Coulomb friction σ, at or above what the criterion asks for.
        tau_d: delay τ_D.
        xi: ξ₀.
        xi_dot: ξ̇₀.
        xi_dot_max: the bound (13) that follows from the start.
        xi_ddot_max: the a-priori bound (20).
    """

    mu: FloatArray
    beta: FloatArray
    sigma: FloatArray
    tau_d: FloatArray
    xi: FloatArray
    xi_dot: FloatArray
    xi_dot_max: FloatArray
    xi_ddot_max: FloatArray


@dataclass(frozen=True)
class Counterexample:
    """A trajectory along which energy rises."""

    mu: float
    beta: float
    sigma: float
    tau_d: float
    xi: float
    xi_dot: float
    period: int
    relative_rise: float


@dataclass(frozen=True)
class Verdict:
    """What became of many trajectories under one criterion.

    Attributes:
        criterion: the criterion.
        drawn: trajectories simulated.
        bounds_broken: trajectories that left the velocity or acceleration bound; they are not counted below, because the
            theorem says nothing of them.
        counted: the others.
        rising: of these, trajectories with at least one rise of energy beyond rounding.
        rises: number of rises in all.
        periods: simulated periods in all.
        largest_change: largest relative change of energy over a period; negative where it always fell.
        at_rest: trajectories that came to rest within the horizon of the run to the fate.
        falling: those still moving there with energy falling.
        persistent: those that recur.
        growing: those that grow.
        smallest: the counterexample with the earliest rise, the lowest energy among equals; None without a rise.
    """

    criterion: Criterion
    drawn: int
    bounds_broken: int
    counted: int
    rising: int
    rises: int
    periods: int
    largest_change: float
    at_rest: int
    falling: int
    persistent: int
    growing: int
    smallest: Counterexample | None

    @property
    def share_rising(self) -> float:
        """Share of the counted trajectories with a rise."""
        return self.rising / self.counted if self.counted else 0.0


def draw(criterion: Criterion, count: int, rng: np.random.Generator) -> Draw:
    """Draw trajectories to which a criterion applies.

    μ is log-uniform over [1, 10⁴]; τ_D is 0 for half and uniform over [0, 2] for half; β is 0, log-uniform over [10⁻³, √10]
    or uniform over [0.3, 0.7], a third each; |ξ̇₀| is log-uniform over [10⁻², 10²], either sign; ξ₀ is 0, uniform over
    [−3, 3], or 10⁻⁹ below the first encoder edge, a third each. σ is the least that the criterion allows for half, and up
    to 30 % above it, uniformly, for half.
    """
    mu = 10.0 ** rng.uniform(0.0, 4.0, count)
    tau_d = np.where(rng.random(count) < 0.5, 0.0, rng.uniform(0.0, 2.0, count))
    while (tight := (tau_d * tau_d + tau_d) / mu > _LARGEST_SHARE).any():
        mu[tight] = 10.0 ** rng.uniform(0.0, 4.0, int(tight.sum()))
    kind = rng.integers(0, 3, count)
    beta = np.choose(kind, [np.zeros(count), 10.0 ** rng.uniform(-3.0, 0.5, count), rng.uniform(0.3, 0.7, count)])
    xi_dot = 10.0 ** rng.uniform(-2.0, 2.0, count) * rng.choice([-1.0, 1.0], count)
    kind = rng.integers(0, 3, count)
    xi = np.choose(kind, [np.zeros(count), rng.uniform(-3.0, 3.0, count), np.full(count, 1.0 - 1e-9)])
    bound = velocity_bound(xi, xi_dot, mu, tau_d)
    excess = np.where(rng.random(count) < 0.5, 1.0, rng.uniform(1.0, 1.3, count))
    sigma = least_sigma(criterion, mu, beta, tau_d, bound) * excess
    return Draw(mu, beta, sigma, tau_d, xi, xi_dot, bound, xi_ddot_bound(mu, beta, sigma, bound))


def least_sigma(
    criterion: Criterion, mu: FloatArray, beta: FloatArray, tau_d: FloatArray, xi_dot_max: FloatArray
) -> FloatArray:
    """The least σ for which a criterion holds, correct to the last bit and on its right side.

    The margin rises with σ wherever (τ_D² + τ_D) < μ, so bisection finds it; all arrays (n,).
    """
    low, high = np.zeros_like(mu), np.ones_like(mu)
    while (short := dissipation_margin(mu, beta, high, tau_d, xi_dot_max, criterion) < 0.0).any():
        high = np.where(short, 2.0 * high, high)
    for _ in range(64):
        middle = 0.5 * (low + high)
        enough = dissipation_margin(mu, beta, middle, tau_d, xi_dot_max, criterion) >= 0.0
        low, high = np.where(enough, low, middle), np.where(enough, middle, high)
    return high


def check(
    criterion: Criterion,
    count: int,
    seed: int,
    *,
    periods: int = 3000,
    fate_periods: int = 50_000,
    jobs: int | None = None,
    progress: Callable[[float], None] | None = None,
) -> Verdict:
    """Draw and simulate trajectories under one criterion.

    Args:
        criterion: which criterion.
        count: number of trajectories.
        seed: of the draw; the same seed gives the same verdict whatever `jobs` is.
        periods: horizon over which energy is compared.
        fate_periods: horizon of a second run that asks what becomes of the motion.
        jobs: number of threads; None for one per core that this process may use.
        progress: called with the fraction done.
    """
    sizes = [min(_BATCH, count - start) for start in range(0, count, _BATCH)]
    streams = np.random.SeedSequence(seed).spawn(len(sizes))

    def one(k: int) -> Verdict:
        return _check_batch(
            criterion, draw(criterion, sizes[k], np.random.default_rng(streams[k])), periods, fate_periods
        )

    verdicts = []
    with ThreadPoolExecutor(jobs or len(os.sched_getaffinity(0)), thread_name_prefix="theorem") as pool:
        for verdict in pool.map(one, range(len(sizes))):
            verdicts.append(verdict)
            if progress is not None:
                progress(len(verdicts) / len(sizes))
    return _sum(criterion, verdicts)


def _check_batch(criterion: Criterion, d: Draw, periods: int, fate_periods: int) -> Verdict:
    counts, extremes, peaks = kernel.work_space(d.mu.size)
    kernel.check_all(
        d.mu, d.beta, d.sigma, d.tau_d, d.xi, d.xi_dot, periods, fate_periods, counts, extremes, peaks
    )  # fmt: skip
    kept = (extremes[:, kernel.TOP_SPEED] <= d.xi_dot_max * (1.0 + _ROUNDING)) & (
        extremes[:, kernel.TOP_ACCELERATION] <= d.xi_ddot_max * (1.0 + _ROUNDING)
    )
    fates = list(_fates(counts, peaks))
    rising = kept & (counts[:, kernel.RISES] > 0)
    return Verdict(
        criterion=criterion,
        drawn=d.mu.size,
        bounds_broken=int((~kept).sum()),
        counted=int(kept.sum()),
        rising=int(rising.sum()),
        rises=int(counts[kept, kernel.RISES].sum()),
        periods=int(counts[:, kernel.PERIODS].sum()),
        largest_change=float(extremes[kept, kernel.LARGEST_RISE].max(initial=-np.inf)),
        at_rest=fates.count("rest"),
        falling=fates.count("falling"),
        persistent=fates.count("persistent"),
        growing=fates.count("growing"),
        smallest=_smallest(d, counts, extremes, rising),
    )


def _fates(counts: NDArray[np.int64], peaks: FloatArray) -> Iterator[str]:
    for row, tail in zip(counts, peaks, strict=True):
        if row[kernel.REASON] == REST:
            yield "rest"
        elif row[kernel.REASON] == RECURRED:
            yield "persistent"
        else:
            outcome = decide(bool(row[kernel.ROSE]), tail, False, row[kernel.REASON] != HORIZON)
            yield outcome if outcome in ("persistent", "growing") else "falling"


def _smallest(
    d: Draw, counts: NDArray[np.int64], extremes: FloatArray, rising: NDArray[np.bool_]
) -> Counterexample | None:
    if not rising.any():
        return None
    energy = storage(d.xi, d.xi_dot, d.mu)
    k = min(np.flatnonzero(rising).tolist(), key=lambda i: (counts[i, kernel.FIRST_RISE], energy[i]))
    return Counterexample(
        mu=float(d.mu[k]),
        beta=float(d.beta[k]),
        sigma=float(d.sigma[k]),
        tau_d=float(d.tau_d[k]),
        xi=float(d.xi[k]),
        xi_dot=float(d.xi_dot[k]),
        period=int(counts[k, kernel.FIRST_RISE]),
        relative_rise=float(extremes[k, kernel.LARGEST_RISE]),
    )


def _sum(criterion: Criterion, parts: list[Verdict]) -> Verdict:
    def total(name: str) -> int:
        return sum(getattr(part, name) for part in parts)

    smallest = [part.smallest for part in parts if part.smallest is not None]
    return Verdict(
        criterion=criterion,
        drawn=total("drawn"),
        bounds_broken=total("bounds_broken"),
        counted=total("counted"),
        rising=total("rising"),
        rises=total("rises"),
        periods=total("periods"),
        largest_change=max((part.largest_change for part in parts), default=-np.inf),
        at_rest=total("at_rest"),
        falling=total("falling"),
        persistent=total("persistent"),
        growing=total("growing"),
        smallest=min(
            smallest,
            key=lambda c: (c.period, float(storage(c.xi, c.xi_dot, c.mu))),
            default=None,
        ),
    )
