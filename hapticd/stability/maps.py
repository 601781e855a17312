"""Region maps (Sec. IV, Fig. 6 and 7): outcome of a motion at every point of a (β, σ) grid, by exact simulation.

Outcome of a point, by rules without absolute thresholds:

1. ``growing`` if it reached a state from which growth is certain (`hapticd.stability.escape`).
2. At rest, and stiction holds every later force: ``monotone`` if the energy never rose, else ``decaying``.
3. Its state recurred bit for bit: ``persistent``.
4. Still undecided at the horizon: the trend of the energy over the second half decides (`outcome.decide`), except where
   it would contradict a proven fact (`sampled_loop`); then it is ``persistent``.

Only rule 4 depends on the horizon. With a delay, energies are compared at h + τ_D, as in the theorem.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapticd.stability.outcome import STRETCHES, TREND_TOLERANCE
from hapticd.stability.sampled_loop import HORIZON, RECURRED, REST, run_loops
from hapticd.stability.storage import FloatArray
from hapticd.stability.whole_loop import blank

#: Result of a point. ``reason`` is one of `sampled_loop`'s; ``cycle`` is 0 if no exact recurrence was found;
#: ``amplitude`` is half of peak to peak in ticks, 0 at rest, infinite when growing; ``omega`` is in rad per period;
#: ``settled``: at rest, recurring, or energy constant over the last stretches within 1 %.
POINT: Final = np.dtype(
    [
        ("outcome", np.int8),
        ("reason", np.int8),
        ("settled", np.bool_),
        ("periods", np.int64),
        ("cycle", np.int64),
        ("xi", np.float64),
        ("xi_dot", np.float64),
        ("amplitude", np.float64),
        ("omega", np.float64),
    ],
    align=True,
)

PointArray = NDArray[Any]

# A chunk is one task of a worker: a few milliseconds for the eight maps, more points in a finer study, and if possible never
# more periods than this.
_CHUNK_POINTS: Final = 84
_CHUNKS: Final = 1000
_CHUNK_PERIODS: Final = 1 << 26


@dataclass(frozen=True)
class Study:
    """Which maps to make: one for every delay and initial velocity, each over the same number of points.

    Attributes:
        mu: inertia μ.
        delays: τ_D of each row of maps.
        velocities: ξ̇₀ of each column in ticks per period; motions start at ξ₀ = 0.
        beta_count: points along β, evenly over (0, beta_max].
        beta_max: largest β; None for 1.5 + τ_D, so that the boundary ½ + τ_D is drawn at the same place as without delay.
        sigma_count: points along σ, evenly over (0, sigma_max].
        sigma_max: largest σ.
        periods: horizon in sampling periods.

    Raises:
        ValueError: a number is out of its range; the message names it.
    """

    mu: float = 100.0
    delays: tuple[float, ...] = (0.0, 1.25)
    velocities: tuple[float, ...] = (1.0, 5.0, 10.0, 50.0)
    beta_count: int = 34
    beta_max: float | None = None
    sigma_count: int = 21
    sigma_max: float = 3.0
    periods: int = 50_000

    def __post_init__(self) -> None:
        positive = {
            "mu": self.mu,
            "sigma_max": self.sigma_max,
            "beta_max": 1.0 if self.beta_max is None else self.beta_max,
        }
        for name, value in positive.items():
            if not 0.0 < value < math.inf:
                raise ValueError(f"{name} must be above zero, got {value!r}")
        for name, least in (("beta_count", 1), ("sigma_count", 1), ("periods", 2 * STRETCHES)):
            if getattr(self, name) < least:
                raise ValueError(f"{name} must be at least {least}, got {getattr(self, name)!r}")
        for name in ("delays", "velocities"):
            values = getattr(self, name)
            if not values or not all(0.0 <= value < math.inf for value in values):
                raise ValueError(f"{name} must be one or more numbers of at least 0, got {list(values)!r}")
            if len(set(values)) < len(values):
                raise ValueError(f"{name} has a number twice: {list(values)!r}")

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """Delays, velocities, β, σ."""
        return len(self.delays), len(self.velocities), self.beta_count, self.sigma_count

    @property
    def size(self) -> int:
        """Number of points in all maps."""
        return math.prod(self.shape)

    def betas(self, tau_d: float) -> FloatArray:
        """(beta_count,) the β of a map with this delay."""
        largest = 1.5 + tau_d if self.beta_max is None else self.beta_max
        return np.asarray(largest * np.arange(1, self.beta_count + 1) / self.beta_count)

    @property
    def sigmas(self) -> FloatArray:
        """(sigma_count,) the σ of every map."""
        return np.asarray(self.sigma_max * np.arange(1, self.sigma_count + 1) / self.sigma_count)


@dataclass(frozen=True)
class Chunk:
    """Some neighbouring points of one map, the unit of work; self-contained, for any worker.

    Attributes:
        study: the maps it belongs to.
        delay: index into ``study.delays``.
        velocity: index into ``study.velocities``.
        start: first point of the map, β varying slowest.
        stop: one past the last.
    """

    study: Study
    delay: int
    velocity: int
    start: int
    stop: int


class Maps:
    """A study and its results so far.

    Attributes:
        study: which maps.
        points: `POINT` of shape ``study.shape``; zero where not done.
        done: bool of the same shape.
    """

    def __init__(self, study: Study) -> None:
        self.study = study
        self.points: PointArray = np.zeros(study.shape, POINT)
        self.done = np.zeros(study.shape, np.bool_)

    def missing(self) -> list[Chunk]:
        """The chunks with a point that is not done."""
        return [chunk for chunk in chunks(self.study) if not self.done[_place(chunk)].all()]

    def put(self, chunk: Chunk, points: PointArray) -> None:
        """Store the points of a chunk."""
        self.points[_place(chunk)] = points
        self.done[_place(chunk)] = True


def chunks(study: Study) -> list[Chunk]:
    """All chunks of a study, each within one map."""
    points = study.beta_count * study.sigma_count
    step = max(1, min(max(_CHUNK_POINTS, study.size // _CHUNKS), _CHUNK_PERIODS // study.periods))
    return [
        Chunk(study, d, v, start, min(start + step, points))
        for d in range(len(study.delays))
        for v in range(len(study.velocities))
        for start in range(0, points, step)
    ]


def _place(chunk: Chunk) -> tuple[int, int, NDArray[np.int64], NDArray[np.int64]]:
    beta, sigma = np.divmod(np.arange(chunk.start, chunk.stop), chunk.study.sigma_count)
    return chunk.delay, chunk.velocity, beta, sigma


def run_chunk(chunk: Chunk) -> PointArray:
    """Compute the points of a chunk; (stop − start,) of `POINT`. Takes no lock, and releases the GIL while it simulates."""
    study = chunk.study
    _, _, beta, sigma = _place(chunk)
    tau_d = study.delays[chunk.delay]
    velocity = np.full(beta.size, study.velocities[chunk.velocity])
    return run_points(study.mu, study.betas(tau_d)[beta], study.sigmas[sigma], tau_d, velocity, study.periods)


def run_points(
    mu: float,
    beta: FloatArray,
    sigma: FloatArray,
    tau_d: float,
    xi_dot: FloatArray,
    periods: int,
    *,
    xi: FloatArray | None = None,
    early: bool = True,
) -> PointArray:
    """Simulate and classify points of one μ and τ_D.

    Args:
        mu: inertia μ.
        beta: (n,) viscous friction β.
        sigma: (n,) Coulomb friction σ.
        tau_d: delay τ_D.
        xi_dot: (n,) initial velocity in ticks per period.
        periods: horizon, at least 12.
        xi: (n,) initial position in ticks; default 0.
        early: end a run when its outcome is certain. False: end it only at rest, beyond 10⁹ ticks and at the horizon, where
            rule 4 decides; for a test that early ends change nothing.

    Returns:
        (n,) of `POINT`.
    """
    loops = blank(beta.size)
    loops["mu"], loops["beta"], loops["sigma"], loops["tau_d"] = mu, beta, sigma, tau_d
    loops["xi"], loops["xi_dot"] = 0.0 if xi is None else xi, xi_dot
    loops["search"] = periods if early else 0
    runs = run_loops(loops, periods)
    points = np.zeros(beta.size, POINT)
    for name in set(POINT.names or ()) - {"settled"}:
        points[name] = runs[name]
    reason, first, last = runs["reason"], runs["peaks"][:, 0], runs["peaks"][:, -1]
    constant = np.abs(last - first) <= TREND_TOLERANCE * np.maximum(first, last)
    points["settled"] = np.where(reason == HORIZON, constant, np.isin(reason, (REST, RECURRED)))
    return points
