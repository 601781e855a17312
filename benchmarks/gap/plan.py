"""Which cases a benchmark has. Every seed makes the same handful of cases, whatever else is asked for.

Kinds: ``single`` (one hidden effect), ``none`` (nothing hidden), ``pair`` (two), ``wrong_base`` (an effect, and one base
parameter that is wrong by 10 to 40 %), ``left_out`` (one hidden effect whose whole exact class the workflow is not allowed
to name). Seeds 0 to 99 are to develop on; those from 100 on are looked at once, when all is decided.

Effects come in shuffled rounds of the whole catalogue, so that a hundred seeds have all of them about equally often;
devices, strengths and files are drawn independently; every other case of a kind has a coloured torque.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np

from benchmarks.gap import devices
from benchmarks.gap.cases import FORMS
from benchmarks.gap.disturbance import CORRELATION_S, SHARES, Coloured
from benchmarks.gap.hidden import LAWS
from benchmarks.gap.recipes import ROTARY_ONLY, WEAKEST

EXACT_CLASSES = (frozenset({"asymmetric_coulomb", "constant_bias"}),)
"""Effects with the very same law in other parameters."""

BASE_ERRORS = ("inertia_error", "viscous_friction", "coulomb_friction", "torque_constant_error")
"""Corrections of base parameters. All four by one factor are none at all, so any three of them can stand for the fourth."""

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
"""Pairs for which "ambiguous" is an honest answer whichever comes first."""

KINDS = ("single", "none", "pair", "wrong_base", "left_out")
FIRST_REPORTED_SEED = 100
_ONE_JOINT = {"backlash", "flexible_coupling"}


def exact_class(slug: str) -> frozenset[str]:
    """The effect and those with the very same law."""
    return next((group for group in EXACT_CLASSES if slug in group), frozenset({slug}))


@dataclass(frozen=True)
class Case:
    """What is to be hidden in one recording."""

    kind: str
    slugs: tuple[str, ...]
    """Hidden effects; the second one of a ``wrong_base`` is the wrong base parameter."""
    strengths: tuple[float, ...]
    """From 0.1 to 1, one for every effect that is drawn by strength."""
    seed: int
    number: int
    """Of the case among those of its seed."""
    device: str
    form: str
    duration_s: float
    coloured: Coloured | None = None

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
    """How many cases of each kind a seed makes."""

    single: int = 3
    none: int = 3
    pair: int = 1
    wrong_base: int = 1
    left_out: int = 1
    duration_s: float = 20.0


FULL = Size()
"""A hundred seeds: 300 single effects, 300 with nothing hidden, 100 of every other kind."""
QUICK = Size(single=2, none=1)


def draw(size: Size, seeds: Sequence[int]) -> list[Case]:
    """The cases of these seeds, seed by seed."""
    return [case for seed in seeds for case in _of_seed(size, seed)]


def is_for_development(seed: int) -> bool:
    """Whether a seed may be looked at as often as one likes."""
    return seed < FIRST_REPORTED_SEED


def _of_seed(size: Size, seed: int) -> list[Case]:
    rng = np.random.default_rng([seed, 0xB11D])
    cases: list[Case] = []
    for kind in KINDS:
        count = getattr(size, kind)
        for index in range(count):
            place = seed * count + index
            slugs = _slugs(kind, place, rng)
            drawn = 1 if kind == "wrong_base" else len(slugs)
            cases.append(
                Case(
                    kind,
                    slugs,
                    tuple(round(float(rng.uniform(WEAKEST, 1.0)), 3) for _ in range(drawn)),
                    seed,
                    len(cases),
                    str(rng.choice(devices_for(slugs))),
                    str(rng.choice(FORMS)),
                    size.duration_s,
                    _coloured(rng) if place % 2 else None,
                )
            )
    return cases


def _coloured(rng: np.random.Generator) -> Coloured:
    return Coloured(float(rng.choice(SHARES)), float(rng.choice(CORRELATION_S)))


def devices_for(slugs: Sequence[str]) -> list[str]:
    """The devices on which these effects can be hidden."""
    rotary = bool(set(slugs) & set(ROTARY_ONLY))
    return [name for name, nominal in devices.MODELS.items() if not (rotary and devices.is_linear(nominal))]


def _slugs(kind: str, place: int, rng: np.random.Generator) -> tuple[str, ...]:
    if kind == "none":
        return ()
    first = _in_rounds(kind, place)
    if kind == "pair":
        others = [slug for slug in LAWS if slug not in exact_class(first) and not {first, slug} <= _ONE_JOINT]
        return first, str(rng.choice(others))
    if kind == "wrong_base":
        return first, str(rng.choice([slug for slug in BASE_ERRORS if slug != first]))
    return (first,)


def _in_rounds(kind: str, place: int) -> str:
    """The effect at a place of an endless row of shuffled catalogues."""
    rounds, within = divmod(place, len(LAWS))
    shuffled = np.random.default_rng([rounds, KINDS.index(kind), 0x5EED]).permutation(list(LAWS))
    return str(shuffled[within])
