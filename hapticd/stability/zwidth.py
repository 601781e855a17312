"""The Z-width of a device: the stiffness K and virtual damping B that it renders stably, in every hand and at every speed.

Z-width: the range of impedances that a device renders passively (Colgate and Brown, "Factors affecting the Z-width of a
haptic display", ICRA 1994). Here every point of the (B, K) plane is simulated exactly, with ticks and friction, once for
each hand and speed; the worst outcome counts:

* **hands**: none, increasing fractions of the human operator of Table II in parallel, and the config's hand. A rotary device
  is held by a handle of a given radius;
* **speeds**: motions through the spring's origin, from an amplitude of two ticks to the fastest that the limits admit:
  `safety.max_velocity`, or less if the motion would exceed `safety.max_excursion`, or if the force of K and B would exceed
  the peak current, above which K and B are not rendered. Each begins at another position within a tick.

A point is *calm* if its motions die out or end below one tick. The result also has the exact boundary of the linear loop
(`hapticd.stability.linear_loop`), the range that a theorem proves, and the passive range.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapticd.config import Config, apply_settings
from hapticd.stability.damping import passive_stiffness, velocity_filter
from hapticd.stability.devices import HUMAN_OPERATOR, Hand
from hapticd.stability.explore import threads
from hapticd.stability.linear_loop import VelocityFilter, largest_damping, largest_stable
from hapticd.stability.numbers import Loop, loop_from_config
from hapticd.stability.outcome import GROWING, PERSISTENT
from hapticd.stability.sampled_loop import HORIZON
from hapticd.stability.storage import FloatArray
from hapticd.stability.theorems import proven
from hapticd.stability.tuning import Start
from hapticd.stability.whole_loop import blank

#: Outcomes of a motion, from the best to the worst.
VERDICTS: Final = ("stable", "buzzes", "oscillates", "unstable")
STABLE, BUZZES, OSCILLATES, UNSTABLE = range(4)
#: Fractions of the human operator in parallel with the device.
GRIPS: Final = (0.0, 0.1, 0.3, 1.0)
#: Radius in m of the handle of a rotary device.
RADIUS: Final = 0.02
SPEEDS: Final = 5
_SLOWEST: Final = 2.0
"""Amplitude in ticks of the slowest motion."""
_UNLIMITED: Final = 1000.0
"""Largest speed in ticks per period if there is no limit."""
_SHORTEST, _TURNS, _LONGEST = 3000, 60.0, 20_000
"""Length of a run: smallest in periods, in radians of the softest spring, and largest in periods."""
_ENDLESS, _STOPS = 200_000, 2.5
"""Longest horizon in periods; and a factor on the time in which Coulomb friction alone stops a motion."""
_SOFTEST, _HALVINGS = 1e-3, 10
"""Search for the exact boundary below the smallest K of the plane: lower end as a factor, and bisection steps."""
_SOFT: Final = 1e-9
"""K in m/T² from which a proof is tried."""
_MARGIN: Final = 1.15
"""End of the axes, relative to the boundary of the linear loop."""
_CHUNK = 100
"""Loops per task of a thread."""


@dataclass(frozen=True)
class Held:
    """The device in a hand: impedance of the hand, both as a loop (SI), and the (n,) largest K of the linear loop."""

    name: str
    hand: Hand
    loop: Loop
    linear: FloatArray


@dataclass(frozen=True)
class ZWidth:
    """A Z-width.

    Attributes:
        config: of the device. fastest: the largest speed anywhere in the plane, rad/s or m/s.
        damping: (n,) B in N m s/rad or N s/m, from 0. stiffness: (m,) K in N m/rad or N/m, evenly spaced from one step on.
        held: the device in each hand. outcome: (n, m) index into `VERDICTS`: of the worst hand and speed, or the first that
            is not calm. exact: (n,) largest K below which every point is calm.
        proven: (n,) largest K up to which a theorem proves every hand and speed.
        passive: (n,) largest K that is passive without a hand (Colgate and Schenkel; with delay λ), 0 if none.
    """

    config: Config
    fastest: float
    damping: FloatArray
    stiffness: FloatArray
    held: tuple[Held, ...]
    outcome: NDArray[np.int8]
    exact: FloatArray
    proven: FloatArray
    passive: FloatArray

    @property
    def linear(self) -> FloatArray:
        """(n,) largest K with which the linear loop is stable in every hand."""
        return np.asarray(np.min([held.linear for held in self.held], axis=0))

    @property
    def report(self) -> dict[str, Any]:
        """The JSON document."""
        limits = {"linear": self.linear, "exact": self.exact}
        largest = limits | {"proven": self.proven, "passive": self.passive}
        return {
            "rows": [
                {"stiffness": K, "damping": B, "verdict": VERDICTS[self.outcome[i, j]], "proven": self.proven[i] >= K}
                for i, B in enumerate(self.damping.tolist())
                for j, K in enumerate(self.stiffness.tolist())
            ],
            "boundary": {name: self._line(limit) for name, limit in limits.items()},
            "largest": {name: self._largest(limit) for name, limit in largest.items()},
            "hands": [
                {"name": held.name, **asdict(held.hand), "linear": self._largest(held.linear)} for held in self.held
            ],
            "fastest": self.fastest,
            "speeds": SPEEDS,
        }

    def _line(self, limit: FloatArray) -> list[dict[str, float]]:
        return [{"damping": B, "stiffness": K} for B, K in zip(self.damping.tolist(), limit.tolist(), strict=True)]

    def _largest(self, limit: FloatArray) -> dict[str, float]:
        best = int(np.argmax(limit))
        return {
            "stiffness": float(limit[best]),
            "damping": float(self.damping[best]),
            "without_damping": float(limit[0]),
        }


def zwidth(
    config: Config,
    latency_s: float,
    *,
    velocity: float = math.inf,
    radius: float = RADIUS,
    count: int = 48,
    damping_max: float | None = None,
    stiffness_max: float | None = None,
    jobs: int | None = None,
    progress: Callable[[float], None] = lambda fraction: None,
) -> ZWidth:
    """Compute the Z-width of a device with the velocity estimate of its config.

    Args:
        config: of the device; its ``spring.stiffness`` and ``spring.damping`` are not used.
        latency_s: the driver's declared latency.
        velocity: largest speed, in addition to the limits of the config; rad/s or m/s.
        radius: of the handle of a rotary device, m.
        count: points along each axis, at least 2.
        damping_max, stiffness_max: ends of the axes; None for 1.15 of the boundary of the linear loop.
        jobs: threads; None for one per core that this process may use. progress: takes the fraction done.

    Raises:
        ValueError: the velocity, the radius or an end of an axis is not above 0, or the count below 2.
    """
    for name, value in (("velocity", velocity), ("radius", radius), ("damping_max", damping_max or 1.0),
                        ("stiffness_max", stiffness_max or 1.0)):  # fmt: skip
        if not value > 0.0:
            raise ValueError(f"{name} must be above 0, got {value:g}")
    if count < 2:
        raise ValueError(f"a Z-width needs at least two points along each axis, got {count}")
    bare = apply_settings(config, {"hand.inertia": 0.0, "hand.damping": 0.0, "hand.stiffness": 0.0})
    device, estimate = loop_from_config(bare, latency_s), velocity_filter(config.spring, config.period)
    hands = [
        (name, hand, device.with_hand(hand.inertia, hand.damping, hand.stiffness))
        for name, hand in _hands(config, radius)
    ]
    loops = [loop for _, _, loop in hands]
    unit = device.inertia / config.period
    B_max = damping_max or _MARGIN * min(largest_damping(loop, estimate) for loop in loops) or unit
    B = np.linspace(0.0, B_max, count)
    held = tuple(Held(*hand, largest_stable(hand[2], estimate, B)) for hand in hands)
    linear = np.min([each.linear for each in held], axis=0)
    proofs = _proven(config, loops, B, velocity)
    K_max = stiffness_max or max(_MARGIN * float(linear.max()), 2.0 * float(proofs[0])) or unit / config.period
    K = K_max * np.arange(1, count + 1) / count
    judge = _Judge(config, loops, estimate, velocity, jobs)
    grid = np.repeat(B, count), np.tile(K, count)
    outcome = judge(*grid, lambda done: progress(0.8 * done)).reshape(count, count)
    # between the last calm point and the first that is not; if no point is calm, from `_SOFTEST` of the smallest K on
    low, high = (_below(K, outcome <= BUZZES, shift) for shift in (0, 1))
    open_ = low < K_max
    low = np.where(low > 0.0, low, _SOFTEST * high)
    for k in range(_HALVINGS):
        middle = np.where(low < 0.5 * high, np.sqrt(low * high), 0.5 * (low + high))
        calm = np.zeros(count, np.bool_)
        calm[open_] = judge(B[open_], middle[open_]) <= BUZZES
        low, high = np.where(open_ & calm, middle, low), np.where(open_ & ~calm, middle, high)
        progress(0.8 + 0.2 * (k + 1) / _HALVINGS)
    exact = np.where(low > _SOFTEST * K[0], low, 0.0)
    fastest = max(float(top_speed(config, loop, *grid, velocity).max()) for loop in loops)
    return ZWidth(config, fastest, B, K, held, outcome, exact, proofs, passive_stiffness(config, device, B))


def _below(stiffness: FloatArray, good: NDArray[np.bool_], shift: int = 0) -> FloatArray:
    """(n,) the K below which all points (n, m) are good, 0 if the smallest is not; with ``shift`` 1 one step more."""
    softer = np.where(good.all(axis=1), good.shape[1], np.argmin(good, axis=1))
    return np.asarray(np.append(0.0, stiffness)[np.minimum(softer + shift, good.shape[1])])


def _hands(config: Config, radius: float) -> list[tuple[str, Hand]]:
    """The hands that hold a device, as impedances at the shaft or carriage."""
    lever = 1.0 if config.is_linear else radius * radius
    full, own = HUMAN_OPERATOR, config.hand
    hands = []
    for grip in GRIPS:
        name = f"{100 * grip:g} % of a human operator" if grip else "no hand"
        parts = (grip * lever * part for part in (full.inertia, full.damping, full.stiffness))
        hands.append((name, Hand(*parts)))
    if own.inertia or own.damping or own.stiffness:
        hands.append(("the config's hand", Hand(own.inertia, own.damping, own.stiffness)))
    return hands


def top_speed(config: Config, loop: Loop, B: FloatArray, K: FloatArray, velocity: float = math.inf) -> FloatArray:
    """The largest speed at the origin that the limits of a config admit, in rad/s or m/s; B and K broadcast.

    Without friction, a motion at v reaches x = v √(m/(K + k_H)) and needs a force of v √(K²m/(K + k_H) + B²).
    """
    reach = np.sqrt(loop.inertia / (K + loop.hand_stiffness))
    limits = [np.full(np.broadcast(B, K).shape, velocity)]
    if config.safety.max_velocity:
        limits.append(np.asarray(config.safety.max_velocity))
    if config.safety.max_excursion:
        limits.append(config.safety.max_excursion / reach)
    if config.amplifier.peak_current:
        force = config.amplifier.peak_current * config.amplifier.torque_constant
        limits.append(force / np.hypot(K * reach, B))
    slowest = np.minimum.reduce(np.broadcast_arrays(*limits))
    return np.where(np.isinf(slowest), loop.scales.xi_dot_to_velocity(_UNLIMITED), slowest)


def motions(loop: Loop, estimate: VelocityFilter, B: FloatArray, K: FloatArray) -> NDArray[Any]:
    """A loop with other springs and dampers, B and K (p,), at rest at its origin; (p,) of `whole_loop.LOOP`."""
    starts = blank(B.size)
    numbers = replace(loop, stiffness=1.0).numbers
    for name in ("mu", "beta", "sigma", "kappa"):
        starts[name] = getattr(numbers, name) / K
    starts["tau_d"], starts["beta_v"] = numbers.tau_d, B / (K * loop.period)
    starts["periods"], starts["keep"] = estimate
    return starts


@dataclass(frozen=True)
class _Judge:
    """Runs points of the plane in every hand and at every speed, each until one is not calm."""

    config: Config
    loops: list[Loop]
    estimate: VelocityFilter
    velocity: float
    jobs: int | None

    def __call__(
        self, B: FloatArray, K: FloatArray, progress: Callable[[float], None] = lambda fraction: None
    ) -> NDArray[np.int8]:
        """Index into `VERDICTS` of each point; B and K (p,)."""
        worst = np.zeros(B.size, np.int8)
        # the device without a hand and the fastest motions first: they exclude most points
        turns = [(loop, s) for loop in self.loops for s in reversed(range(SPEEDS))]
        for turn, (loop, s) in enumerate(turns):
            calm = worst <= BUZZES
            if calm.any():
                worst[calm] = np.maximum(worst[calm], self._run(loop, B[calm], K[calm], s))
            progress((turn + 1) / len(turns))
        return worst

    def _run(self, loop: Loop, B: FloatArray, K: FloatArray, which: int) -> NDArray[np.int8]:
        T = loop.period
        fastest = loop.scales.velocity_to_xi_dot(top_speed(self.config, loop, B, K, self.velocity))
        slowest = np.minimum(_SLOWEST * T * np.sqrt((K + loop.hand_stiffness) / loop.inertia), fastest)
        # multiples of the golden ratio, so that each speed begins at another position within a tick
        place = np.full(B.size, (which * 0.618034) % 1.0)
        starts = motions(loop, self.estimate, B, K)
        starts["xi"], starts["xi_dot"] = place, slowest * (fastest / slowest) ** (which / (SPEEDS - 1))
        periods = int(min(max(_TURNS * math.sqrt(float(starts["mu"].max())), _SHORTEST), _LONGEST))
        runs = run_in_threads(starts, periods, self.jobs)
        moving = (runs["reason"] == HORIZON) & ((runs["outcome"] != PERSISTENT) | (runs["amplitude"] >= 1.0))
        if moving.any():
            first = starts[moving]
            stops = 0.0
            if loop.coulomb > 0.0:
                stops = _STOPS * float((first["xi_dot"] * first["mu"] / first["sigma"]).max())
            runs[moving] = run_in_threads(first, int(min(max(stops, _LONGEST), _ENDLESS)), self.jobs)
        small = runs["amplitude"] < 1.0
        goes_on = np.where(small, BUZZES, np.where(runs["outcome"] == GROWING, UNSTABLE, OSCILLATES))
        return np.where(runs["outcome"] < PERSISTENT, STABLE, goes_on).astype(np.int8)


def run_in_threads(loops: NDArray[Any], periods: int, jobs: int | None) -> NDArray[Any]:
    """`run_loops` on threads; None for one per core that this process may use."""
    with threads(jobs) as run:
        return run(loops, periods, _CHUNK)


def _proven(config: Config, loops: list[Loop], damping: FloatArray, velocity: float) -> FloatArray:
    """(n,) the K up to which a theorem proves every hand and speed, within 1 %; it falls as B grows."""
    found = np.zeros_like(damping)

    def holds(B: float, K: float) -> bool:
        here = apply_settings(config, {"spring.stiffness": K, "spring.damping": B})
        return all(_proves(here, replace(loop, stiffness=K, damping=B), velocity) for loop in loops)

    low = _SOFT * loops[0].inertia / loops[0].period ** 2
    for i, B in enumerate(damping.tolist()):
        if not holds(B, low):
            break
        within, beyond = low, 2.0 * low
        while holds(B, beyond):
            within, beyond = beyond, 2.0 * beyond
        while beyond > 1.01 * within:
            middle = math.sqrt(within * beyond)
            within, beyond = (middle, beyond) if holds(B, middle) else (within, middle)
        found[i] = within
    return found


def _proves(config: Config, loop: Loop, velocity: float) -> bool:
    top = top_speed(config, loop, np.array(loop.damping), np.array(loop.stiffness), velocity)
    return proven(config, loop, Start(velocity=float(top)).xi_dot_max(loop))
