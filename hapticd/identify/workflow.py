"""From recordings of one device to its plant model: sign, start, fit, intervals, and assumptions.

From counts and currents only ratios to the torque constant K_t are identifiable: with twice the K_t, the same motion gives
twice the inertia and friction. K_t comes from the data sheet. The operating point does not depend on it: the rendered spring
uses the same K_t, so it is wrong by the same factor.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import norm

from drivers import declared_latency
from hapticd.config import parse_config, unit_of
from hapticd.gap.balance import Balance, balance
from hapticd.gap.checks import check_recording, check_together
from hapticd.gap.data import unchecked
from hapticd.gap.parallel import one_blas_thread
from hapticd.gap.result import Estimate
from hapticd.identify._base_fit import FITTED, BaseFit, base_fit
from hapticd.identify._consistency import current_gain, disagreeing_runs
from hapticd.identify.plausible import implausible
from hapticd.identify.result import UNCERTAIN, Identified
from hapticd.record import read_run

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from hapticd.config import Config
    from hapticd.gap.recording import Recording
    from hapticd.record import Run

REPLACED = ("inertia_error", "viscous_friction", "coulomb_friction", "constant_bias", "transport_delay")
"""Effects of the model that correct fitted parameters: the fit replaces them."""
_LIGHT = 1e-9
_CLEAR_SIGN = 0.2
"""The sign of the encoder is clear if it explains this share of the driving torque more than the other sign."""
_SHORT_S = 1.2
"""Effective duration [s] below which intervals by blocks are unreliable."""
_POOR = 0.5
"""Least share of the driving torque that inertia and friction should explain."""


def load_any(path: str | Path, model: Config) -> Recording:
    """Read a run for `identify`, without checks against the model's plant.

    Raises:
        RunFileError, ConfigError, RecordingError: as `hapticd.gap.data.load_recording`.
    """
    return readable(read_run(path), model)


def readable(run: Run, model: Config) -> Recording:
    """The recording of a run for `identify`, without checks against the model's plant.

    Raises:
        ConfigError, RecordingError: as `hapticd.gap.data.recording_of`.
    """
    # The checks compare with the plant, which is unknown here; a plant with almost no inertia and friction passes them.
    recording = unchecked(run, model)
    check_recording(recording, _with_plant(model, *(_LIGHT * np.array([1.0, 0.0, 0.0]))))
    return recording


@one_blas_thread
def identify(
    recordings: Sequence[Recording],
    model: Config,
    *,
    known_inertia: float | None = None,
    progress: Callable[[float], None] = lambda fraction: None,
) -> Identified:
    """Find inertia, friction, bias, delay and the encoder's sign of a device.

    Args:
        recordings: of one device, from `load_any`.
        model: encoder, torque constant, effects and hand of the device; its inertia, frictions and delay are not used.
        known_inertia: inertia from another source, kg m² or kg; from it the torque constant is computed.
        progress: called with the fraction done.

    Raises:
            RecordingError: a recording is unusable, or given twice.
            ValueError: no recording.
    """
    if not recordings:
        raise ValueError("no recording to identify a device from")
    check_together(recordings)
    start = balance(recordings, model.amplifier.torque_constant)
    progress(0.1)
    if start.sign < 0:
        recordings = [replace(recording, position=-recording.position) for recording in recordings]
    started = _with_plant(model, start.inertia, start.viscous, start.coulomb)
    warnings = [w for r in recordings for w in (*r.warnings, *check_recording(r, started))]
    found = base_fit(recordings, started, start)
    progress(0.9)
    result = _result(found, recordings, model, start)
    if known_inertia is not None:
        result = replace(result, torque_constant_implied=_implied(result, known_inertia))
    warnings += _doubts(found, start, result)
    warnings += disagreeing_runs(found, [recording.name for recording in recordings])
    warnings += implausible(identified_model(model, result))
    progress(1.0)
    return replace(result, warnings=tuple(dict.fromkeys(warnings)))


def identified_model(model: Config, result: Identified) -> Config:
    """The model with the identified plant, its uncertainty, and the correct sign of the encoder."""
    data = model.model_dump()
    effects = [effect for effect in data["plant"]["effects"] if effect["name"] not in REPLACED]
    data["plant"] = {**plant_section(result), "effects": [*effects, *effects_found(result)]}
    data["encoder"]["invert"] ^= result.sign < 0
    return parse_config(data, "the identified model")


def plant_section(result: Identified) -> dict[str, object]:
    """Keys of ``plant``, without the effects."""
    pairs = [(i, j) for i in range(len(UNCERTAIN)) for j in range(i + 1, len(UNCERTAIN))]
    short = [name.removesuffix("_s") for name in UNCERTAIN]
    return {
        **{name: getattr(result, name).value for name in ("inertia", "viscous", "coulomb")},
        "uncertainty": {
            **dict(zip(UNCERTAIN, result.deviations.tolist(), strict=True)),
            "correlation": {f"{short[i]}_{short[j]}": round(float(result.correlation[i, j]), 4) for i, j in pairs},
        },
    }


def effects_found(result: Identified) -> list[dict[str, object]]:
    """Entries of ``plant.effects`` for a bias and for a delay beyond the declared one."""
    found: list[dict[str, object]] = []
    if result.has_bias:
        found.append({"name": "constant_bias", "tau_0": result.bias.value})
    if result.further_delay_s > 0.0:
        found.append({"name": "transport_delay", "t_d": result.further_delay_s})
    return found


def _with_plant(model: Config, inertia: float, viscous: float, coulomb: float) -> Config:
    kept = tuple(effect for effect in model.plant.effects if effect.name not in REPLACED)
    update = {"inertia": inertia, "viscous": viscous, "coulomb": coulomb, "effects": kept}
    return model.model_copy(update={"plant": model.plant.model_copy(update=update)})


def _result(found: BaseFit, recordings: Sequence[Recording], model: Config, start: Balance) -> Identified:
    linear = model.is_linear
    units = {name: unit_of(f"plant.{name}", linear) for name in ("inertia", "viscous", "coulomb")}
    units |= {"bias": units["coulomb"], "delay_s": "s"}
    estimates = {}
    for name, value in zip(FITTED, found.values.tolist(), strict=True):
        half = found.half_width(name)
        low, high = value - half, value + half
        if name == "inertia":
            low, high = value * np.exp(-half / value), value * np.exp(half / value)
        elif name != "bias":
            low = max(low, 0.0)
        estimates[name] = Estimate(value, (float(low), float(high)), units[name])
    index = [FITTED.index(name) for name in UNCERTAIN]
    spread = np.sqrt(np.diag(found.covariance))
    correlation = found.covariance / np.outer(spread, spread)
    declared = model.amplifier.delay + declared_latency(model)[0]
    noise = found.fit.noise_values()
    return Identified(
        inertia=estimates["inertia"],
        viscous=estimates["viscous"],
        coulomb=estimates["coulomb"],
        bias=estimates["bias"],
        delay=estimates["delay_s"],
        sign=start.sign,
        deviations=spread[index] * found.coverage_factor / float(norm.isf(0.025)),
        correlation=correlation[np.ix_(index, index)],
        torque_constant=model.amplifier.torque_constant,
        declared_delay_s=declared,
        is_linear=linear,
        runs=tuple(recording.name for recording in recordings),
        current_gain=current_gain(recordings),
        assumed=tuple(_assumed(model)),
        details={
            "duration_s": found.fit.problem.series.duration_s,
            "samples": found.fit.problem.series.size,
            "explained_share": start.explained,
            "disturbance": {"rms": float(noise[2]), "correlation_s": float(noise[3])},
            "filter_runs": round(sum(found.fit.problem.runs) / found.fit.problem.series.size),
        },
    )


def _assumed(model: Config) -> list[str]:
    encoder = model.encoder
    linear = model.is_linear
    resolution = f"{encoder.counts_per_metre:g} counts/m" if linear else f"{encoder.counts_per_rev:g} counts/rev"
    unit = "N/A" if linear else "N m/A"
    found = [
        f"amplifier.torque_constant = {model.amplifier.torque_constant:g} {unit}: inertia, frictions and bias are "
        "proportional to it; the operating point is not, since the spring is rendered through the same constant",
        f"the encoder's {resolution}",
        "the recorded current is the command; a delay of the recording itself is not distinguished from the device's",
        "Coulomb friction is the same in both directions and at all speeds; hapticd gap finds other effects",
    ]
    if kept := [effect.name for effect in model.plant.effects if effect.name not in REPLACED]:
        found.append(f"the effects of the model, unchanged: {', '.join(kept)}")
    if any((model.hand.inertia, model.hand.damping, model.hand.stiffness)):
        found.append("the hand of the model, which is not part of the device")
    return found


def _implied(result: Identified, known_inertia: float) -> Estimate:
    """K_t from a known inertia: the fit determines J/K_t only."""
    J = result.inertia
    value, low, high = (result.torque_constant * known_inertia / j for j in (J.value, J.ci95[1], J.ci95[0]))
    return Estimate(value, (low, high), "N/A" if result.is_linear else "N m/A")


def _doubts(found: BaseFit, start: Balance, result: Identified) -> list[str]:
    doubts = []
    if found.effective_s < _SHORT_S:
        doubts.append(
            f"nearly all information comes from {found.effective_s:.1f} s of the recordings: too little for reliable "
            "intervals, above all those of delay and viscous friction; record an experiment, such as hapticd excite"
        )
    if start.explained - start.explained_other_sign < _CLEAR_SIGN:
        doubts.append(
            f"the encoder's sign is not certain: inertia and friction explain {100 * start.explained:.0f} % of the driving "
            f"torque with it, {100 * start.explained_other_sign:.0f} % with the other"
        )
    if start.explained < _POOR:
        doubts.append(
            f"inertia and friction explain only {100 * start.explained:.0f} % of the driving torque: another force moves "
            "the shaft; hapticd gap may name it"
        )
    for name in ("viscous", "coulomb"):
        estimate = getattr(result, name)
        if estimate.ci95[0] == 0.0:
            doubts.append(
                f"{name} friction is not distinguished from 0 (at most {estimate.ci95[1]:.3g} {estimate.unit}); "
                f"record {'faster' if name == 'viscous' else 'slower'} motion to distinguish it"
            )
    if result.delay.ci95[1] < result.declared_delay_s:
        doubts.append(
            f"the delay is {1e6 * result.delay.value:.0f} µs, less than the {1e6 * result.declared_delay_s:.0f} µs of "
            "amplifier.bandwidth_hz and the driver; the config keeps the larger one"
        )
    gain = result.current_gain
    if gain is not None and abs(gain.value - 1.0) > 0.05 and not gain.ci95[0] <= 1.0 <= gain.ci95[1]:
        doubts.append(
            f"the measured current is {gain.value:.3f} times the commanded one: if the amplifier's scale is wrong, inertia, "
            "frictions and bias are wrong by that factor"
        )
    for term, value in zip(found.fit.terms, found.fit.u[-len(FITTED) :], strict=True):
        if term.slug not in ("viscous", "coulomb", "delay_s") and term.at_bounds([value]):
            doubts.append(f"{term.slug} is at the end of its range; it is not identifiable from these recordings")
    return doubts
