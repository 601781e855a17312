"""Which cases a benchmark has: drawn by seed, the same for the same options, in an order that mixes all kinds.

Kinds: ``single`` (one hidden effect), ``pair`` (two), ``none`` (nothing hidden), ``left_out`` (one hidden effect whose
whole exact class the workflow is not allowed to name).
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass

import numpy as np

from benchmarks.gap import devices
from benchmarks.gap.cases import FORMS
from benchmarks.gap.hidden import LAWS
from benchmarks.gap.recipes import ROTARY_ONLY, VISIBILITY

EXACT_CLASSES = (frozenset({"asymmetric_coulomb", "constant_bias"}),)
"""Effects with the very same law in other parameters."""

NEAR_TIES = tuple(
    frozenset(pair)
    for pair in (
        ("gravity", "constant_bias"),
        ("gravity", "asymmetric_coulomb"),
        ("gravity", "return_spring"),
        ("transport_delay", "amplifier_lag"),
        ("asymmetric_viscous", "constant_bias"),
        ("asymmetric_viscous", "asymmetric_coulomb"),
        ("quadratic_drag", "stribeck"),
        ("presliding", "backlash"),
        ("presliding", "stribeck"),
        ("backlash", "stribeck"),
        ("hand_impedance", "return_spring"),
    )
)
"""Pairs for which "ambiguous" is an honest answer; any other ambiguity is counted as not named."""

KINDS = ("single", "pair", "none", "left_out")
_ONE_JOINT = {"backlash", "flexible_coupling"}
_OTHER_DEVICES = tuple(name for name in devices.MODELS if name != "re35")
_SHARE_OF_RE35 = 0.6


def exact_class(slug: str) -> frozenset[str]:
    """The effect and those with the very same law."""
    return next((group for group in EXACT_CLASSES if slug in group), frozenset({slug}))


@dataclass(frozen=True)
class Case:
    """What is to be hidden in one recording."""

    kind: str
    slugs: tuple[str, ...]
    strength: str
    seed: int
    device: str
    form: str
    duration_s: float

    @property
    def name(self) -> str:
        """A name that says nothing of the truth and changes with every option."""
        return hashlib.sha256(json.dumps(asdict(self), sort_keys=True).encode()).hexdigest()[:12]

    @property
    def excluded(self) -> tuple[str, ...]:
        """Slugs that the workflow may not name."""
        return tuple(sorted(exact_class(self.slugs[0]))) if self.kind == "left_out" else ()


@dataclass(frozen=True)
class Size:
    """How many cases of each kind."""

    seeds: int = 4
    """For every effect and strength."""
    pairs: int = 60
    none: int = 300
    left_out: int = 2
    """For every effect and the strengths clear and strong."""
    duration_s: float = 20.0


FULL = Size()
QUICK = Size(seeds=1, pairs=6, none=12, left_out=1)


def draw(size: Size, seed: int = 0) -> list[Case]:
    """All cases of a benchmark."""
    rng = np.random.default_rng([seed, 0xB11D])
    cases: list[Case] = []

    def add(kind: str, slugs: tuple[str, ...], strength: str) -> None:
        rotary = bool(set(slugs) & set(ROTARY_ONLY))
        others = [name for name in _OTHER_DEVICES if not (rotary and devices.is_linear(devices.MODELS[name]))]
        device = "re35" if rng.random() < _SHARE_OF_RE35 else str(rng.choice(others))
        cases.append(
            Case(kind, slugs, strength, int(rng.integers(2**31)), device, str(rng.choice(FORMS)), size.duration_s)
        )

    for slug in LAWS:
        for strength in VISIBILITY:
            for _ in range(size.seeds):
                add("single", (slug,), strength)
        for strength in ("clear", "strong"):
            for _ in range(size.left_out):
                add("left_out", (slug,), strength)
    for _ in range(size.none):
        add("none", (), "none")
    while sum(case.kind == "pair" for case in cases) < size.pairs:
        first, second = (str(slug) for slug in rng.choice(list(LAWS), 2, replace=False))
        if second not in exact_class(first) and not {first, second} <= _ONE_JOINT:
            add("pair", (first, second), str(rng.choice(["clear", "strong"])))
    return [cases[index] for index in rng.permutation(len(cases))]
