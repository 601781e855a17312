"""The peer: sparse regression of the missing torque with PySINDy, on the same files that the workflow gets.

Discrepancy modelling (Kaheman, Kaiser, Strom, Kutz and Brunton 2019): derivatives by smoothed finite differences, a
library of physical terms, STLSQ and SR3, each with the threshold that block cross-validation finds (one-standard-error
rule). The term group with the largest part in the discrepancy is its answer.
"""

from __future__ import annotations

import math
import warnings
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml
from numpy.typing import NDArray

from benchmarks.gap import devices
from benchmarks.gap.cases import run_file
from benchmarks.gap.plan import exact_class

Floats = NDArray[np.float64]

_SMOOTHING_S = 0.015
_BLOCKS = 5
_THRESHOLDS = np.geomspace(1e-3, 1.0, 10)
_ORDERS = (1, 2, 3, 4, 7, 11, 12, 14, 28)
_LEAST_SHARE = 0.02
"""Of the torque that friction alone takes: a discrepancy below it is no answer."""


class Sampled(NamedTuple):
    """A recording on an even grid with its derivatives."""

    theta: Floats
    omega: Floats
    alpha: Floats
    current: Floats


def read(folder: Path) -> tuple[dict[str, Any], Floats, Floats, Floats]:
    """Nominal model, instants, positions and commanded currents of a case."""
    from hapticd.record import read_run

    nominal = yaml.safe_load((folder / "model.yaml").read_text())
    columns = read_run(run_file(folder)).columns
    late = columns.get("wake_late_ns", 0) * 1e-9
    position = (columns["encoder_counts"] + 0.5) * devices.resolution(nominal)
    return nominal, columns["time_s"] + late, position, columns["current_command_A"]


def derivatives(nominal: dict[str, Any], times: Floats, position: Floats, current: Floats) -> Sampled:
    """PySINDy's smoothed finite differences, twice, on an even grid; the current is delayed by what the model says."""
    import pysindy as ps

    period = 1.0 / nominal["servo"]["rate_hz"]
    grid = np.arange(times[0], times[-1], period)
    window = 2 * round(_SMOOTHING_S / period / 2) + 1
    smooth = ps.SmoothedFiniteDifference(smoother_kws={"window_length": window, "polyorder": 3})
    theta = np.interp(grid, times, position)[:, None]
    omega = smooth(theta, period)
    alpha = smooth(omega, period)
    delay = devices.base_device(nominal).delay_s
    held = np.interp(grid - delay - 0.5 * period, times, current)
    kernel = np.hanning(window + 2)[1:-1]
    blurred = np.convolve(held, kernel / kernel.sum(), mode="same")  # as smooth as what it is compared with
    cut = slice(2 * window, -2 * window)
    return Sampled(theta[cut, 0], omega[cut, 0], alpha[cut, 0], blurred[cut])


def terms(x: Sampled, nominal: dict[str, Any]) -> list[tuple[str, Floats]]:
    """The library: effect and term, each scaled to unit RMS later."""
    speed = float(np.std(x.omega))
    side = np.tanh(x.omega / (0.02 * speed))
    found = [
        ("constant_bias", np.ones_like(x.omega)),
        ("viscous_friction", x.omega),
        ("coulomb_friction", side),
        ("quadratic_drag", np.abs(x.omega) * x.omega),
        ("asymmetric_viscous", np.abs(x.omega)),
        ("torque_constant_error", x.current),
        ("load_dependent_friction", np.abs(x.current) * side),
        ("return_spring", x.theta),
    ]
    found += [("stribeck", side * np.exp(-((x.omega / (part * speed)) ** 2))) for part in (0.1, 0.4)]
    if not devices.is_linear(nominal):
        travel = float(np.ptp(x.theta))
        for order in _ORDERS:
            if (
                order * travel < 2.0 * math.pi
            ):  # less than a period is no sine but a polynomial: collinear with the rest
                continue
            name = "gravity" if order == 1 else "torque_ripple"
            found += [(name, np.sin(order * x.theta)), (name, np.cos(order * x.theta))]
    return found


