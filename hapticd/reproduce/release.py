"""The release experiments of Sec. V in the servo loop, in virtual time: its samples, and when the shaft came to rest."""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass
from typing import Any

import numpy as np

from hapticd.config import Config, apply_settings, load_config
from hapticd.servo.simulate import simulate
from hapticd.stability.maps import PointArray, run_points
from hapticd.stability.numbers import Dimensionless, from_config
from hapticd.stability.storage import FloatArray, equivalent_velocity


@dataclass(frozen=True)
class Case:
    """One of the four runs of Fig. 8.

    Attributes:
        name: ``a`` … ``d``.
        region: of its operating point.
        rate_hz: servo rate.
        decimation: raw counts per coarse tick.
        deflection: of the release, in coarse ticks.
        periods: length of the run.
        shown: number of periods in the figure.
    """

    name: str
    region: str
    rate_hz: int
    decimation: int
    deflection: float
    periods: int
    shown: int


CASES = (
    Case("a", "A", 1000, 217, 20.3, 1500, 800),
    Case("b", "B", 1000, 2172, 3.3, 20_000, 3000),
    Case("c", "E", 100, 217, 2.3, 60, 40),
    Case("d", "D", 100, 217, 10.3, 400, 60),
)


@dataclass(frozen=True)
class Release:
    """Result of a run.

    Attributes:
        case: the case.
        numbers: its operating point.
        xi_dot_max: velocity with the energy of the release.
        time_s: (n,) time of each sample. xi: (n,) encoder reading in coarse ticks, with the resolution of a raw count.
        report: of `hapticd.servo.simulate.simulate`.
        rest_periods: whole periods until it stays at rest; None if it does not.
    """

    case: Case
    numbers: Dimensionless
    xi_dot_max: float
    time_s: FloatArray
    xi: FloatArray
    report: dict[str, Any]
    rest_periods: int | None


def release(case: Case, *, damping_ratio: float | None = None) -> Release:
    """Run one case.

    Args:
        case: the case.
        damping_ratio: δ_A of the 3 kHz, 14-bit amplifier of Sec. V; None for an ideal amplifier.
    """
    config = config_of(case, damping_ratio)
    rows: list[Any] = []
    report = simulate(config, case.periods / case.rate_hz, deflection=case.deflection, on_rows=rows.append)
    sampled = np.concatenate(rows)
    numbers = from_config(config)
    return Release(
        case=case,
        numbers=numbers,
        xi_dot_max=float(equivalent_velocity(case.deflection, numbers.mu)),
        time_s=np.asarray(sampled["time_s"] - sampled["time_s"][0], dtype=np.float64),
        xi=np.asarray((sampled["encoder_counts"] - config.origin_counts) / case.decimation, dtype=np.float64),
        report=report,
        rest_periods=_rest(config, case) if report["at_rest"] else None,
    )


def oscillation(run: Release) -> tuple[float, float]:
    """Amplitude in coarse ticks (half of peak to peak) and frequency in Hz over the last fifth of a run."""
    tail = slice(-run.xi.size // 5, None)
    xi, time = run.xi[tail], run.time_s[tail]
    up = np.flatnonzero((xi[:-1] < 0.0) & (xi[1:] >= 0.0))
    cycles, lasted = up.size - 1, time[up[-1]] - time[up[0]]
    return 0.5 * float(np.ptp(xi)), float(cycles / lasted)


def neighbours(case: Case, spread: float, count: int) -> PointArray:
    """Results of releases within ±`spread` ticks of the case, by the kernel of the maps; (count,) of `maps.POINT`."""
    n = from_config(config_of(case))
    xi = case.deflection + np.linspace(-spread, spread, count)
    beta, sigma = np.full(count, n.beta), np.full(count, n.sigma)
    return run_points(n.mu, beta, sigma, 0.0, np.zeros(count), case.periods, xi=xi)


def config_of(case: Case, damping_ratio: float | None = None) -> Config:
    """The configuration of a case; see `release`."""
    settings = {"servo.rate_hz": str(case.rate_hz), "encoder.decimation": str(case.decimation)}
    if damping_ratio is None:
        settings |= {"amplifier.bandwidth_hz": "0", "amplifier.dac_bits": "0"}
    else:
        settings |= {"amplifier.damping_ratio": f"{damping_ratio:g}"}
    return apply_settings(load_config("re35"), settings, source="reproduce")


def _rest(config: Config, case: Case) -> int:
    """The longest run at whose end the shaft still moves, by bisection: once at rest, it stays at rest."""

    def stands(periods: int) -> bool:
        return bool(simulate(config, periods / case.rate_hz, deflection=case.deflection)["at_rest"])

    return bisect_left(range(1, case.periods), True, key=stands)
