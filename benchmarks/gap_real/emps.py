"""EMPS: a linear axis, 24.8 s at 1 kHz (Janot, Gautier and Brunot 2019), from the rigid model without an offset.

The published figures are for records decimated by ten, so the filter's bandwidth is that rate's half, 50 Hz. Base
parameters are fitted along, as there: 3.82 N without offset, 2.16 N with it, 1.64 N with direction-dependent viscosity.
"""

from __future__ import annotations

from pathlib import Path

from benchmarks.gap_real.datasets import EMPS, imported
from benchmarks.report import Figure, progress
from hapticd.config import Config, parse_config
from hapticd.gap.data import Recording
from hapticd.gap.screen import Screening, screen

FORCE_PER_VOLT = 35.15065188
BANDWIDTH_HZ = 50.0
MAP = {
    "device": "linear",
    "time": {"column": "t"},
    "position": {"column": "qm", "resolution": 5e-8},
    "force": {"column": "vir", "factor": FORCE_PER_VOLT},
    "torque_constant": FORCE_PER_VOLT,
}


def nominal() -> Config:
    """The published rigid model, its offset left out."""
    no_limits = {"bandwidth_hz": 0, "dac_bits": 0, "peak_current": 0, "continuous_current": 0}
    return parse_config(
        {
            "encoder": {"counts_per_metre": 2e7},
            "plant": {"inertia": 95.1089, "viscous": 203.5034, "coulomb": 20.3935},
            "amplifier": {"torque_constant": FORCE_PER_VOLT, **no_limits},
        },
        "EMPS rigid model",
    )


def measure(data: Path, scratch: Path) -> list[Figure]:
    """Residual forces, the pair that is confounded, and what decides it."""
    model = nominal()
    recording = imported(data / EMPS, MAP, model, scratch)
    rigid = _screened(recording, model, ())
    scores = {score.slug: score for score in rigid.ranking}
    offset, viscous = scores["constant_bias"], scores["asymmetric_viscous"]
    pair = next((p for p in rigid.confounded if {p.first, p.second} == {"constant_bias", "asymmetric_viscous"}), None)
    after = _screened(recording, model, ("asymmetric_viscous",))
    left = next(score for score in after.ranking if score.slug == "constant_bias")
    third = after.ranking[0]
    if pair is not None:
        progress(
            f"EMPS: {pair.second} and {pair.first} explain the same ({100 * pair.overlap:.0f} % of the weaker one's gain "
            f"is gone once the other is in); {pair.first} is better by {pair.advantage_z:.1f} standard "
            f"errors: {'resolved' if pair.resolved else 'not resolved'}"
        )
    progress("EMPS ranking: " + ", ".join(f"{s.slug} {s.cv_rms:.2f} N" for s in rigid.ranking[:5]))
    tau = left.coefficients["tau_0"]
    progress(
        f"EMPS: offset {offset.coefficients['tau_0'].value:.2f} N alone, {tau.value:.2f} ± {tau.standard_error:.2f} N after"
    )
    return [
        Figure("EMPS rigid, residual force RMS", rigid.rms, "N", peer="published 3.82"),
        Figure("EMPS with offset", offset.rms, "N", 2.25, peer="published 2.16"),
        Figure("EMPS with asymmetric viscous", viscous.rms, "N", peer="published 1.64"),
        Figure("EMPS with asymmetric viscous, block CV", viscous.cv_rms, "N", 1.70),
        Figure("EMPS overlap of the confounded pair", pair.overlap if pair else 0.0, "of 1", 0.5, "≥"),
        Figure("EMPS advantage of asymmetric viscous", pair.advantage_z if pair else 0.0, "SE", 3.0, "≥"),
        Figure("EMPS offset left after it", abs(tau.value), "N", peer="published 0.23"),
        Figure(f"EMPS with {third.slug} besides, block CV", third.cv_rms, "N"),
    ]


def _screened(recording: Recording, model: Config, given: tuple[str, ...]) -> Screening:
    return screen([recording], model, given=given, refit_base=True, bandwidth_hz=BANDWIDTH_HZ)
