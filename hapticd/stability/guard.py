"""The guard: may this spring be rendered? One place for the answer, one sentence for the reason.

What a theorem proves is admitted. A motion that the theory does not see die out is refused: C; D, which is a motion beyond
the velocity limit (15); F2, where nothing is proven; B where its oscillation reaches one tick, or where dither or the
converter make it and not the ticks. Without a motion, ``D|E`` and ``F1|F2`` are admitted: slow motions die out there, and
every later motion is judged again when it begins.

With virtual damping no region decides: the exact loop is run, and admitted is what dies out or stays below one tick.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np

from hapticd.config import Config
from hapticd.stability.advice import advise
from hapticd.stability.assessment import Assessment, assess
from hapticd.stability.criterion import velocity_limit
from hapticd.stability.limit_cycle import predicted_cycle
from hapticd.stability.numbers import Loop, from_config, loop_from_config
from hapticd.stability.regions import MEANING, region
from hapticd.stability.report import advice_text, exactly, number
from hapticd.stability.tuning import Start

Policy = Literal["refuse", "warn", "off"]
Verdict = Literal["admitted", "refused", "forced", "warned", "off"]

#: Regions to which a refused motion is advised to move.
CALM: Final = frozenset({"A", "E", "F1", "F1|F2"})
#: Regions in which it takes more than the region to say that a motion dies out.
_DOUBTFUL: Final = frozenset({"B", "C", "D", "F2"})
_ONE_TICK: Final = 1.0
#: q up to which the steps of a force are those of the ticks, which is what the cycles of theory are of.
_TICKS_ALONE: Final = 0.55
_DAMPING_KEYS: Final = ("damping", "velocity_estimate", "velocity_periods", "velocity_cutoff_hz")
#: What the region's meaning does not say of a motion that is not admitted.
_MORE: Final = {
    "B": "; here they may reach one tick and more",
    "F2": "; no criterion proves that this motion dies out",
}
_NO_HELP: Final = "no single change of one setting makes this stable; change two, or take a device with friction"


@dataclass(frozen=True)
class Judgement:
    """What the guard says.

    Attributes:
        verdict: ``admitted``: it dies out; else ``refused``, ``forced`` (asked for all the same) or ``warned``, by policy;
            ``off``: the guard does not look.
        reason: one sentence. region: of Fig. 3 or 5; None where nothing was worked out.
        help: what would make it stable, as ``hapticd check`` prints it; empty where it is admitted.
        predicted: what the loop would do, for replies and runs; None where it was not run ahead.
        trips: whether it is a trip of its limits there that decides, and not theory.
    """

    verdict: Verdict
    reason: str
    region: str | None = None
    help: str = ""
    predicted: dict[str, Any] | None = None
    trips: bool = False

    @property
    def document(self) -> dict[str, Any]:
        """It as data, for replies, runs and the log."""
        return {
            "verdict": self.verdict,
            "reason": self.reason,
            "region": self.region,
            "force": self.verdict == "forced",
            "predicted": self.predicted,
        }


def judge(
    config: Config,
    latency_s: float,
    *,
    deflection: float | None = None,
    velocity: float | None = None,
    release: bool = False,
    force: bool = False,
) -> Judgement:
    """Judge a configuration, and a motion if one is about to begin.

    Args:
        config: the configuration to be put into force; its ``safety.guard`` is the policy.
        latency_s: the driver's declared sample-to-current latency, s.
        deflection: where the shaft is at rest, in coarse ticks from the origin. velocity: or how fast it passes the
            origin, in ticks per period. Neither: no motion is about to begin.
        release: whether a smaller deflection is something that can be asked for.
        force: go on all the same.
    """
    policy: Policy = config.safety.guard
    if policy == "off":
        return Judgement("off", "safety.guard is off: stability was not looked at")
    loop = loop_from_config(config, latency_s)
    motion = _motion(deflection, velocity)
    try:
        where = _region(loop, deflection, velocity)
        if config.spring.damping == 0.0 and (where not in _DOUBTFUL or loop.stiffness == 0.0):
            return Judgement("admitted", _reason(loop, config.is_linear, where, motion), where)
        found = assess(config, deflection=deflection, velocity=velocity, latency_s=latency_s)
    except ValueError as error:
        return Judgement(_verdict(policy, force), str(error), None, _NO_HELP)
    reason = _reason(loop, config.is_linear, where, motion)
    if found.damped is not None:
        reason = f"without its damping {reason}. {exactly(found)}"
        if found.proven or found.damped.oscillation < _ONE_TICK:
            return Judgement("admitted", reason, where)
        changes = [change for change in advise(found) if release or "." in change.key]
        return Judgement(_verdict(policy, force), reason, where, advice_text(found, changes) if changes else _NO_HELP)
    if where == "B" and found.numbers.quantum <= _TICKS_ALONE and _largest_cycle(found) < _ONE_TICK:
        return Judgement("admitted", f"{reason}; here they stay below one tick", where)
    changes = [change for change in advise(found, CALM) if release or "." in change.key]
    help_text = advice_text(found, changes) if changes else _NO_HELP
    return Judgement(_verdict(policy, force), f"{reason}{_MORE.get(where, '')}", where, help_text)


def same_loop(old: Config, new: Config, latency_s: float) -> bool:
    """Whether the theory sees no difference between two configurations."""
    if from_config(old, latency_s) != from_config(new, latency_s):
        return False
    return all(getattr(old.spring, key) == getattr(new.spring, key) for key in _DAMPING_KEYS)


def _verdict(policy: Policy, force: bool) -> Verdict:
    if policy == "warn":
        return "warned"
    return "forced" if force else "refused"


def _region(loop: Loop, deflection: float | None, velocity: float | None) -> str:
    if (deflection is None and velocity is None) or loop.stiffness == 0.0:
        return region(loop.numbers)
    start = Start.in_ticks(loop, deflection=deflection or 0.0, velocity=velocity or 0.0)
    with np.errstate(over="ignore", invalid="ignore"):
        return region(loop.numbers, start.xi_dot_max(loop))


def _motion(deflection: float | None, velocity: float | None) -> str:
    if deflection is not None:
        return f", at rest {number(deflection)} ticks from the origin"
    return "" if velocity is None else f", moving at {number(velocity)} ticks per period"


def _largest_cycle(found: Assessment) -> float:
    """Amplitude in ticks of the largest oscillation that this motion, or the smallest disturbance, can end in."""
    cycles = (found.cycle, predicted_cycle(found.numbers), *found.locked)
    return max((cycle.amplitude for cycle in cycles if cycle is not None), default=0.0)


def _reason(loop: Loop, linear: bool, where: str, motion: str) -> str:
    if loop.stiffness == 0.0:
        return "spring.stiffness is 0: no spring is rendered"
    text = f"region {where}{motion}: {MEANING[where]}"
    if where in ("D", "E", "D|E"):
        limit = float(loop.scales.xi_dot_to_velocity(velocity_limit(loop.numbers)))
        text += f"; the speed limit is {number(limit)} {'m/s' if linear else 'rad/s'}"
    return text
