"""Fig. 6 and 7: region maps by exact simulation, compared with the theory region by region."""

from __future__ import annotations

from typing import Any

import numpy as np

from hapticd.reproduce.items import Cell, Comparison, Item, Progress, Table, compare
from hapticd.stability import map_report, map_store
from hapticd.stability.figures.map import draw
from hapticd.stability.map_engines import local
from hapticd.stability.maps import Maps, Study, run_points
from hapticd.stability.outcome import OUTCOMES

#: The paper's number of grid points; the points and the four velocities are not known.
PAPER_POINTS = 714
PAPER_PERIODS = 50_000
_QUICK_PERIODS = 10_000
_QUICK_COUNTS = (17, 11)
# at the edge of B: initial velocity, reference amplitude, its rounding
_EDGE_BETA = 0.505
_EDGE = ((1.0, 8.7, 0.05), (5.0, 32.0, 0.5))
_SHADES = {"monotone": "white", "decaying": "light", "persistent": "medium", "growing": "dark"}


def fig_6(quick: bool, progress: Progress) -> Item:
    """Four maps without delay."""
    see = (
        "White and light: comes to rest. Medium: oscillates without end. Dark: grows. Red: the paper's boundaries for the "
        "velocity of each map. With rising initial velocity the critical line turns about (½, ½) and the dark area "
        "follows it from below: the criterion is a worst case, and the stable area is larger than its region.",
    )
    return _item("fig6", "Fig. 6: simulated regions without delay", 0.0, see, quick, progress)


def fig_7(quick: bool, progress: Progress) -> Item:
    """Four maps with τ_D = 1.25."""
    see = (
        "The same with τ_D = 1.25: the vertical border has moved from ½ to 1.75, and more friction is needed everywhere. "
        "F1, which is proven, comes to rest at every point. For fast motions E and F1 lie above the picture.",
    )
    return _item("fig7", "Fig. 7: simulated regions with delay", 1.25, see, quick, progress)


def _item(name: str, title: str, tau_d: float, see: tuple[str, ...], quick: bool, progress: Progress) -> Item:
    study = Study(delays=(tau_d,))
    if quick:
        beta_count, sigma_count = _QUICK_COUNTS
        study = Study(delays=(tau_d,), beta_count=beta_count, sigma_count=sigma_count, periods=_QUICK_PERIODS)
    maps = Maps(study)
    map_store.fill(maps, local, None, progress)
    found = map_report.report(maps)
    figure = draw(maps)
    velocities = ", ".join(f"{velocity:g}" for velocity in study.velocities)
    return Item(
        name=name,
        title=title,
        see=(
            *see,
            f"{study.beta_count} × {study.sigma_count} = {study.beta_count * study.sigma_count} points (β, σ) for each of "
            f"four initial velocities, {study.periods} periods each, by a solver that is exact between force steps.",
        ),
        traps=_traps(found, tau_d),
        figure=figure,
        alt=f"Four maps of the (β, σ) plane in four shades for initial velocities {velocities}.",
        tables=(_regions(found), _outcomes(found)),
        comparisons=_comparisons(maps, found, quick),
        numbers={
            "study": {"mu": study.mu, "tau_d": tau_d, "velocities": list(study.velocities), "periods": study.periods,
                      "beta": study.betas(tau_d).tolist(), "sigma": study.sigmas.tolist()},
            **{key: found[key] for key in ("regions", "maps", "exceptions", "b_one_tick")},
        },
    )  # fmt: skip


def _traps(found: dict[str, Any], tau_d: float) -> tuple[str, ...]:
    grid = "Grid and velocities are lost with the paper's figures. Ours are stated above; `hapticd map` takes others."
    energy = (
        "“Monotone” is stricter than “comes to rest”: light points inside A and E are the failure of bound (46). "
        if tau_d == 0.0
        else "With delay energies are compared at h + τ_D, where the paper's argument begins; at the samples they may rise. "
    )
    large = found["b_one_tick"]
    most = f", the largest {max(row['amplitude_ticks'] for row in large):.3g} ticks" if large else ""
    edge = f"Points of B that oscillate by a tick or more: {len(large)}{most}."
    return grid, f"{energy}“Below one tick” holds inside B, not at its edge β = ½ + τ_D. {edge}"


def _comparisons(maps: Maps, found: dict[str, Any], quick: bool) -> list[Comparison]:
    study = maps.study
    coarse = "coarser, because of --quick" if quick else ""
    exceptions = len(found["exceptions"])
    grows = sum(row["growing"] for name, row in found["regions"].items() if name in ("A", "B", "E", "F1", "F2"))
    points = study.beta_count * study.sigma_count
    return [
        Comparison(
            "points in a map", "paper, Sec. IV", PAPER_POINTS, points, quick or points == PAPER_POINTS, note=coarse
        ),
        Comparison(
            "horizon", "paper, Sec. IV", PAPER_PERIODS, study.periods, quick or study.periods == PAPER_PERIODS,
            unit="periods", note=coarse,
        ),
        compare("points that contradict their region", "paper, Sec. IV: “good correspondence”", 0, exceptions, 0),
        compare("growing points outside C and D", "paper, Fig. 6, 7", 0, grows, 0),
        *(_edge() if study.delays == (0.0,) else ()),
    ]  # fmt: skip


def _edge() -> list[Comparison]:
    """Near the edge of B oscillations can be much larger than one tick, which the paper gives as their limit."""
    start = np.array([row[0] for row in _EDGE])
    same = np.ones(start.size)
    points = run_points(Study.mu, _EDGE_BETA * same, 0.0 * same, 0.0, start, PAPER_PERIODS)
    note = "the paper says below one tick: true well inside B only"
    return [
        compare(
            f"amplitude at β = {_EDGE_BETA}, σ = 0 from ξ̇₀ = {velocity:g}", "independent simulation", known,
            float(amplitude), tolerance, "ticks", note,
        )
        for (velocity, known, tolerance), amplitude in zip(_EDGE, points["amplitude"], strict=True)
    ]  # fmt: skip


def _regions(found: dict[str, Any]) -> Table:
    rows: list[tuple[Cell, ...]] = []
    for name, row in found["regions"].items():
        agree = "no promise" if row["agree"] is None else f"{100.0 * row['agree']:.4g} %"
        rows.append((name, row["points"], *(row[outcome] for outcome in OUTCOMES), agree))
    shades = (f"{outcome} ({_SHADES[outcome]})" for outcome in OUTCOMES)
    return Table(("region", "points", *shades, "as promised"), rows, "All four maps, region by region.")


def _outcomes(found: dict[str, Any]) -> Table:
    rows = [
        (f"{entry['xi_dot_0']:g}", *(entry["outcomes"][outcome] for outcome in OUTCOMES)) for entry in found["maps"]
    ]
    return Table(("initial velocity (ticks/period)", *OUTCOMES), rows, "Map by map.")
