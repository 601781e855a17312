"""A cogging motor with 8192 counts, two runs at different speeds: is its ripple named, with the orders that it has?

Nothing is known of the motor, so its torque constant is 1 (torques are in A), inertia and friction are guesses, and the
workflow may fit them. The peer is a cogging map of the same motor that was measured separately.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.gap.coverage import listed
from benchmarks.gap_real import answer
from benchmarks.gap_real.datasets import COGGING, COGGING_MAP, imported
from benchmarks.report import Figure, progress
from hapticd.config import Config, parse_config

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
STRONGEST = 5


def guessed_model() -> Config:
    """Inertia and friction of about the right size for such a motor, in A instead of N m."""
    no_limits = {"bandwidth_hz": 0, "dac_bits": 0, "peak_current": 0, "continuous_current": 0}
    return parse_config(
        {
            "encoder": {"counts_per_rev": COUNTS / FINEST},
            "plant": {"inertia": 1e-4, "viscous": 1e-3, "coulomb": 0.1},
            "amplifier": {"torque_constant": 1.0, **no_limits},
        },
        "guessed model",
    )


def orders_of(cogging: NDArray[np.float64]) -> list[int]:
    """The strongest orders per revolution of a cogging map, the strongest first."""
    amplitudes = np.abs(np.fft.rfft(cogging))[1:]
    return [int(order) + 1 for order in np.argsort(amplitudes)[::-1][:STRONGEST]]


def named_orders(document: dict[str, object]) -> list[float]:
    """The orders of the ripple that an answer names, none without one."""
    steps = document["steps"]
    assert isinstance(steps, list)
    ripple = next((step for step in steps if step["effect"] == "torque_ripple"), None)
    return [] if ripple is None else [float(order) for order in listed(ripple["parameters"], "orders", "value")]


def measure(data: Path, scratch: Path) -> list[Figure]:
    """Both runs."""
    model = guessed_model()
    known = orders_of(np.load(data / COGGING_MAP))
    figures = []
    for index, source in enumerate(COGGING):
        recording = imported(data / source, MAP, model, scratch)
        if index == 0:
            answer.compile_on(recording, model, refit_base=True)
        found = answer.answer(scratch / recording.name, model, refit_base=True)
        name = recording.name.removesuffix(".arrow")
        answer.tell(name, found)
        named = named_orders(found.document)
        shared = sum(any(abs(order - other) < 0.25 for other in named) for order in known)
        progress(f"  orders of the measured map: {', '.join(map(str, known))}")
        details = {"named": named, "map": known}
        figures += answer.figures(name, found)
        figures.append(
            Figure(f"{name}, orders in common", shared, f"of {STRONGEST}", peer="the measured map", details=details)
        )
    return figures
