"""Region maps compared with theory: prediction of each region, result of the simulation, and every point that disagrees.

A, E and F1 predict that motions die out, which is proven; F2 too, without a proof. B predicts that motions stay small:
a point that grows disagrees, and oscillations of one tick and more are listed. C cannot come to rest (σ < ½). D predicts
nothing, because the criterion is a worst case.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapticd.stability.criterion import dissipation_margin
from hapticd.stability.maps import Maps, PointArray
from hapticd.stability.outcome import OUTCOMES, PERSISTENT
from hapticd.stability.storage import velocity_bound

#: Outcomes that agree with the prediction of a region; a region not named predicts nothing.
PROMISED: Final[dict[str, frozenset[str]]] = {
    "A": frozenset({"monotone", "decaying"}),
    "B": frozenset({"monotone", "decaying", "persistent"}),
    "C": frozenset({"persistent", "growing"}),
    "E": frozenset({"monotone", "decaying"}),
    "F1": frozenset({"monotone", "decaying"}),
    "F2": frozenset({"monotone", "decaying"}),
}


def regions_of(maps: Maps, delay: int, velocity: int) -> NDArray[np.str_]:
    """(β, σ) names of the theoretical regions of one map, for its initial velocity; `regions.region` for arrays."""
    study = maps.study
    tau_d = study.delays[delay]
    bound = velocity_bound(0.0, study.velocities[velocity], study.mu, tau_d)
    beta, sigma = study.betas(tau_d)[:, None], study.sigmas[None, :]
    viscous_enough = beta - 0.5 - tau_d >= 0.0
    dissipating = dissipation_margin(beta, sigma, tau_d, bound) >= 0.0
    below_half = np.where(viscous_enough, "B", "C")
    stable = np.where(dissipating, "F1", "F2") if tau_d > 0.0 else "A"
    above_half = np.where(viscous_enough, stable, np.where(dissipating, "E", "D"))
    return np.where(sigma - 0.5 < 0.0, below_half, above_half)


def report(maps: Maps) -> dict[str, Any]:
    """Agreement by region, for every map and in total.

    Returns:
        ``points``, ``done``, ``holds`` (no finished point contradicts its region), ``regions`` (all maps together),
        ``maps`` (one entry a map: ``tau_d``, ``xi_dot_0``, ``outcomes``, ``regions``), ``exceptions`` (the points that
        contradict), ``b_one_tick`` (persistent points of B at or above one tick). A region has ``points``, the count of
        each outcome, ``agree`` (a fraction, None if nothing is predicted) and, in B, ``amplitude`` with ``median`` and
        ``max`` in ticks over its persistent points that have settled, and the number ``unsettled``, whose amplitude
        still changes at the horizon.
    """
    study = maps.study
    entries, found = [], []
    exceptions: list[dict[str, Any]] = []
    large: list[dict[str, Any]] = []
    for d, tau_d in enumerate(study.delays):
        for v, velocity in enumerate(study.velocities):
            names, points, done = regions_of(maps, d, v), maps.points[d, v], maps.done[d, v]
            found.append((names[done], points[done]))
            entries.append(
                {
                    "tau_d": tau_d,
                    "xi_dot_0": velocity,
                    "outcomes": _outcomes(points["outcome"][done]),
                    "regions": dict(_regions(names[done], points[done])),
                }
            )
            contradicts, oscillates_wide = _contradicting(names, points), (names == "B") & (points["amplitude"] >= 1.0)
            exceptions += _rows(maps, d, v, names, done & contradicts)
            large += _rows(maps, d, v, names, done & oscillates_wide & (points["outcome"] == PERSISTENT))
    names, points = (np.concatenate(parts) for parts in zip(*found, strict=True))
    return {
        "points": study.size,
        "done": int(maps.done.sum()),
        "holds": not exceptions,
        "regions": dict(_regions(names, points)),
        "maps": entries,
        "exceptions": exceptions,
        "b_one_tick": large,
    }


def _contradicting(names: NDArray[np.str_], points: PointArray) -> NDArray[np.bool_]:
    wrong = np.zeros(names.shape, np.bool_)
    for name, promised in PROMISED.items():
        codes = [code for code, outcome in enumerate(OUTCOMES) if outcome not in promised]
        wrong |= (names == name) & np.isin(points["outcome"], codes)
    return wrong


def _rows(maps: Maps, d: int, v: int, names: NDArray[np.str_], which: NDArray[np.bool_]) -> list[dict[str, Any]]:
    study = maps.study
    tau_d, velocity = study.delays[d], study.velocities[v]
    return [
        {
            "tau_d": tau_d,
            "xi_dot_0": velocity,
            "beta": float(study.betas(tau_d)[i]),
            "sigma": float(study.sigmas[j]),
            "region": str(names[i, j]),
            "outcome": OUTCOMES[point["outcome"]],
            "amplitude_ticks": float(point["amplitude"]),
            "omega": float(point["omega"]),
            "settled": bool(point["settled"]),
        }
        for i, j in np.argwhere(which).tolist()
        for point in [maps.points[d, v, i, j]]
    ]


def _outcomes(codes: NDArray[np.int8]) -> dict[str, int]:
    return {name: int((codes == code).sum()) for code, name in enumerate(OUTCOMES)}


def _regions(names: NDArray[np.str_], points: PointArray) -> Iterator[tuple[str, dict[str, Any]]]:
    for name in sorted(set(names.tolist())):
        inside = points[names == name]
        counts = _outcomes(inside["outcome"])
        entry: dict[str, Any] = {"points": inside.size, **counts, "agree": None}
        if promised := PROMISED.get(name):
            entry["agree"] = sum(counts[outcome] for outcome in promised) / inside.size
        if name == "B":
            oscillating = inside["outcome"] == PERSISTENT
            amplitude = inside["amplitude"][oscillating & inside["settled"]]
            entry["amplitude"] = {
                "median": float(np.median(amplitude)) if amplitude.size else math.nan,
                "max": float(amplitude.max(initial=0.0)),
                "unsettled": int((oscillating & ~inside["settled"]).sum()),
            }
        yield name, entry
