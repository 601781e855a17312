"""Single changes of a configuration that make it stable: solved for, rounded to the safe side, and checked again.

Each change is of one number and sufficient alone. The criterion is solved with the motion fixed in SI units; the
result is rounded to few digits on its safe side, applied to the configuration, and kept only if the configuration is valid
and then stable, by a proof or by exploration. Each search is for the single value at which the answer changes (`tuning`
shows why it is unique). In the decimation the margin of a release is not monotone: the nearest stable value is found by a
scan.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Final

from drivers import max_rate
from hapticd.config import Config, ConfigError, apply_settings
from hapticd.config.keys import unit_of
from hapticd.config.sections import Servo
from hapticd.stability.assessment import CALM, Assessment, assess
from hapticd.stability.boundary import boundary
from hapticd.stability.criterion import criterion_margin
from hapticd.stability.devices import HUMAN_OPERATOR
from hapticd.stability.explore import GUARD, REMEDY
from hapticd.stability.numbers import Loop
from hapticd.stability.regions import region
from hapticd.stability.tuning import Start, grip_damping

#: Decimations up to this value are tried one by one, larger ones by bisection.
_SCANNED: Final = 5000
_DIGITS: Final = range(2, 15)
#: Largest relative change of a value by rounding.
_SLACK: Final = 0.03
#: Largest buzz after a change [ticks]: from the damper's response at an encoder edge, not from sampling and quantisation.
_LEFT: Final = 0.02
#: Factors that are tried on a virtual damping that is not stable, the nearest first.
_DAMPING_FACTORS: Final = (0.8, 1.25, 0.6, 1.6, 0.4, 2.5, 0.25, 4.0, 0.1, 10.0, 0.0)
#: Virtual dampings that are tried where there is none, in units of m/T.
_DAMPING_PARTS: Final = (0.02, 0.04, 0.08, 0.12, 0.18, 0.25, 0.35, 0.5)


@dataclass(frozen=True)
class Change:
    """A change of one number of the configuration, or of the motion, that is sufficient.

    Attributes:
        key: dotted config key; ``deflection`` or ``velocity`` for the motion.
        before: its present value. after: the stable value.
        unit: its unit.
        region: after the change. margin: of the paper's criterion after the change, in ticks of force.
        buzz: amplitude in ticks of the largest remaining oscillation; 0 if every start comes to rest.
    """

    key: str
    before: float
    after: float
    unit: str
    region: str
    margin: float
    buzz: float = 0.0

    @property
    def size(self) -> float:
        """How large the change is: |log(after/before)|; infinite for what was zero."""
        return abs(math.log(self.after / self.before)) if self.before > 0.0 < self.after else math.inf

    @property
    def document(self) -> dict[str, Any]:
        """The change as data."""
        return {
            "key": self.key,
            "before": self.before,
            "after": self.after,
            "unit": self.unit,
            "region_after": self.region,
            "margin_after": self.margin,
            "buzz_after": self.buzz,
        }


@dataclass(frozen=True)
class Unit:
    """Unit of the motion in the request: its name, and its size in ticks or ticks per period."""

    name: str
    ticks: float


def advise(found: Assessment, asked_in: Unit | None = None) -> list[Change]:
    """The single changes that make it stable, the smallest first; empty if it is stable, or if no single change is enough.

    Without a motion: stability at every speed.

    Args:
        found: the assessment.
        asked_in: the unit of the motion in the answer; None for ticks and ticks per period.
    """
    if found.verdict == "stable":
        return []
    searches = (_stiffness, _damping, _decimation, _rate, _delay)
    changes = [*(search(found) for search in searches), _motion(found, asked_in)]
    changes.sort(key=lambda change: change.size if change else math.inf)
    return [change for change in [*changes, _grip(found)] if change is not None]


def _safe(loop: Loop, start: Start | None) -> bool:
    return region(loop.numbers, None if start is None else start.xi_dot_max(loop)) in CALM


def _solve(safe: Callable[[float], bool], bad: float, good: float) -> float | None:
    """The safe value nearest to `bad`, between it and `good`, the farthest allowed; None if `good` is not safe."""
    if not safe(good):
        return None
    if safe(bad):
        return bad
    return boundary(lambda value: 1.0 if safe(value) else -1.0, good, bad)


def _rounded(safe: Callable[[float], bool], value: float, *, up: bool = False) -> float:
    """A value of few digits on the safe side of a solution (above it if `up`, else below), or the solution itself."""
    for digits in _DIGITS if value > 0.0 else ():
        power = 10.0 ** (digits - 1 - math.floor(math.log10(value)))
        short = (math.ceil if up else math.floor)(value * power) / power
        if abs(short - value) <= _SLACK * value and short > 0.0 and safe(short):
            return short
    return value


def _apply(found: Assessment, key: str, before: float, after: float) -> Change | None:
    """The change, if the configuration allows it and is stable with it."""
    try:
        config = apply_settings(found.config, {key: after})
    except ConfigError:
        return None
    then = _tried(found, config, found.start)
    if not _helps(then):
        return None
    unit = "counts a tick" if key == "encoder.decimation" else unit_of(key, config.is_linear)
    margin = criterion_margin(then.numbers, then.xi_dot_max)
    return Change(key, before, after, unit, then.region, margin, _buzz(then))


def _tried(found: Assessment, config: Config, start: Start | None) -> Assessment:
    """Assessment after a change, with more starts for `check`; without a motion it ends at a remaining buzz."""
    effort = REMEDY
    if found.effort.starts > GUARD.starts:
        effort = replace(REMEDY, starts=GUARD.starts, periods=GUARD.periods // 2)
    effort = replace(effort, motion_rests=True) if start is not None else replace(effort, until=_LEFT)
    return assess(config, start=start, latency_s=found.latency_s, effort=effort, cycles=False)


def _helps(then: Assessment) -> bool:
    """Whether the requested motion comes to rest and others at most buzz below one tick; without one, whether all rest."""
    if then.verdict == "stable":
        return True
    explored = then.explored
    if explored is None or not explored.admissible:
        return False
    if then.start is not None:
        return explored.motion_rests is True
    return not explored.of_ticks and explored.largest_cycle < _LEFT


def _buzz(then: Assessment) -> float:
    return 0.0 if then.explored is None else then.explored.largest_cycle


def _searched(
    found: Assessment,
    key: str,
    before: float,
    end: float,
    changed: Callable[[float], Loop],
    most: float = math.inf,
) -> Change | None:
    """The nearest safe value between `before` and `end`, of few digits, at most `most`; `changed`: the loop of a value."""

    def safe(value: float) -> bool:
        return value <= most and _safe(changed(value), found.start)

    solved = _solve(safe, before, end)
    if solved is None:
        return None
    return _apply(found, key, before, _rounded(safe, solved, up=end > before))


def _damping(found: Assessment) -> Change | None:
    """The nearest virtual damping of a coarse scale with which the motion of the exact loop dies out.

    Without one the smallest is taken: a damping near m/T makes the loop unstable by itself.
    """
    present, most = found.config.spring.damping, found.loop.inertia / found.loop.period
    if found.loop.stiffness == 0.0:
        return None
    values = [present * factor for factor in _DAMPING_FACTORS] if present else [most * part for part in _DAMPING_PARTS]
    for value in values:
        after = float(f"{value:.2g}")
        if change := _apply(found, "spring.damping", present, after):
            return change
    return None


def _stiffness(found: Assessment) -> Change | None:
    loop, present = found.loop, found.loop.stiffness
    if present == 0.0:
        return None
    return _searched(found, "spring.stiffness", present, present * 1e-6, lambda K: replace(loop, stiffness=K))


def _decimation(found: Assessment) -> Change | None:
    loop, start, present = found.loop, found.start, found.config.encoder.decimation
    raw = loop.resolution / present

    def safe(decimation: float) -> bool:
        return _safe(replace(loop, resolution=math.floor(decimation) * raw), start)

    if present <= _SCANNED:
        after = next((n for n in range(present - 1, 0, -1) if safe(n)), None)
    else:
        solved = _solve(safe, present, 1.0)
        after = None if solved is None else math.floor(solved)
    return None if after is None else _apply(found, "encoder.decimation", present, after)


def _rate(found: Assessment) -> Change | None:
    loop, present = found.loop, found.config.servo.rate_hz
    highest = min(_upper_limit("rate_hz"), max_rate(found.config)[0])
    if present >= highest:
        return None
    key = "servo.rate_hz"
    return _searched(found, key, present, highest, lambda f: replace(loop, period=1.0 / f), highest)


def _upper_limit(key: str) -> float:
    """The largest value that the schema of the servo section allows."""
    limits = [rule.le for rule in Servo.model_fields[key].metadata if hasattr(rule, "le")]
    return float(min(limits, default=math.inf))


def _delay(found: Assessment) -> Change | None:
    """Less computation delay; the amplifier's lag and the driver's latency stay."""
    loop, present = found.loop, found.config.delay.computation_s
    if present == 0.0:
        return None
    key = "delay.computation_s"
    return _searched(found, key, present, 0.0, lambda T_V: replace(loop, delay=loop.delay - present + T_V))


def _motion(found: Assessment, asked_in: Unit | None) -> Change | None:
    """A smaller motion: a smaller deflection of the release, or a lower velocity."""
    if found.damped is not None:
        return None
    key = "velocity" if found.velocity is not None else "deflection"
    asked = found.velocity if found.velocity is not None else found.deflection
    if not asked:
        return None
    loop, given = found.loop, asked_in or Unit("ticks/period" if key == "velocity" else "ticks", 1.0)
    size = abs(asked) / given.ticks

    def begun(value: float) -> Start:
        return Start.in_ticks(loop, **{key: math.copysign(value * given.ticks, asked)})

    def safe(value: float) -> bool:
        return _safe(loop, begun(value))

    solved = _solve(safe, size, 0.0)
    if solved is None or solved <= 0.0:
        return None
    after = _rounded(safe, solved)
    then = _tried(found, found.config, begun(after))
    if not _helps(then):
        return None
    margin = criterion_margin(then.numbers, then.xi_dot_max)
    before, after = (math.copysign(value, asked) for value in (size, after))
    return Change(key, before, after, given.name, then.region, margin, _buzz(then))


def _grip(found: Assessment) -> Change | None:
    """A hand's damping in parallel (Sec. III-B), for a linear device that needs no more than the paper's operator has.

    The paper has no hand for a rotary device; there the effect of a grip depends on the handle.
    """
    loop, present = found.loop, found.config.hand.damping
    missing = grip_damping(loop)
    if missing == 0.0 or (found.config.is_linear and present + missing > HUMAN_OPERATOR.damping):
        return None
    key, enough = "hand.damping", present + missing * (1.0 + 1e-9)
    return _searched(found, key, present, enough, lambda b: replace(loop, viscous=loop.viscous - present + b))
