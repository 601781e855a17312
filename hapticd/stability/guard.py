"""The guard: whether a spring may be rendered, and the reason in one sentence.

A spring that a theorem proves stable is admitted; without a motion, a proof for slow motions is enough (``D|E``), because
every later motion is judged when it begins. All others are explored (`hapticd.stability.explore`), with a limited number of
starts: admitted if all come to rest or end in a buzz below one tick (Fig. 8b), whose largest amplitude is reported; refused
if one moves on or is undecided. `explore_further` continues in the background.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, Literal

from hapticd.config import Config
from hapticd.stability.advice import advise
from hapticd.stability.assessment import Assessment, assess
from hapticd.stability.criterion import velocity_limit
from hapticd.stability.explore import GUARD, explore
from hapticd.stability.explored import Explored
from hapticd.stability.numbers import Loop, from_config, loop_from_config
from hapticd.stability.regions import MEANING, region
from hapticd.stability.report import caveat, number, remedies
from hapticd.stability.theorems import proof_of
from hapticd.stability.tuning import Start

Policy = Literal["refuse", "warn", "off"]
Verdict = Literal["admitted", "refused", "forced", "warned", "off"]

_DAMPING_KEYS: Final = ("damping", "velocity_estimate", "velocity_periods", "velocity_cutoff_hz")
_NO_HELP: Final = "no change of one setting makes this stable; change two, or use a device with more friction"


@dataclass(frozen=True)
class Judgement:
    """The guard's decision.

    Attributes:
        verdict: ``admitted``: the motion dies out, or buzzes below one tick; else ``refused``, ``forced`` (rendered by
            request) or ``warned``, by policy; ``off``: not checked.
        reason: one sentence. region: of Fig. 3 or 5; None if nothing was computed.
        help: advice if no single change makes it stable; else empty.
        predicted: predicted motion, for replies and runs; None if not simulated.
        trips: whether a predicted trip decides, and not the theory.
        remedies: the single changes that are sufficient, as ``hapticd check`` prints them.
    """

    verdict: Verdict
    reason: str
    region: str | None = None
    help: str = ""
    predicted: dict[str, Any] | None = None
    trips: bool = False
    remedies: tuple[dict[str, Any], ...] = ()

    @property
    def document(self) -> dict[str, Any]:
        """The decision as data, for replies, runs and the log."""
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
    """Judge a configuration, and a motion if one is requested.

    Args:
        config: the new configuration; its ``safety.guard`` is the policy.
        latency_s: the driver's declared sample-to-current latency, s.
        deflection: of the shaft at rest, in coarse ticks from the origin. velocity: or its velocity at the
            origin, in ticks per period. Neither: no motion is requested.
        release: whether a smaller deflection can be requested.
        force: render it in any case.
    """
    policy: Policy = config.safety.guard
    if policy == "off":
        return Judgement("off", "safety.guard is off: stability was not checked")
    loop = loop_from_config(config, latency_s)
    if loop.stiffness == 0.0 and loop.damping == 0.0:
        return Judgement("admitted", "spring.stiffness is 0: no spring is rendered", region(loop.numbers))
    if deflection is None and velocity is None:
        proof = proof_of(config, loop)
        if proof is not None and proof.speed_limit > 0.0:
            where = region(loop.numbers)
            return Judgement("admitted", f"{_where(loop, config, where, '')}; {proof.words}", where)
    try:
        found = assess(
            config, deflection=deflection, velocity=velocity, latency_s=latency_s, effort=GUARD, cycles=False
        )
    except ValueError as error:
        return Judgement(_verdict(policy, force), str(error), None, _NO_HELP)
    reason = _reason(found)
    if found.explored is None or found.explored.admissible:
        return Judgement("admitted", reason, found.region)
    changes = [change for change in advise(found) if release or "." in change.key]
    offered = tuple(remedies(found, changes))
    return Judgement(_verdict(policy, force), reason, found.region, "" if offered else _NO_HELP, remedies=offered)


def explore_further(
    config: Config,
    latency_s: float,
    *,
    deflection: float | None = None,
    velocity: float | None = None,
    skip: int = 0,
) -> Explored | None:
    """Run further starts after a judgement; for a background thread while the spring is rendered.

    It takes about 0.1 s of one core in the calling thread, and releases the GIL.

    Args:
        config, latency_s, deflection, velocity: as in `judge`.
        skip: starts that were run before; 0 begins with those of the judgement, which are cached.

    Returns:
        Their result: add ``starts`` to ``skip`` for the next call. If it is not ``admissible``, ``worst_start`` is the
        cause (ticks, ticks per period), and ``words`` and ``command`` describe it. None if a theorem covers the loop.
    """
    loop = loop_from_config(config, latency_s)
    if loop.stiffness == 0.0 and loop.damping == 0.0:
        return None
    asked = deflection is not None or velocity is not None
    motion = (deflection or 0.0, velocity or 0.0) if asked else None
    proof = proof_of(config, loop)
    if proof is not None:
        # without a motion a proof for slow ones is enough, as in `judge`
        fastest = Start.in_ticks(loop, *motion).xi_dot_max(loop) if motion else 0.0
        if fastest <= proof.speed_limit > 0.0:
            return None
    return explore(config, loop=loop, motion=motion, effort=GUARD, skip=skip)


def same_loop(old: Config, new: Config, latency_s: float) -> bool:
    """Whether two configurations are the same in the theory."""
    if from_config(old, latency_s) != from_config(new, latency_s):
        return False
    return all(getattr(old.spring, key) == getattr(new.spring, key) for key in _DAMPING_KEYS)


def _verdict(policy: Policy, force: bool) -> Verdict:
    if policy == "warn":
        return "warned"
    return "forced" if force else "refused"


def _reason(found: Assessment) -> str:
    """One sentence: the region of the loop, and what was proven or found for the motion."""
    motion = ""
    if found.deflection is not None:
        motion = f", at rest {number(found.deflection)} ticks from the origin"
    elif found.velocity is not None:
        motion = f", moving at {number(found.velocity)} ticks per period"
    text = _where(found.loop, found.config, found.region, motion)
    if found.explored is None:
        return f"{text}; {found.proof.words}" if found.holds and found.proof is not None else text
    text += f"; simulated exactly, {found.explored.words}{caveat(found)}"
    return f"{text}: they stay below one tick" if found.explored.admissible and found.explored.buzzing else text


def _where(loop: Loop, config: Config, where: str, motion: str) -> str:
    text = f"region {where}{motion}: {MEANING[where]}"
    if loop.damping > 0.0:
        return f"without its damping {text}"
    if where in ("D", "E", "D|E"):
        limit = float(loop.scales.xi_dot_to_velocity(velocity_limit(loop.numbers)))
        text += f"; the speed limit is {number(limit)} {'m/s' if config.is_linear else 'rad/s'}"
    return text
