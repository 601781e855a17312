"""``python -m benchmarks.gap.varied --seed 100:150``: devices, rates and excitations that the plan does not have.

Each seed makes one case: one effect hidden at a strength from 0.3 to 1, or none in every fifth. The device is one of the
plan's with other inertia, friction, resolution and rate (400 Hz to 4 kHz). It is excited by a multisine, square waves,
filtered noise, the spring's origin alone, or by the origin and then a chirp, for 6 to 30 s; every other one beside a
coloured torque of 3 or 10 % of the friction. Printed are every answer, and how often names are right.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfilt

from benchmarks.gap import devices, options, score, session, tasks
from benchmarks.gap.devices import Model
from benchmarks.gap.disturbance import Coloured
from benchmarks.gap.generate import Lab, UnstableError
from benchmarks.gap.hidden import LAWS
from benchmarks.gap.plan import Case, devices_for
from benchmarks.gap.rate import Rate
from benchmarks.gap.session import Session
from benchmarks.report import progress

Floats = NDArray[np.float64]

_RATES_HZ = (400.0, 500.0, 1000.0, 1000.0, 2000.0, 4000.0)
_COUNTS = (1024, 2000, 4096, 8192, 40_000, 65_536)
_DURATIONS_S = (6.0, 10.0, 20.0, 30.0)
_SPREAD = {"inertia": 2.0, "viscous": 4.0, "coulomb": 2.5}
"""Largest factor between a parameter and the plan's."""


class Played(NamedTuple):
    """What a device is excited with, both of shape (n,)."""

    extra: Floats
    """Over the amplitude of the current."""
    origin: Floats
    """Over that of the spring's origin."""


def _multisine(t: Floats, rate_hz: float, rng: np.random.Generator) -> Played:
    frequencies = np.geomspace(0.2, min(30.0, rate_hz / 12.0), 12)
    phases = rng.uniform(0.0, 2.0 * np.pi, frequencies.size)
    return Played(np.sin(2.0 * np.pi * np.outer(t, frequencies) + phases).sum(axis=1) / 3.0, 0.0 * t)


def _square(t: Floats, rate_hz: float, rng: np.random.Generator) -> Played:
    return Played(np.sign(np.sin(2.0 * np.pi * rng.uniform(0.5, 2.0) * t)) * (0.3 + 0.7 * t / t[-1]), 0.0 * t)


def _noise(t: Floats, rate_hz: float, rng: np.random.Generator) -> Played:
    found = sosfilt(butter(2, [0.3, 8.0], "bandpass", fs=rate_hz, output="sos"), rng.normal(size=t.size))
    return Played(found / found.std(), 0.0 * t)


def _origin(t: Floats, rate_hz: float, rng: np.random.Generator) -> Played:
    return Played(0.0 * t, session.triangle(t * rng.uniform(0.2, 1.0)))


def _mixed(t: Floats, rate_hz: float, rng: np.random.Generator) -> Played:
    half, u = t.size // 2, 2.0 * t / t[-1]
    swept = session.chirp(np.clip(u - 1.0, 0.0, 1.0), 0.5 * t[-1], 0.5, min(30.0, rate_hz / 10.0))
    moved = np.sin(2.0 * np.pi * rng.uniform(0.2, 1.5) * t)
    first = np.arange(t.size) < half
    return Played(np.where(first, 0.0, swept), np.where(first, moved, 0.0))


KINDS: dict[str, Callable[[Floats, float, np.random.Generator], Played]] = {
    "multisine": _multisine,
    "square": _square,
    "noise": _noise,
    "origin": _origin,
    "mixed": _mixed,
}


def play(
    kind: str, nominal: Model, duration_s: float, rng: np.random.Generator, softness: float, scale: float
) -> Session:
    """A session of one kind, sized for the nominal model as `session.draw` is."""
    rate, plant, amplifier = nominal["servo"]["rate_hz"], nominal["plant"], nominal["amplifier"]
    t = np.arange(round(duration_s * rate)) / rate
    played = KINDS[kind](t, rate, rng)
    stiffness = session.stiffness_of(nominal, softness)
    moved = scale * rng.uniform(0.7, 1.4) * session.travel_of(nominal, stiffness)
    current = scale * rng.uniform(2.0, 5.0) * plant["coulomb"] / amplifier["torque_constant"]
    largest = 0.8 * (amplifier["continuous_current"] or math.inf)
    late = session.lateness(t.size, rate, rng) if rng.random() < 0.7 else np.zeros(t.size)
    origin = np.rint(moved * played.origin / devices.resolution(nominal))
    return Session(t + late, late, np.clip(current * played.extra, -largest, largest), origin, stiffness)