def _fit(kind: str, threshold: float, library: Floats, target: Floats) -> Floats:
    import pysindy as ps

    optimizer = (
        ps.STLSQ(threshold=threshold, alpha=1e-6, max_iter=30)
        if kind == "STLSQ"
        else ps.SR3(reg_weight_lam=threshold**2 / 2.0, regularizer="L0", relax_coeff_nu=1.0, max_iter=40)
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        optimizer.fit(library, target[:, None])
    return np.asarray(optimizer.coef_).ravel()


def select(library: Floats, target: Floats) -> tuple[str, float, Floats]:
    """Optimizer, threshold and coefficients by block cross-validation with the one-standard-error rule."""
    blocks = np.minimum(np.arange(target.size) * _BLOCKS // target.size, _BLOCKS - 1)
    tried: list[tuple[str, float, Floats]] = []
    for kind in ("STLSQ", "SR3"):
        for threshold in _THRESHOLDS:
            errors = np.empty(_BLOCKS)
            for block in range(_BLOCKS):
                held = blocks == block
                coefficients = _fit(kind, threshold, library[~held], target[~held])
                errors[block] = np.mean((target[held] - library[held] @ coefficients) ** 2)
            tried.append((kind, float(threshold), errors))
    best = min(tried, key=lambda row: float(np.mean(row[2])))[2]
    worse = [(kind, threshold, errors - best) for kind, threshold, errors in tried]
    # Blocks differ more from each other than models do: the standard error is that of the paired differences.
    allowed = [row for row in worse if np.mean(row[2]) <= np.std(row[2]) / math.sqrt(_BLOCKS)]
    kind, threshold = max(allowed, key=lambda row: row[1])[:2]
    return kind, threshold, _fit(kind, threshold, library, target)


def _join_inertia(parts: dict[str, float], of_current: float, of_friction: float) -> None:
    """Current and friction changed by the same share are a changed inertia, which has no column of its own."""
    if of_current != 0.0 and abs(of_friction - of_current) < 0.3 * abs(of_current):
        parts["inertia_error"] = sum(
            parts.pop(name, 0.0) for name in ("torque_constant_error", "coulomb_friction", "viscous_friction")
        )


def identify(folder: Path) -> dict[str, Any]:
    """What the peer names: ``effects`` in the order of their part in the discrepancy, none where that is small."""
    nominal, times, position, current = read(folder)
    x = derivatives(nominal, times, position, current)
    plant, constant = nominal["plant"], nominal["amplifier"]["torque_constant"]
    moving = np.abs(x.omega) > 0.05 * np.std(x.omega)
    x = Sampled(*(column[moving][::5] for column in x))
    friction = plant["viscous"] * x.omega + plant["coulomb"] * np.sign(x.omega)
    target = (plant["inertia"] * x.alpha + friction - constant * x.current) / plant["coulomb"]
    library = terms(x, nominal)
    scale = np.array([np.sqrt(np.mean(column**2)) for _, column in library])
    kind, threshold, coefficients = select(np.column_stack([column for _, column in library]) / scale, target)
    parts: dict[str, float] = {}
    for (name, _), coefficient in zip(library, coefficients, strict=True):
        if coefficient != 0.0:
            parts[name] = math.hypot(parts.get(name, 0.0), float(coefficient))
    relative = dict(zip((name for name, _ in library), coefficients / scale, strict=True))
    _join_inertia(parts, relative["torque_constant_error"] * plant["coulomb"] / constant, -relative["coulomb_friction"])
    named = [name for name in sorted(parts, key=parts.__getitem__, reverse=True) if parts[name] >= _LEAST_SHARE]
    return {
        "verdict": "effect_found" if named else "no_missing_effect",
        "effects": named,
        # A column stands for every effect with the same law; parameters have no intervals.
        "steps": [
            {"effect": name, "parameters": {}, "indistinguishable_from": sorted(exact_class(name) - {name})}
            for name in named
        ],
        "parts": parts,
        "optimizer": kind,
        "threshold": float(threshold),
    }
