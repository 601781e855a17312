"""What ``check`` and the guard claim of fresh configurations, held against `tests.stability.independent`.

Each class adds one thing to the spring of eq. 2. Half of the questions are about a motion, half about all that the limits
admit. Draws have their own seeds: nothing was developed on them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, fields
from typing import Any, Final, TypedDict

import numpy as np
from scipy.stats import beta as beta_distribution

from hapticd.config import Config, parse_config
from hapticd.stability.assessment import assess
from hapticd.stability.explore import GUARD, Effort
from hapticd.stability.guard import judge
from tests.stability.independent import BUZZES, MOVES_ON, UNDECIDED, Floats, runs, starts_within

CLASSES: Final = (
    "damping", "B", "converter", "dither", "fractional delay", "one-sided", "averaged velocity", "current loop",
)  # fmt: skip
_K, _T, _TICK = 0.012, 1e-3, 2.0 * np.pi / 8192


class Motion(TypedDict, total=False):
    """Arguments of `judge` and `assess`: a deflection, or a velocity, or neither."""

    deflection: float
    velocity: float


@dataclass(frozen=True)
class Question:
    """A configuration, and a motion or none."""

    config: Config
    motion: tuple[float, float] | None

    @property
    def asked(self) -> Motion:
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
        if kind == "current loop":  # one that rings
            turned, ratio = 10.0 ** rng.uniform(-0.7, 1.3), rng.uniform(0.2, 0.6)
            beta = rng.uniform(0.3, 1.3) * (0.5 + 2.0 * ratio / turned)
            data["amplifier"] |= {"bandwidth_hz": turned / (2.0 * np.pi * _T), "damping_ratio": ratio}
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
            (``D|E`` without a motion), which says nothing of fast ones and is not run, and not admitted.
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

    def __iadd__(self, other: Tally) -> Tally:
        for each in fields(self):
            setattr(self, each.name, getattr(self, each.name) + getattr(other, each.name))
        return self


def interval(found: int, among: int) -> tuple[float, float]:
    """95 % interval of a share (Clopper and Pearson)."""
    low = float(beta_distribution.ppf(0.025, found, among - found + 1)) if found else 0.0
    high = float(beta_distribution.ppf(0.975, found + 1, among - found)) if found < among else 1.0
    return low, high


#: Periods of a first look at a start, and of the second at one that would refute a claim.
_LOOK, _LOOK_AGAIN = 2_000, 16_000
#: Starts between which it is asked whether the answer is known, and how many of them are looked at again.
_SOME, _AGAIN = 500, 8


def _refuting(config: Config, starts: Floats, against: tuple[int, ...]) -> int:
    """How many of the first starts that seem to end in one of ``against`` do so on a longer look; 0: none of all."""
    for first in range(0, len(starts), _SOME):
        some = starts[first : first + _SOME]
        ended = runs(config, some, _LOOK)[:, 0]
        doubtful = some[np.isin(ended, (*against, UNDECIDED))][:_AGAIN]
        if len(doubtful) and (found := int(np.isin(runs(config, doubtful, _LOOK_AGAIN)[:, 0], against).sum())):
            return found
    return 0


def held_against(
    kind: str,
    count: int,
    seed: int,
    starts: int,
    effort: Effort = GUARD,
    jobs: int = 1,
    tell: Callable[[int], None] | None = None,
) -> Tally:
    """Ask about fresh configurations and run them.

    Args:
        kind: the class. count: how many. seed: of the draw. starts: of each in the independent simulator.
        effort: of what is called stable; the guard has its own. jobs: threads; the answer does not depend on it.
        tell: is given the number of questions that are answered.
    """
    tally = Tally()

    def answered(numbered: tuple[int, Question]) -> Tally:
        number, question = numbered
        return _held(question, starts, effort, np.random.default_rng([seed, number]), f"{kind} {seed}/{number}")

    with ThreadPoolExecutor(jobs) as pool:
        for done, one in enumerate(pool.map(answered, enumerate(draw(kind, count, seed))), start=1):
            tally += one
            if tell is not None:
                tell(done)
    return tally


def _held(question: Question, starts: int, effort: Effort, rng: np.random.Generator, name: str) -> Tally:
    config, motion = question.config, question.motion
    said, found = judge(config, 0.0, **question.asked), assess(config, effort=effort, **question.asked)
    admitted = said.verdict == "admitted"
    name = f"{name} {question.asked} {said.reason}"
    one = Tally(drawn=1)
    if found.proven:
        one.proven, one.provable_refused = 1, int(not admitted)
        begun = starts_within(config, motion, starts, rng, memory=False)
        if _refuting(config, begun, (BUZZES, MOVES_ON)):
            one.false_proven = 1
            one.listed.append(f"false proven: {name}")
        return one
    assert found.explored is not None
    if admitted and "simulated exactly" not in said.reason:
        one.slow = 1
        return one
    begun = starts_within(config, motion, starts, rng)
    if found.explored.stable:
        one.stable = 1
        if restless := _refuting(config, begun, (BUZZES, MOVES_ON)):
            one.false_stable = 1
            one.listed.append(f"false stable: {restless} or more of {starts}: {name}")
    moving = 0
    if not found.explored.stable or one.false_stable:
        moving = _refuting(config, begun, (MOVES_ON,))
    one.explored, one.refused = int(admitted), int(not admitted)
    if admitted and moving:
        one.false_explored = 1
        one.listed.append(f"false explored: {moving} or more of {starts}: {name}")
    if not moving:
        one.calm, one.calm_refused = 1, int(not admitted)
        if not admitted:
            one.listed.append(f"refused: {name}")
    return one
