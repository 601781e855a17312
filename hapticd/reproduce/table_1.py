"""Table I: conversion of signals and parameters to dimensionless ones and back, for the rig of Sec. V; (10), (11)."""

from __future__ import annotations

import math
from dataclasses import replace

from hapticd.config import apply_settings, load_config
from hapticd.reproduce.items import Comparison, Item, Progress, Table, compare
from hapticd.stability.boundary import boundary
from hapticd.stability.criterion import SAMPLING_FACTOR, sampling_bound_ok, sampling_ratio
from hapticd.stability.numbers import Dimensionless, Loop, loop_from_config, physical

DECIMATION = 217
RATE_HZ = 1000.0
# an example delay, position, velocity, force and time, in SI units
DELAY_S, POSITION, VELOCITY, FORCE, TIME_S = 2e-4, 0.5, 30.0, 4e-3, 0.25


def build(quick: bool, progress: Progress) -> Item:
    """Build the item."""
    settings = {"encoder.decimation": str(DECIMATION), "servo.rate_hz": f"{RATE_HZ:g}", "amplifier.bandwidth_hz": "0"}
    config = apply_settings(load_config("re35"), settings, source="reproduce")
    loop = replace(loop_from_config(config), delay=DELAY_S)
    numbers = loop.numbers
    back = physical(numbers, loop.scales)
    rows = _rows(loop, back)
    return Item(
        name="table1",
        title="Table I: dimensionless signals and parameters",
        see=(
            "An example in both directions: the RE35 rig of Sec. V at 1 kHz with decimation 217, K = 0.012 N m/rad and, for "
            "the example, 0.2 ms of delay. Position is counted in encoder ticks, time in sampling intervals, force in the "
            "force of one tick; three of the six physical parameters disappear.",
            "Below, the sampling bound (10, 11): μ ≫ 1/π² says that the loop samples faster than the spring can swing.",
        ),
        traps=(
            "The paper gives no stiffness for its experiment. K = 0.012 N m/rad is chosen so that its four cases come out "
            "(Fig. 8).",
        ),
        tables=(
            Table(("quantity", "physical", "unit", "formula", "dimensionless", "back", "relative error"), rows),
        ),
        comparisons=_comparisons(loop),
        numbers={
            "mu": numbers.mu, "beta": numbers.beta, "sigma": numbers.sigma, "tau_d": numbers.tau_d,
            "sampling_ratio": sampling_ratio(numbers), "sampling_bound_ok": sampling_bound_ok(numbers),
            "largest_relative_error": max(abs(float(row[6])) for row in rows),
        },
    )  # fmt: skip


def _rows(loop: Loop, back: Loop) -> list[tuple[str | float, ...]]:
    n, s = loop.numbers, loop.scales
    tau, xi, xi_dot, phi = (
        s.time_to_tau(TIME_S), s.position_to_xi(POSITION), s.velocity_to_xi_dot(VELOCITY), s.force_to_phi(FORCE),
    )  # fmt: skip
    given = (
        ("time", TIME_S, "s", "τ = t/T", tau, s.tau_to_time(tau)),
        ("position", POSITION, "rad", "ξ = x/Δ", xi, s.xi_to_position(xi)),
        ("velocity", VELOCITY, "rad/s", "ξ̇ = ẋT/Δ", xi_dot, s.xi_dot_to_velocity(xi_dot)),
        ("force", FORCE, "N m", "φ = F/(KΔ)", phi, s.phi_to_force(phi)),
        ("loop delay", loop.delay, "s", "τ_D = T_D/T", n.tau_d, back.delay),
        ("inertia", loop.inertia, "kg m²", "μ = m/(KT²)", n.mu, back.inertia),
        ("viscous friction", loop.viscous, "N m s/rad", "β = b/(KT)", n.beta, back.viscous),
        ("Coulomb friction", loop.coulomb, "N m", "σ = c/(KΔ)", n.sigma, back.coulomb),
    )
    return [(*row, row[5] / row[1] - 1.0) for row in given]


def _comparisons(loop: Loop) -> list[Comparison]:
    n = loop.numbers
    # the μ at which the sampling frequency is exactly twice the natural frequency
    bound = 1.0 / sampling_ratio(Dimensionless(1.0, 0.0, 0.0)) ** 2
    beta = boundary(lambda beta: mahvash_hayward_margin(beta, 1.0, 1.0), 8.0, 0.5)
    return [
        compare("μ of the rig at 1 kHz", "independent simulation", 523.0, n.mu, 0.5),
        compare("β of the rig at 1 kHz", "independent simulation", 0.75, n.beta, 0.005),
        compare("σ of the rig, decimation 217", "independent simulation", 1.00, n.sigma, 0.005),
        compare(
            "least μ without aliasing", "paper, eq. 11: 1/π²", 1.0 / math.pi**2, bound, 1e-12,
            note=f"“≫” is read as {SAMPLING_FACTOR:g} times",
        ),
        compare(
            "β of Mahvash and Hayward, τ_D = 1", "paper, Sec. III-D", 2.0, beta, 1e-9,
            note="from the second condition of (19), with ξ̈_max = σ/(βτ_D) and no quantisation",
        ),
    ]  # fmt: skip


def mahvash_hayward_margin(beta: float, sigma: float, tau_d: float) -> float:
    """σ − ξ̈_max(τ_D² + τ_D), the second condition of (19) without ticks, with their ξ̈_max = σ/(βτ_D).

    It is σ(1 − (1 + τ_D)/β), so that τ_D = 1 gives their β ≥ 2; the first condition, β ≥ 3/2 then, follows.
    """
    return sigma - sigma / (beta * tau_d) * (tau_d * tau_d + tau_d)
