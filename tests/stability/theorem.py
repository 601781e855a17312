"""The theorems, tested: random loops on the edge of what is proven, run exactly, and S looked at all the way.

Each kind adds one thing to the spring of eq. 2, and ``everything`` all of them. Half of the loops have exactly the σ that
the criterion asks for, so that a constant a little too small would show.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapticd.stability.criterion import lambda_
from tests.stability.storage_runs import LARGEST, LAST_SPEED, QUANTISED_RISE, RISE, START, TOP_SPEED, blank, runs

KINDS: Final = (
    "no delay", "delay", "dither", "converter", "saturation", "one side", "no half tick", "hand", "damping", "everything",
)  # fmt: skip
_ROUNDING: Final = 1e-9


@dataclass(frozen=True)
class Draw:
    """Loops and starts that a theorem covers.

    Attributes:
        cases: (n,) of `CASE`.
        once: (n,) what S may gain once, before the first force arrives.
        top: (n,) the speed that is never exceeded.
    """

    cases: NDArray[Any]
    once: NDArray[np.float64]
    top: NDArray[np.float64]


@dataclass(frozen=True)
class Verdict:
    """What became of many loops.

    Attributes:
        drawn: how many. rising: those in which S exceeded its start and what it may gain once; without delay and damper also
            those in which it rose above the last sample's. faster: those beyond their top speed.
        quantised: those in which H_T of (35) rose from a sample to the next. moving: those that still move in the end.
    """

    drawn: int
    rising: int
    faster: int
    quantised: int
    moving: int


def draw(kind: str, count: int, rng: np.random.Generator, slack: float = 0.0) -> Draw:
    """Draw loops that a theorem covers; ``slack`` takes so many ticks of Coulomb friction away again."""

    def has(name: str) -> bool:
        return kind in (name, "everything")

    def some(*values: float) -> NDArray[np.float64]:
        return rng.choice(np.array(values), count)

    c = blank(count)
    c["mu"] = 10.0 ** rng.uniform(-0.3, 3.0, count)
    if kind != "no delay":
        whole = rng.integers(0, 4, count).astype(float)
        c["tau_d"] = np.where(rng.random(count) < 0.3, whole, rng.uniform(0.0, 3.0, count))
    q = np.full(count, 0.5)
    if has("dither"):
        c["counts"], c["dither"] = some(1, 2, 7, 217), rng.uniform(0.0, 2.0, count)
        q += np.ceil(c["counts"] * c["dither"]) / c["counts"]
    if has("converter"):
        c["step"] = 10.0 ** rng.uniform(-1.0, 1.3, count)
        q += 0.5 * c["step"]
    if has("saturation"):
        c["limit"] = rng.uniform(1.0, 10.0, count)
    if has("one side"):
        c["side"] = some(-1.0, 1.0) if kind == "one side" else some(-1.0, 0.0, 1.0)
    if has("no half tick"):
        c["bias"] = 0.0 if kind == "no half tick" else some(0.0, 0.5)
        c["side"] = some(-1.0, 0.0, 1.0)
    if has("hand"):
        c["kappa"] = some(0.1, 1.0, 3.0)
    if has("damping"):
        c["beta_v"], c["keep"] = 10.0 ** rng.uniform(-1.5, 0.5, count), some(0.0, 0.5, 0.9)
        q += c["beta_v"] * (1.0 - c["keep"])
    lam = lambda_(c["tau_d"], c["beta_v"])
    c["beta"] = lam * np.where(rng.random(count) < 0.4, 1.0, rng.uniform(0.0, 1.0, count))
    moving = rng.random(count) < 0.5
    c["xi"] = np.where(moving & (rng.random(count) < 0.7), 0.0, rng.uniform(-20.0, 20.0, count))
    c["xi_dot"] = np.where(moving, rng.uniform(-6.0, 6.0, count), 0.0)
    place = np.abs(c["xi"]) + 0.5 - c["bias"]
    coasting = np.sqrt(c["xi_dot"] ** 2 + c["kappa"] * c["xi"] ** 2 / c["mu"])
    # with the half tick nothing is gained from the origin, nor from rest
    once = np.where((c["bias"] == 0.5) & ((c["xi"] == 0.0) | ~moving), 0.0, place * coasting * c["tau_d"])
    energy = 0.5 * c["mu"] * c["xi_dot"] ** 2 + 0.5 * c["kappa"] * c["xi"] ** 2 + 0.5 * place**2 + once
    top = np.sqrt(2.0 * energy / c["mu"])
    least = q + (lam - c["beta"]) * top
    c["sigma"] = np.maximum(0.0, least * np.where(rng.random(count) < 0.5, 1.0, rng.uniform(1.0, 1.3, count)) - slack)
    return Draw(c, once, top)


def check(kind: str, count: int, seed: int, periods: int = 150, slack: float = 0.0) -> Verdict:
    """Draw loops of a kind and run them."""
    d = draw(kind, count, np.random.default_rng(seed), slack)
    out = runs(d.cases, periods)
    tolerance = _ROUNDING * (1.0 + out[:, START] + d.once)
    rising = out[:, LARGEST] > out[:, START] + d.once + tolerance
    rising |= (d.cases["tau_d"] == 0.0) & (d.cases["beta_v"] == 0.0) & (out[:, RISE] > tolerance)
    return Verdict(
        drawn=count,
        rising=int(rising.sum()),
        faster=int((out[:, TOP_SPEED] > d.top * (1.0 + _ROUNDING)).sum()),
        quantised=int((out[:, QUANTISED_RISE] > tolerance).sum()),
        moving=int((out[:, LAST_SPEED] > 0.0).sum()),
    )
