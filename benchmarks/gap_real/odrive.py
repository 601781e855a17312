"""A cogging motor with 8192 counts, two runs at different speeds: is the ripple found, and does it predict the current?

Nothing is known of the motor, so the model is empty (K_t = 1: torques are in A) and the effects are torque ripple and a
constant bias, which in one direction is friction too. Orders and amplitudes are chosen on four fifths of the one-second
blocks and predict the current in the others. The peer is a cogging map of the same motor that was measured separately.

The current of these files follows the torque late: where the shaft escapes from a cogging pole within 10 ms, the current
needs 100 ms. So a second figure lets the predicted current lag by a first-order filter whose time constant is chosen on
the same four fifths. A third one predicts a run from the other run alone.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from benchmarks.gap_real.datasets import COGGING, COGGING_MAP, imported
from benchmarks.report import Figure, progress
from hapticd.config import Config, parse_config
from hapticd.gap.balance import Balance
from hapticd.gap.data import Recording
from hapticd.gap.force_search import ripple_orders
from hapticd.gap.regression import Blocks, solve
from hapticd.gap.regressors import ripple
from hapticd.gap.screen import screen
from hapticd.gap.smooth import held_mean

FloatArray = NDArray[np.float64]

COUNTS = 8192
FINEST = 1.0 / 64.0
"""The drive reports its tracking loop's position, in steps of 1/64 count."""
MAP = {
    "device": "rotary",
    "time": {"column": 0},
    "position": {"column": 1, "unit": "count", "resolution": FINEST},
    "current": {"column": 2},
    "encoder": {"counts_per_rev": COUNTS},
}
LAGS_S = (0.0, *np.geomspace(0.01, 0.3, 12))
BANDWIDTH_HZ = 40.0


def empty_model() -> Config:
    """No inertia to speak of, no friction: all of the current is unexplained."""
    no_limits = {"bandwidth_hz": 0, "dac_bits": 0, "peak_current": 0, "continuous_current": 0}
    return parse_config(
        {
            "encoder": {"counts_per_rev": COUNTS / FINEST},
            "plant": {"inertia": 1e-12, "viscous": 0.0, "coulomb": 0.0},
            "amplifier": {"torque_constant": 1.0, **no_limits},
        },
        "empty model",
    )


def measure(data: Path, scratch: Path) -> list[Figure]:
    """Both runs."""
    model = empty_model()
    recordings = [imported(data / name, MAP, model, scratch) for name in COGGING]
    cogging = np.load(data / COGGING_MAP)
    figures = []
    for recording, other in zip(recordings, reversed(recordings), strict=True):
        figures += _one_run(recording, other, model, cogging)
    return figures


def _one_run(recording: Recording, other: Recording, model: Config, cogging: FloatArray) -> list[Figure]:
    name = recording.name.removesuffix(".arrow")
    screening = screen([recording], model, given=("constant_bias",), bandwidth_hz=BANDWIDTH_HZ)
    best = screening.ranking[0]
    balance = Balance([recording], model, bandwidth_hz=BANDWIDTH_HZ)
    peer = map_rms(recording, cogging, balance)
    everything = np.ones(balance.target.size, dtype=np.bool_)
    orders = ripple_orders(balance, balance.fixed, everything)
    ranking = ", ".join(f"{score.slug} {score.cv_rms:.3f}" for score in screening.ranking[:4])
    progress(f"{name}: first {ranking} A; orders per revolution {', '.join(f'{order:g}' for order in orders)}")
    ripple_cv = next(score.cv_rms for score in screening.ranking if score.slug == "torque_ripple")
    lagged, lag = lagged_cv(balance)
    crossed = predicted_from(Balance([other], model, bandwidth_hz=BANDWIDTH_HZ), balance)
    named = float(best.slug == "torque_ripple")
    return [
        Figure(f"{name} constant only, RMS", float(np.std(balance.target)), "A", peer="0.796 (nocomp_0)"),
        Figure(f"{name} torque_ripple ranks first", named, "of 1", 1.0, "≥", details={"orders": orders}),
        Figure(f"{name} ripple, in sample", best.rms, "A", peer="0.158 (nocomp_0), 0.27 (nocomp_1)"),
        Figure(f"{name} ripple, held-out blocks", ripple_cv, "A", peer, peer="the measured map on this run"),
        Figure(f"{name} lagged ripple, held-out blocks", lagged, "A", peer, details={"lag_s": lag}),
        Figure(f"{name} lagged ripple from the other run", crossed, "A", peer, peer="the measured map on this run"),
    ]


def map_rms(recording: Recording, cogging: FloatArray, balance: Balance) -> float:
    """RMS of the current that the independent map leaves, a constant taken out for it.

    The less of two: over all samples, and over the filtered rows that the ripple is judged on.
    """
    counts = np.floor(recording.position * COUNTS / (2.0 * np.pi)).astype(np.int64)
    left = recording.current - cogging[counts % COUNTS]
    signals = balance.signals[0]
    same_rows = signals.filtered(held_mean(recording, left, signals.motion.time_s, 0.0))
    return min(float(np.std(left)), float(np.std(same_rows)))


def lagged(balance: Balance, orders: list[float], lag_s: float) -> FloatArray:
    """Columns (m, 1 + 2 orders): a constant and the ripple, through a first-order lag, filtered as the current is."""
    signals = balance.signals[0]
    columns = [np.ones_like(signals.velocity)]
    for order in orders:
        columns += ripple(signals, balance.model, order).values()
    keep = np.exp(-signals.motion.period_s / lag_s) if lag_s > 0.0 else 0.0
    late = [np.asarray(lfilter([1.0 - keep], [1.0, -keep], c, zi=[keep * c[0]])[0]) for c in columns]
    return np.column_stack([signals.filtered(column) for column in late])


def chosen_lag(balance: Balance, rows: NDArray[np.bool_]) -> tuple[list[float], float]:
    """Orders and lag that explain ``rows`` best."""
    orders = ripple_orders(balance, balance.fixed, rows)
    target = balance.target[rows]
    left = []
    for lag in LAGS_S:
        design = lagged(balance, orders, lag)[rows]
        left.append(float(np.std(target - design @ solve(design, target))))
    return orders, float(LAGS_S[int(np.argmin(left))])


def lagged_cv(balance: Balance) -> tuple[float, float]:
    """Held-out RMS, with orders, amplitudes and lag from the other blocks; and the median lag."""
    blocks: Blocks = balance.blocks
    residual, lags = np.empty_like(balance.target), []
    for fold in range(blocks.folds):
        held = blocks.fold == fold
        orders, lag = chosen_lag(balance, ~held)
        design = lagged(balance, orders, lag)
        residual[held] = balance.target[held] - design[held] @ solve(design[~held], balance.target[~held])
        lags.append(lag)
    return float(np.sqrt(np.mean(residual**2))), float(np.median(lags))


def predicted_from(source: Balance, target: Balance) -> float:
    """RMS of one run's current under orders, amplitudes and lag of the other run alone."""
    orders, lag = chosen_lag(source, np.ones(source.target.size, dtype=np.bool_))
    coefficients = solve(lagged(source, orders, lag), source.target)
    residual = target.target - lagged(target, orders, lag) @ coefficients
    return float(np.sqrt(np.mean(residual**2)))