class Varied(NamedTuple):
    """A case with its own device and excitation."""

    case: Case
    kind: str
    nominal: Model

    @property
    def lab(self) -> Lab:
        """Where it is recorded."""
        return Lab(self.nominal, devices.LAB_SPEED[self.case.device], lambda *given: play(self.kind, *given))


def drawn(seed: int) -> Varied:
    """The case of a seed."""
    rng = np.random.default_rng([seed, 0x7A81])
    laws = list(LAWS)
    slugs = () if seed % 5 == 0 else (laws[(seed - 1 - seed // 5) % len(laws)],)
    device = str(rng.choice(devices_for(slugs)))
    nominal = devices.model(device)
    for name, factor in _SPREAD.items():
        nominal["plant"][name] *= float(np.exp(rng.uniform(-1.0, 1.0) * math.log(factor)))
    nominal["servo"]["rate_hz"] = float(rng.choice(_RATES_HZ))
    if not devices.is_linear(nominal):
        nominal["encoder"]["counts_per_rev"] = int(rng.choice(_COUNTS))
    strengths = tuple(float(rng.uniform(0.3, 1.0)) for _ in slugs)
    coloured = Coloured(float(rng.choice([0.03, 0.1])), float(rng.choice([0.005, 0.03, 0.1])))
    case = Case(
        "single" if slugs else "none",
        slugs,
        strengths,
        seed,
        0,
        device,
        str(rng.choice(["csv", "parquet"])),
        float(rng.choice(_DURATIONS_S)),
        coloured if rng.random() < 0.5 else None,
    )
    return Varied(case, str(rng.choice(list(KINDS))), nominal)


def answered(seed: int) -> tuple[Varied, float, tasks.Answer]:
    """A case, how well a perfect observer sees its effect, and the answer; an error where no session is possible."""
    one = drawn(seed)
    try:
        files, truth = tasks.make(one.case, one.lab)
    except UnstableError as error:
        return one, 0.0, {"error": str(error)}
    return one, sum(truth["visibility"]), tasks.workflow(files)


def _row(one: Varied, seen: float, answer: tasks.Answer) -> list[str]:
    case = one.case
    beside = f"{case.coloured.share:.0%}, {1e3 * case.coloured.correlation_s:.0f} ms" if case.coloured else ""
    hidden = f"{case.slugs[0]} {case.strengths[0]:.2f}" if case.slugs else "nothing"
    named = ", ".join(score.names_of(answer))
    said = answer["error"].strip().splitlines()[-1] if "error" in answer else score.verdict_of(answer)
    device = f"{case.device}, {one.nominal['servo']['rate_hz']:.0f} Hz, {one.kind}, {case.duration_s:.0f} s"
    spent = f"{answer['processor_s']:.0f}" if "processor_s" in answer else ""
    return [str(case.seed), device, beside, hidden, f"{seen:.1f}", f"{said}: {named}" if named else said, spent]


def rates(found: list[tuple[Varied, float, tasks.Answer]]) -> list[list[str]]:
    """Name of a rate, and the rate."""
    told = [(one.case.slugs, answer) for one, _, answer in found if "processor_s" in answer]
    hidden = [(slugs, answer) for slugs, answer in told if slugs]
    nothing = [answer for slugs, answer in told if not slugs]
    judged = {
        "first name": [score.is_named(answer, slugs) for slugs, answer in hidden],
        "confidently wrong": [score.confident_wrong(answer, slugs) for slugs, answer in hidden],
        "wrong further names": [bool(score.wrong_further(answer, slugs)) for slugs, answer in hidden],
        "nothing hidden: any other answer": [score.is_alarm(answer) for answer in nothing],
        "no answer": ["error" in answer for _, answer in told],
    }
    return [[name, str(Rate(sum(hits), len(hits)))] for name, hits in judged.items()]


def main() -> int:
    """Answer and print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.gap.varied", description=__doc__.split("\n\n")[1])
    parser.add_argument("--seed", type=options.seeds, default=range(50), metavar="A:B", help="one case a seed, as 0:50")
    options.add_engine(parser)
    chosen = parser.parse_args()
    options.check(parser, chosen)
    found = []
    with options.engine(chosen) as pool:
        for done, one in enumerate(pool.map(answered, chosen.seed), 1):
            found.append(one)
            progress(f"{done} of {len(chosen.seed)}: {' | '.join(_row(*one))}")
    head = ["seed", "device", "coloured torque", "hidden, strength", "seen", "answer", "s"]
    print(options.table(head, [_row(*one) for one in found]))
    print()
    print(options.table(["", "rate"], rates(found)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
