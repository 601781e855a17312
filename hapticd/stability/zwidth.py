"""The Z-width of a device: which stiffness K it renders with which virtual damping B, by exact simulation.

Colgate and Brown ("Factors affecting the Z-width of a haptic display", ICRA 1994) call so the range of impedances that a
device renders passively. Here every point of the (B, K) plane is run exactly, in four variants: with or without ticks, with
or without Coulomb friction. The motion passes the spring's origin at a given speed. A point is *calm* if its motion dies
out, or ends in an oscillation of less than one tick: without Coulomb friction, ticks leave nothing a place to rest.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapticd.config import Config
from hapticd.stability.damping import damper_from_config, passive_stiffness
from hapticd.stability.maps import GROWING, PERSISTENT
from hapticd.stability.numbers import Loop, loop_from_config
from hapticd.stability.sampled_loop import run_in_threads
from hapticd.stability.storage import FloatArray
from hapticd.stability.whole_loop import blank

#: Whether the loop sees ticks, whether the device has Coulomb friction.
VARIANTS: Final = {
    "linear": (False, False),
    "coulomb": (False, True),
    "ticks": (True, False),
    "ticks and coulomb": (True, True),
}
DIES_OUT, BELOW_ONE_TICK, ABOVE_ONE_TICK, GROWS = range(4)
_PRESCAN: Final = 20
_PRESCAN_PERIODS: Final = 1000


@dataclass(frozen=True)
class ZWidth:
    """A Z-width.

    Attributes:
        config: of the device. loop: it in SI units.
        velocity: at which the motion passes the origin, ticks per period. periods: the horizon.
        damping: (n,) B in N m s/rad or N s/m, from 0. stiffness: (m,) K in N m/rad or N/m, evenly from one step above 0.
        outcome: of each of `VARIANTS` (n, m): DIES_OUT, BELOW_ONE_TICK, ABOVE_ONE_TICK or GROWS.
        passive: (n,) largest K that is passive (Colgate and Schenkel; with delay λ), 0 where none.
    """

    config: Config
    loop: Loop
    velocity: float
    periods: int
    damping: FloatArray
    stiffness: FloatArray
    outcome: dict[str, NDArray[np.int8]]
    passive: FloatArray

    def largest(self, variant: str) -> FloatArray:
        """(n,) largest K below which the variant is calm throughout; 0 where not even the smallest is."""
        calm = self.outcome[variant] <= BELOW_ONE_TICK
        softer = np.where(calm.all(axis=1), calm.shape[1], np.argmin(calm, axis=1))
        return np.asarray(np.append(0.0, self.stiffness)[softer])

    @property
    def report(self) -> dict[str, Any]:
        """The JSON document."""
        most = {}
        for variant in VARIANTS:
            limit = self.largest(variant)
            best = int(np.argmax(limit))
            most[variant] = {
                "stiffness": float(limit[best]),
                "damping": float(self.damping[best]),
                "without_damping": float(limit[0]),
                "calm": float((self.outcome[variant] <= BELOW_ONE_TICK).mean()),
            }
        return {
            "velocity_ticks_per_period": self.velocity,
            "periods": self.periods,
            "points": self.damping.size * self.stiffness.size,
            "damping_max": float(self.damping[-1]),
            "stiffness_max": float(self.stiffness[-1]),
            "largest_calm": most,
            "passive_stiffness": float(self.passive[0]),
        }


def zwidth(
    config: Config,
    latency_s: float,
    *,
    velocity: float = 10.0,
    count: int = 48,
    periods: int = 4000,
    damping_max: float | None = None,
    stiffness_max: float | None = None,
    jobs: int | None = None,
) -> ZWidth:
    """Work out the Z-width of a device with the velocity estimate of its config.

    Args:
        config: of the device; its ``spring.stiffness`` and ``spring.damping`` do not matter.
        latency_s: the driver's declared latency.
        velocity: at which every motion passes the origin, ticks per period.
        count: points along each axis. periods: horizon, at least 12.
        damping_max, stiffness_max: ends of the axes; None for what the linear loop needs.
        jobs: threads; None for one per core that this process may use.

    Raises:
        ValueError: the velocity is not above 0.
    """
    if not velocity > 0.0:
        raise ValueError(f"the velocity must be above 0, got {velocity:g}")
    loop = loop_from_config(config, latency_s)
    if damping_max is None or stiffness_max is None:
        found = _extent(config, loop, jobs)
        damping_max, stiffness_max = damping_max or found[0], stiffness_max or found[1]
    B = np.linspace(0.0, damping_max, count)
    K = stiffness_max * np.arange(1, count + 1) / count
    outcome = {
        variant: _outcomes(run_in_threads(_loops(config, loop, B, K, variant, velocity), periods, jobs))
        for variant in VARIANTS
    }
    return ZWidth(config, loop, velocity, periods, B, K, outcome, passive_stiffness(config, loop, B))


def _outcomes(runs: NDArray[Any]) -> NDArray[np.int8]:
    persistent = np.where(runs["amplitude"] < 1.0, BELOW_ONE_TICK, ABOVE_ONE_TICK)
    outcomes = np.where(
        runs["outcome"] == GROWING, GROWS, np.where(runs["outcome"] == PERSISTENT, persistent, DIES_OUT)
    )
    return outcomes.astype(np.int8)


def _loops(
    config: Config, loop: Loop, damping: FloatArray, stiffness: FloatArray, variant: str, velocity: float
) -> NDArray[Any]:
    """The loops of a grid; (n, m) of `LOOP`."""
    ticks, friction = VARIANTS[variant]
    loops = blank((damping.size, stiffness.size))
    for column, K in enumerate(stiffness.tolist()):
        here = replace(loop, stiffness=K)
        numbers, damper = here.numbers, damper_from_config(config, here)
        for name in ("mu", "beta", "tau_d", "kappa"):
            loops[name][:, column] = getattr(numbers, name)
        loops["sigma"][:, column] = numbers.sigma if friction else 0.0
        loops["beta_v"][:, column] = damping / (K * loop.period)
        loops["periods"], loops["keep"] = damper.periods, damper.keep
    loops["ticks"], loops["xi_dot"] = ticks, velocity
    return loops


def _extent(config: Config, loop: Loop, jobs: int | None) -> tuple[float, float]:
    """Damping and stiffness a little beyond which the linear loop is calm nowhere."""
    B = np.append(0.0, np.geomspace(0.01, 8.0, _PRESCAN) * loop.inertia / loop.period)
    K = np.geomspace(1e-4, 4.0, 2 * _PRESCAN) * loop.inertia / loop.period**2
    calm = _outcomes(run_in_threads(_loops(config, loop, B, K, "linear", 1.0), _PRESCAN_PERIODS, jobs))
    calm_B, calm_K = np.nonzero(calm == DIES_OUT)
    if calm_B.size == 0:
        return float(B[-1]), float(K[0])
    return 1.3 * float(B[calm_B.max()]), 1.4 * float(K[calm_K.max()])
