"""What ``check`` and the guard claim of fresh configurations, held against `tests.stability.independent`.

Each class adds one thing to the spring of eq. 2. Half of the questions are about a motion, half about all that the limits
admit. Draws have their own seeds: nothing was developed on them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from scipy.stats import beta as beta_distribution

from hapticd.config import Config, parse_config
from hapticd.stability.assessment import assess
from hapticd.stability.explore import GUARD, Effort
from hapticd.stability.guard import judge
from tests.stability.independent import BUZZES, MOVES_ON, runs, starts_within

CLASSES: Final = ("damping", "B", "converter", "dither", "fractional delay", "one-sided", "averaged velocity")
_K, _T, _TICK = 0.012, 1e-3, 2.0 * np.pi / 8192


@dataclass(frozen=True)
class Question:
    """A configuration, and a motion or none."""

    config: Config
    motion: tuple[float, float] | None

    @property
    def asked(self) -> dict[str, float]:
        """The motion as arguments."""
        if self.motion is None:
            return {}
        return {"deflection": self.motion[0]} if self.motion[0] else {"velocity": self.motion[1]}


def draw(kind: str, count: int, seed: int) -> Iterator[Question]:
    """Fresh questions of a class."""
    rng = np.random.default_rng([CLASSES.index(kind), seed])
    for _ in range(count):
        mu, beta, sigma = 10.0 ** rng.uniform(0.3, 2.7), rng.uniform(0.05, 1.2), rng.uniform(0.3, 3.0)
        data: dict[str, Any] = {"amplifier": {"bandwidth_hz": 0, "dac_bits": 0}, "spring": {}}
        if kind in ("damping", "averaged velocity"):
            data["spring"]["damping"] = 10.0 ** rng.uniform(-1.0, 1.3) * _K * _T
        if kind == "averaged velocity":
            if rng.random() < 0.6:
                data["spring"]["velocity_periods"] = int(rng.integers(2, 20))
            else:
                data["spring"] |= {"velocity_estimate": "low_pass", "velocity_cutoff_hz": 10.0 ** rng.uniform(1.2, 2.5)}
        if kind == "B":
            beta, sigma = rng.uniform(0.5, 1.3), rng.uniform(0.0, 0.5)
        if kind == "converter":
            step, sigma = 10.0 ** rng.uniform(-1.0, 1.3), rng.uniform(0.5, 8.0)
            data["amplifier"] |= {"dac_bits": 14, "dac_full_scale": step * _K * _TICK / 0.0292 * 2**13}
        if kind == "dither":
            position, sigma = rng.random() < 0.6, rng.uniform(0.4, 4.0)
            size = rng.uniform(0.1, 3.0)
            data["dither"] = {
                "target": "position" if position else "current",
                "waveform": str(rng.choice(["sine", "triangle", "square", "uniform"])),
                "amplitude": size if position else size * _K * _TICK / 0.0292,
                "frequency_hz": rng.uniform(2.0, 450.0),
            }
        if kind == "fractional delay":
            late = rng.uniform(0.05, 2.5)
            beta = rng.uniform(0.3, 1.1) * (0.5 + late)
            data["delay"] = {"computation_s": late * _T}
        if kind == "one-sided":
            data["spring"]["side"] = str(rng.choice(["positive", "negative"]))
        data["plant"] = {"inertia": mu * _K * _T**2, "viscous": beta * _K * _T, "coulomb": sigma * _K * _TICK}
        motion = None
        if rng.random() < 0.5:
            size = 10.0 ** rng.uniform(-0.3, 1.7)
            motion = (size, 0.0) if rng.random() < 0.5 else (0.0, size / np.sqrt(mu))
        yield Question(parse_config(data, "drawn"), motion)


@dataclass
class Tally:
    """What was claimed of a class, and what is so.

    Attributes:
        drawn: questions. proven, explored, slow, refused: admitted by a proof, by exploration, for slow motions alone
            (``D|E`` without a motion), and not admitted.
        false_proven: proven, and a start without memory goes on. false_explored: admitted by exploration,
            and a start moves on. stable, false_stable: called stable by exploration, and a start goes on, however little.
        provable_refused: refused where a proof covers it. calm: without a start that moves on, and not proven.
        calm_refused: refused among them.
        listed: the false ones.
    """

    drawn: int = 0
    proven: int = 0
    explored: int = 0
    slow: int = 0
    refused: int = 0
    false_proven: int = 0
    false_explored: int = 0
    false_stable: int = 0
    stable: int = 0
    provable_refused: int = 0
    calm: int = 0
    calm_refused: int = 0
    listed: list[str] = field(default_factory=list)


def interval(found: int, among: int) -> tuple[float, float]:
    """95 % interval of a share (Clopper and Pearson)."""
    low = float(beta_distribution.ppf(0.025, found, among - found + 1)) if found else 0.0
    high = float(beta_distribution.ppf(0.975, found + 1, among - found)) if found < among else 1.0
    return low, high


def held_against(kind: str, count: int, seed: int, starts: int, effort: Effort = GUARD) -> Tally:
    """Ask about fresh configurations and run them.

    Args:
        kind: the class. count: how many. seed: of the draw. starts: of each in the independent simulator.
        effort: of what is called stable; the guard has its own.
    """
    rng = np.random.default_rng(seed + 77)
    tally = Tally()
    for number, question in enumerate(draw(kind, count, seed)):
        config, motion = question.config, question.motion
        said, found = judge(config, 0.0, **question.asked), assess(config, effort=effort, **question.asked)
        tally.drawn += 1
        known = f"{kind} {seed}/{number} {question.asked} {said.reason}"
        if found.proven:
            tally.proven += 1
            ended = runs(config, starts_within(config, motion, max(starts // 8, 2), rng, memory=False))
            if np.isin(ended[:, 0], (BUZZES, MOVES_ON)).any():
                tally.false_proven += 1
                tally.listed.append(f"false proven: {known}")
            tally.provable_refused += said.verdict != "admitted"
            continue
        ended = runs(config, starts_within(config, motion, starts, rng))
        moving = int((ended[:, 0] == MOVES_ON).sum())
        admitted = said.verdict == "admitted"
        assert found.explored is not None
        slow = admitted and "simulated exactly" not in said.reason
        tally.slow += slow
        tally.explored += admitted and not slow
        tally.refused += not admitted
        if admitted and not slow and moving:
            tally.false_explored += 1
            tally.listed.append(f"false explored: {moving} of {starts}: {known}")
        if found.explored.stable:
            tally.stable += 1
            if restless := int(np.isin(ended[:, 0], (BUZZES, MOVES_ON)).sum()):
                tally.false_stable += 1
                tally.listed.append(f"false stable: {restless} of {starts}: {known}")
        if moving == 0:
            tally.calm += 1
            tally.calm_refused += not admitted
            if not admitted:
                tally.listed.append(f"refused: {known}")
    return tally
