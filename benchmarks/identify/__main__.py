"""``python -m benchmarks.identify``: 20 hidden devices, their parameters found from one recording each, and their intervals.

Devices are drawn over two decades of inertia and of friction, with three resolutions, a bias, a delay and often the wrong
sign of the encoder (`cases`); the config that is given is wrong by up to two decades. Every other one has a coloured torque
of 5 % of its Coulomb friction, which no model knows. The peer (`idim`) gets the same files, and the right sign.

Errors are relative to the true value; those of the bias to the Coulomb friction.
"""

from __future__ import annotations

import argparse
import statistics
import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.gap.rate import Rate
from benchmarks.identify.cases import Hidden, hidden
from benchmarks.identify.idim import idim_ls
from benchmarks.report import Figure, document, print_table, progress
from hapticd.config import parse_config
from hapticd.gap.recording import Recording
from hapticd.identify import identify

FIRST_SEED, CASES, QUICK_CASES = 100, 20, 1
NAMES = ("inertia", "viscous", "coulomb", "bias", "delay")
COVERAGE_GOAL, ERROR_GOAL, SECONDS_GOAL = 0.9, 0.01, 3.0

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Scored:
    """One device: relative errors and half-widths in the order of `NAMES`, of hapticd and of the peer."""

    seed: int
    coloured: bool
    sign_found: bool
    seconds: float
    processor_s: float
    errors: Floats
    inside: NDArray[np.bool_]
    peer_errors: Floats
    peer_inside: NDArray[np.bool_]


def recording_of(case: Hidden) -> Recording:
    """The case as a file would give it."""
    step = 2.0 * np.pi / case.config["encoder"]["counts_per_rev"]
    time_s = case.time_s - case.time_s[0]
    position, period = (case.counts + 0.5) * step, float(np.median(np.diff(time_s)))
    return Recording(f"seed {case.seed}", time_s, position, step, case.current, None, period, False)


def scored(case: Hidden) -> Scored:
    """Identify one device with both."""
    model, recording = parse_config(case.config, "config"), recording_of(case)
    truth = np.array([case.truth[name] for name in ("inertia", "viscous", "coulomb", "bias", "delay_s")])
    size = np.abs(truth)
    size[3] = truth[2]
    begin, processor_begin = time.perf_counter(), time.process_time()
    found = identify([recording], model)
    seconds, processor_s = time.perf_counter() - begin, time.process_time() - processor_begin
    estimates = [getattr(found, name) for name in NAMES]
    values = np.array([estimate.value for estimate in estimates])
    inside = np.array([e.ci95[0] <= t <= e.ci95[1] for e, t in zip(estimates, truth, strict=True)])
    sign = -1 if case.inverted else 1
    upright = replace(recording, position=sign * recording.position)
    peer, reach = idim_ls(
        upright.time_s, upright.position, upright.current, model.amplifier.torque_constant, upright.resolution
    )
    return Scored(
        case.seed,
        case.coloured is not None,
        found.sign == sign,
        seconds,
        processor_s,
        (values - truth) / size,
        inside,
        (peer - truth) / size,
        np.abs(peer - truth) <= reach,
    )


def figures(all_scored: list[Scored]) -> list[Figure]:
    """Coverage, errors and seconds, and the peer's beside them."""
    errors = np.abs(np.array([one.errors for one in all_scored]))
    inside = np.array([one.inside for one in all_scored])
    peer_errors = np.abs(np.array([one.peer_errors for one in all_scored]))
    peer_inside = np.array([one.peer_inside for one in all_scored])
    cover, details = Rate(int(inside.sum()), inside.size), _details(all_scored)
    found = [
        Figure(f"true value inside the 95 % interval: {cover}", cover.value, "", COVERAGE_GOAL, "≥", details=details),
        Figure("the same of inertia and frictions", float(inside[:, :3].mean()), "", COVERAGE_GOAL, "≥"),
        Figure("median error", float(np.median(errors)), "", ERROR_GOAL),
        Figure("median error of inertia and frictions", float(np.median(errors[:, :3])), "", ERROR_GOAL),
        Figure("encoder's sign found", float(np.mean([one.sign_found for one in all_scored])), "", 1.0, "≥"),
        Figure("median time", statistics.median(one.seconds for one in all_scored), "s", SECONDS_GOAL),
        Figure("slowest", max(one.seconds for one in all_scored), "s", SECONDS_GOAL),
        Figure("median processor time", statistics.median(one.processor_s for one in all_scored), "s", SECONDS_GOAL),
        Figure("most processor time", max(one.processor_s for one in all_scored), "s", SECONDS_GOAL),
        Figure("peer: true value inside its interval", float(peer_inside[:, :4].mean()), "", peer="IDIM-LS"),
        Figure("peer: median error", float(np.median(peer_errors)), "", peer="IDIM-LS"),
        Figure(
            "median error over the peer's", float(np.median(errors) / np.median(peer_errors)), "×", 1.0, peer="IDIM-LS"
        ),
    ]
    for coloured in (False, True):
        rows = np.array([one.coloured == coloured for one in all_scored])
        if rows.any():
            label = "with coloured torque" if coloured else "without disturbance"
            found.append(Figure(f"inside, {label}", float(inside[rows].mean()), ""))
            found.append(Figure(f"median error, {label}", float(np.median(errors[rows])), ""))
    return found


def _details(all_scored: list[Scored]) -> dict[str, Any]:
    return {
        str(one.seed): {
            "coloured": one.coloured,
            "seconds": one.seconds,
            "processor_s": one.processor_s,
            "errors": dict(zip(NAMES, one.errors.tolist(), strict=True)),
            "inside": dict(zip(NAMES, one.inside.tolist(), strict=True)),
            "peer_errors": dict(zip(NAMES, one.peer_errors.tolist(), strict=True)),
        }
        for one in all_scored
    }


def measure(quick: bool, first: int = FIRST_SEED) -> list[Figure]:
    """Figures of the seeds from ``first`` on."""
    found = []
    for seed in range(first, first + (QUICK_CASES if quick else CASES)):
        one = scored(hidden(seed))
        missed = [name for name, inside in zip(NAMES, one.inside, strict=True) if not inside]
        shown = ", ".join(f"{name} {100 * error:+.2g} %" for name, error in zip(NAMES, one.errors, strict=True))
        beside = f"; outside: {', '.join(missed)}" if missed else ""
        times = f"{one.seconds:.1f} s, of the processor {one.processor_s:.1f} s"
        progress(f"seed {seed}{', coloured' if one.coloured else ''}, {times}: {shown}{beside}")
        found.append(one)
    return figures(found)


def main() -> None:
    """``--seed`` for seeds to develop on (below 100)."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.identify", description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=FIRST_SEED)
    parser.add_argument("--quick", action="store_true")
    options = parser.parse_args()
    print_table([document("identify", measure(options.quick, options.seed), options.quick)])


if __name__ == "__main__":
    main()
