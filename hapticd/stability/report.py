"""The text of ``hapticd check``: the assessment of a configuration, for a reader who does not know the paper."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterator, Sequence
from typing import Any, Final

from hapticd.config.assumed import assumed
from hapticd.config.text import change_line, shortest
from hapticd.stability.advice import Change
from hapticd.stability.assessment import Assessment, Verdict
from hapticd.stability.criterion import criterion_margin, lambda_
from hapticd.stability.devices import HUMAN_OPERATOR, Device, compare, grip_fraction
from hapticd.stability.explore import UNLIMITED
from hapticd.stability.explored import Explored
from hapticd.stability.regions import MEANING
from hapticd.stability.theorems import unproven

HEADLINES: Final[dict[Verdict, str]] = {
    "stable": "stable",
    "depends": "stable for slow motions only",
    "buzzes": "not stable: it will buzz",
    "unstable": "not stable: it will shake",
    "undecided": "not known to be stable",
}

#: The reason in plain words: what dissipates energy, what generates it, and which is larger.
WHY: Final[dict[str, str]] = {
    "A": "Viscous friction dissipates more than the sampled spring generates (β ≥ ½), and Coulomb friction can hold the "
    "steps of the force (σ ≥ q; q = ½ for the encoder's ticks alone). No passive hand can change that.",
    "B": "Viscous friction stops fast motion (β is large enough), but Coulomb friction cannot hold the steps of the force "
    "(σ < q; q = ½ for the encoder's ticks alone). So the spring pushes the device back and forth for ever.",
    "C": "Neither friction is enough: β is too small for fast motion, and σ < q cannot hold the steps of the force. Each "
    "swing gains energy; a light touch is enough to begin.",
    "D": "Viscous friction is too small (β), so stability depends on Coulomb friction, and this motion is too fast for it: "
    "each swing can generate more than friction dissipates. Slower motions die out; so may some faster ones than the limit "
    "below, which is for the worst case.",
    "E": "Viscous friction alone is too small (β), but at this speed Coulomb friction compensates. A faster motion than "
    "the limit below would grow.",
    "F1": "Both frictions are large enough even with the delay in the loop.",
    "F2": "Both frictions are almost large enough, but a delay of a part of a period needs a little more viscous "
    "friction (λ): a stop-and-go motion in step with the servo could gain energy.",
    "D|E": "Viscous friction alone is too small (β), so stability depends on Coulomb friction, which dissipates the same at "
    "any speed, while the spring generates more at higher speed. There is a speed limit, given below.",
    "F1|F2": "Both frictions are nearly large enough at every speed even with the delay in the loop; up to the speed limit "
    "they are.",
}  # fmt: skip

#: Final states that are listed one by one.
_ENDS: Final = 5

_LABELS: Final = {
    "spring.stiffness": "a softer spring",
    "spring.damping": "virtual damping",
    "encoder.decimation": "finer ticks",
    "servo.rate_hz": "a faster servo",
    "delay.computation_s": "a shorter computation",
    "hand.damping": "a firmer grip",
    "deflection": "a smaller deflection",
    "velocity": "a slower motion",
}
_WIDTH = 100
_INDENT = "  "


def report(
    found: Assessment, changes: Sequence[Change], name: str, device: Device | None = None, arguments: str = ""
) -> str:
    """The whole text.

    Args:
        found: the assessment. changes: what would make it stable.
        name: of the configuration. device: its row of Table II, if it has one.
        arguments: options that select the same configuration in another command.
    """
    stable_but = caveat(found) if found.verdict == "stable" else ""
    sections = [
        f"{name}{_motion(found)}: {HEADLINES[found.verdict]}{stable_but}",
        _paragraph(_why(found)),
        "\n".join(_numbers(found)),
    ]
    if found.explored is not None and (command := found.explored.command(found.loop.period, arguments)):
        sections.append(f"To see one of them: {command}")
    if changes:
        sections.append(advice_text(found, changes))
    elif found.verdict != "stable":
        sections.append("No change of one setting makes this stable; change two, or use a device with more friction.")
    if device is not None:
        sections.append("\n".join(_table_ii(device)))
    if found.warnings:
        sections.append("\n".join(_paragraph(f"warning: {text}", "  ") for text in found.warnings))
    return "\n\n".join(sections)


def _why(found: Assessment) -> str:
    text = f"Region {found.region}: {MEANING[found.region]}. {WHY[found.region]}"
    if found.damped is not None:
        return f"Without its virtual damping: region {found.region}: {MEANING[found.region]}.{_proof(found)}"
    if found.region == "C" and found.cycle is not None:
        text += " For this motion the describing function predicts no growth, only the small limit cycle below."
    return text + _proof(found)


def _proof(found: Assessment) -> str:
    """The theorem that proves stability, if any; or the result of the exploration."""
    if found.holds:
        assert found.proof is not None
        return f" {found.proof.words[0].upper()}{found.proof.words[1:]}."
    if found.explored is None:
        return ""
    if found.loop.stiffness == 0.0:
        text = ""
    elif found.proof is None:
        text = f" No theorem proves it: they do not cover {', '.join(unproven(found.config))}."
    else:
        asked = f"λ = {number(found.proof.lam)} and q = {number(found.proof.q)}"
        text = f" No theorem proves it: with everything in the loop they need {asked}."
    return f"{text} Simulated exactly, {found.explored.words}{caveat(found)}."


def caveat(found: Assessment) -> str:
    """Restrictions in brackets: assumed numbers, and what the simulation leaves out; empty if none."""
    keys = assumed(found.config)
    parts = [f"with the assumed {', '.join(keys)}"] if keys else []
    parts += found.explored.approximate if found.explored else ()
    return f" ({'; '.join(parts)})" if parts else ""


def number(value: float | None, digits: int = 3) -> str:
    """A number with few digits; a dash for None, ∞ if infinite."""
    if value is None or math.isnan(value):
        return "–"
    if math.isinf(value):
        return "∞" if value > 0 else "−∞"
    if value != 0.0 and not 1e-3 <= abs(value) < 1e5:
        return f"{value:.{digits}g}".replace("e-0", "e-").replace("e+0", "e")
    return f"{value:.{max(0, digits - 1 - math.floor(math.log10(abs(value))))}f}" if value else "0"


def _paragraph(text: str, hanging: str = "") -> str:
    return textwrap.fill(text, _WIDTH, subsequent_indent=hanging, break_long_words=False)


def _motion(found: Assessment) -> str:
    if found.deflection is not None:
        return f", released at rest from {found.deflection:g} ticks"
    if found.velocity is not None:
        return f", moving at {found.velocity:g} ticks per period"
    if found.explored is None or found.verdict != "stable":
        return ", at any speed"
    if limit := found.config.safety.max_velocity:
        return f", at up to {number(limit)} {'m/s' if found.config.is_linear else 'rad/s'}"
    return f", at up to {UNLIMITED:g} ticks per period"


def _numbers(found: Assessment) -> Iterator[str]:
    n, scales = found.numbers, found.loop.scales
    speed_unit, stiffness_unit = ("m/s", "N/m") if found.config.is_linear else ("rad/s", "N m/rad")

    def speed(xi_dot: float) -> str:
        if math.isinf(xi_dot):
            return "any"
        return f"{number(xi_dot)} ticks per period = {number(float(scales.xi_dot_to_velocity(xi_dot)))} {speed_unit}"

    yield f"inertia           μ = {number(n.mu)}"
    yield f"viscous friction  β = {number(n.beta)}, enough at every speed from λ = {number(float(lambda_(n.tau_d)))}"
    yield f"Coulomb friction  σ = {number(n.sigma)} ticks, enough to hold a step of force from q = {number(n.quantum)}"
    if n.tau_d:
        yield f"delay             τ_D = {number(n.tau_d)} periods = {number(found.loop.delay * 1e6)} µs"
    if n.kappa:
        yield f"hand's stiffness  κ = {number(n.kappa)} of the spring's"
    if found.xi_dot_max is not None:
        yield f"top speed         {speed(found.xi_dot_max)}"
    yield f"speed limit       {speed(found.velocity_limit)}"
    yield f"one count         a period is {number(found.config.count_speed)} {speed_unit}"
    yield f"margin            {number(criterion_margin(n, found.xi_dot_max), 2)} ticks of force (≥ 0: energy cannot rise)"
    limits = f"{number(found.stiffness_passive)} {stiffness_unit} passive"
    if found.stiffness_dissipating is not None:
        limits += f", {number(found.stiffness_dissipating)} {stiffness_unit} for this motion"
    yield f"stiffness up to   {limits} (now {shortest(found.loop.stiffness)})"
    if found.damped is not None:
        yield from _damping(found, stiffness_unit)
    if found.explored is not None and found.explored.cycles:
        yield from _ends(found.explored, found.loop.period)
    if found.cycle is not None:
        hertz = float(scales.omega_to_hz(found.cycle.omega))
        amplitude = number(found.cycle.amplitude)
        yield f"limit cycle       amplitude {amplitude} ticks at {number(hertz)} Hz (describing function)"


def _damping(found: Assessment, stiffness_unit: str) -> Iterator[str]:
    damped, spring = found.damped, found.config.spring
    assert damped is not None
    unit = stiffness_unit.replace("N m/rad", "N m s/rad").replace("N/m", "N s/m")
    estimate = f"difference over {spring.velocity_periods}"
    if spring.velocity_estimate == "low_pass":
        estimate = f"low-pass of {number(spring.velocity_cutoff_hz)} Hz"
    yield "                  (all values above: the spring without its damping)"
    yield f"virtual damping   β_v = {number(damped.damper.beta_v)}, velocity by {estimate}"
    answer = "holds" if damped.passive else "does not hold"
    yield (
        f"passive           b ≥ {'KTλ' if found.loop.delay else 'KT/2 + γB (Colgate and Schenkel)'} {answer}: "
        f"{number(damped.passive_least)} {unit}, of {number(damped.viscous)}"
    )
    if found.proof is not None:
        margin = number(found.proof.margin(found.xi_dot_max), 2)
        yield f"margin            {margin} ticks of force, with the energy that the damping may generate"


def advice_text(found: Assessment, changes: Sequence[Change]) -> str:
    """The changes that would help, a line each under a heading, with the options of ``hapticd check``."""
    every = "" if found.start is not None else " at every speed"
    lines = [f"One of these changes is enough to make it stable{every}:"]
    for each in remedies(found, changes):
        name = each["key"] if "." in each["key"] else f"--{each['key']}"
        lines.append(change_line(name, each))
    if found.verdict == "depends":
        lines.append("Or keep below the speed limit; check a certain motion with --velocity or --deflection.")
    return "\n".join(lines)


def remedies(found: Assessment, changes: Sequence[Change]) -> list[dict[str, Any]]:
    """The same as data: each change with its ``words``."""
    return [{**change.document, "words": _words(found, change)} for change in changes]


def _words(found: Assessment, change: Change) -> str:
    """A change in words, and why it is sufficient."""
    # the regions do not include a damper
    damps = change.key == "spring.damping" or found.damped is not None
    why = "simulated exactly" if damps else f"region {change.region}"
    harsh = ", too soft for a wall" if change.key == "spring.stiffness" and change.size > math.log(10.0) else ""
    left = f"; a buzz of {number(change.buzz, 2)} ticks remains" if change.buzz else ""
    return f"{_LABELS[change.key]}{harsh} ({why}{left})"


def _ends(explored: Explored, period_s: float) -> Iterator[str]:
    """The final states of the starts, with their shares."""
    label = "starts end in"
    for share, name, cycle in explored.ends[:_ENDS]:
        text = f"{number(100.0 * share, 2)} %: {name}"
        if cycle is not None:
            text += f", {number(cycle.amplitude, 2)} ticks"
            text += f" at {number(1.0 / (cycle.periods * period_s))} Hz" if cycle.periods else ""
        yield f"{label:<18}{text}"
        label = ""
    if others := [(share, cycle.amplitude) for share, _, cycle in explored.ends[_ENDS:] if cycle is not None]:
        shares, amplitudes = zip(*others, strict=True)
        count = f"{len(others)} other{'s' * (len(others) > 1)}"
        yield f"{label:<18}{number(100.0 * sum(shares), 2)} %: {count}, up to {number(max(amplitudes), 2)} ticks"


def _table_ii(device: Device) -> Iterator[str]:
    yield f"Table II, {device.name}: printed and recomputed from the row's own columns"
    notes = []
    for row in compare(device):
        symbol = {"mu": "μ", "beta": "β", "sigma": "σ"}[row.quantity]
        yield f"{_INDENT}{symbol}  {row.printed:<8g} {number(row.recomputed, 4):<8} {100 * row.difference:+.1f} %"
        if row.note:
            notes.append(row.note)
    for note in dict.fromkeys(notes):
        yield _paragraph(f"{_INDENT}{note}", _INDENT)
    fraction = grip_fraction(device.loop)
    yield (
        f"{_INDENT}a hand with {100.0 * fraction:.0f} % of the table's human operator ({HUMAN_OPERATOR.damping:g} N s/m) "
        "in parallel makes it passive"
    )
