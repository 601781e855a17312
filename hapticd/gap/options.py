"""The experiments to choose from: shapes of ``excite``, at sizes and settings within the limits."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from hapticd.servo.excitation import SHAPES, default_plan
from hapticd.servo.experiment import Experiment

if TYPE_CHECKING:
    from collections.abc import Iterator

    from hapticd.config import Config

TRIAL_S = 5.0
"""Duration of the simulations that compare experiments [s]."""
_SIZES = (0.4, 1.0, 2.5)
_SOFTER, _STIFFER = 0.25, 2.0


def shapes(config: Config) -> list[Experiment]:
    """Every shape at several amplitudes, and chirps in a low and a high frequency band."""
    found = []
    for shape in SHAPES.values():
        plan = default_plan(config, shape)
        if shape.moves_origin:
            limit = config.safety.max_excursion and config.safety.max_excursion / 2
        else:
            limit = config.amplifier.continuous_current
        highest = config.servo.rate_hz / 5
        bands = {(plan.low_hz, plan.high_hz), (plan.high_hz / 2, min(4 * plan.high_hz, highest))}
        for amplitude in sorted({_rounded(min(size * plan.amplitude, limit or float("inf"))) for size in _SIZES}):
            experiment = Experiment(shape.name, amplitude=amplitude, duration_s=TRIAL_S)
            if shape.sweeps_frequency:
                found += [replace(experiment, low_hz=_rounded(a), high_hz=_rounded(b)) for a, b in sorted(bands)]
            else:
                found.append(experiment)
    return found


def with_settings(config: Config, experiment: Experiment) -> Iterator[Experiment]:
    """The experiment with other live settings: a softer and a stiffer spring, and the encoder's full resolution.

    The servo rate is not changed: no model predicts whether the machine keeps another one.
    """
    for factor in (_SOFTER, _STIFFER):
        if config.spring.stiffness:
            yield replace(experiment, settings={"spring.stiffness": _rounded(factor * config.spring.stiffness)})
    if config.encoder.decimation > 1:
        yield replace(experiment, settings={"encoder.decimation": 1})


def _rounded(value: float) -> float:
    """Two digits, rounded towards zero, so that limits stay satisfied."""
    digits = f"{value:.1e}"
    rounded = float(digits)
    if rounded > value:
        step = 10.0 ** (int(digits.partition("e")[2]) - 1)
        rounded = float(f"{rounded - step:.1e}")
    return rounded
