"""The four releases of Fig. 8 (Sec. V) by a plain loop over the plant: dimensionless, and in SI through the kernels."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from hapticd.config import parse_config
from hapticd.plant import kernel
from hapticd.plant.exact import propagate

J, B, C, K = 6.28e-6, 9.0e-6, 2.0e-3, 0.012
RAW = 2.0 * math.pi / 8192
GONE = 1e9


@dataclass
class Release:
    """End of a run.

    Attributes:
        position: final position in coarse ticks.
        periods: whole periods after which the mass still moved.
        tail: span of the position over the last tenth of the run, in coarse ticks.
    """

    position: float
    periods: int
    tail: float


def dimensionless(rate: float, decimation: int, deflection: float, periods: int) -> Release:
    period, tick = 1.0 / rate, decimation * RAW
    mu, beta, sigma = J / (K * period**2), B / (K * period), C / (K * tick)
    xi, xi_dot, moved = deflection, 0.0, 0
    tail: list[float] = []
    for h in range(periods):
        before = xi
        xi, xi_dot = propagate(xi, xi_dot, 1.0, -(math.floor(xi) + 0.5), mu, beta, sigma)
        if xi != before and xi_dot != 0.0:
            moved = h + 1
        if 10 * h >= 9 * periods:
            tail.append(xi)
        if abs(xi) > GONE:
            break
    return Release(xi, moved, max(tail, default=xi) - min(tail, default=xi))


def in_si(
    rate: float, decimation: int, deflection: float, periods: int, held: bool = False, **amplifier: Any
) -> Release:
    config = parse_config({"encoder": {"decimation": decimation}, "amplifier": amplifier}, "test")
    kt, tick = config.amplifier.torque_constant, decimation * RAW
    f = kernel.init_plant(config, deflection * tick)
    i = f.view(np.int64)
    if held:
        f[kernel.CURRENT] = -K * tick * (math.floor(deflection) + 0.5) / kt
    moved = 0
    for h in range(periods + 1):
        before = f[kernel.POSITION]
        ns = round(h * 1e9 / rate)
        kernel.plant_advance(f, i, ns, 0.0)
        if f[kernel.POSITION] != before and f[kernel.VELOCITY] != 0.0:
            moved = h
        ticks = kernel.plant_counts(f, i) // decimation
        kernel.plant_command(f, i, ns, 0.0, -K * tick * (ticks + 0.5) / kt)
    return Release(f[kernel.POSITION] / tick, moved, 0.0)


def test_case_a_stops_within_a_tick() -> None:
    run = dimensionless(1000.0, 217, 20.3, 1000)
    assert run.position == pytest.approx(-0.7251395694, abs=1e-9)
    assert (run.periods, run.tail) == (649, 0.0)


def test_case_b_oscillates_for_ever_by_about_a_hundredth_of_a_tick() -> None:
    # Several limit cycles of 0.009 to 0.02 tick lie side by side; which one it is depends on the last digits.
    run = dimensionless(1000.0, 2172, 3.3, 50_000)
    assert run.periods == 50_000
    assert 0.008 < run.tail / 2 < 0.02


def test_case_c_stops_within_seven_periods() -> None:
    run = dimensionless(100.0, 217, 2.3, 100)
    assert run.position == pytest.approx(-0.9322, abs=5e-5)
    assert run.periods == 7


def test_case_d_grows_without_bound() -> None:
    assert abs(dimensionless(100.0, 217, 10.3, 10_000).position) > GONE


@pytest.mark.parametrize(("rate", "decimation", "deflection"), [(1000.0, 217, 20.3), (100.0, 217, 2.3)])
def test_the_kernels_in_si_end_where_the_dimensionless_loop_does(
    rate: float, decimation: int, deflection: float
) -> None:
    plain = dimensionless(rate, decimation, deflection, 1000)
    through = in_si(rate, decimation, deflection, 1000, bandwidth_hz=0, dac_bits=0)
    assert through.position == pytest.approx(plain.position, abs=1e-9)
    assert through.periods == plain.periods


def test_case_a_through_the_real_amplifier_ends_elsewhere_in_the_same_tick() -> None:
    """3 kHz, 14 bits over ±6 A; the motor is without current until the first command takes effect, T_A after it."""
    run = in_si(1000.0, 217, 20.3, 1000)
    assert run.position == pytest.approx(-0.6601340965, abs=1e-9)
    assert run.periods == 696


def test_case_a_held_by_its_own_current_before_the_release() -> None:
    """The same, if the motor already has the current of the deflection during the first T_A."""
    run = in_si(1000.0, 217, 20.3, 1000, held=True)
    assert run.position == pytest.approx(-0.7586, abs=5e-5)
    assert run.periods == 689
