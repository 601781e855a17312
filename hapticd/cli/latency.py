"""``hapticd latency``: how late the servo loop is on this machine, and what that costs in stiffness."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from hapticd.cli import exits, output
from hapticd.cli.command import command
from hapticd.cli.exits import UsageError
from hapticd.cli.options import ConfigArgument, Duration, Rate, SettingsOption, check_figure_name, resolve_config
from hapticd.cli.output import number

if TYPE_CHECKING:
    from hapticd.doctor.latency import LatencyResult


@command(
    "hapticd latency",
    "hapticd latency rig.yaml --rate 1000 --rate 3000 --seconds 60 -o late.png",
    codes=(exits.NO, exits.DEVICE, exits.INTERRUPTED),
)
def latency(
    config: ConfigArgument = None,
    rate: list[Rate] | None = None,
    seconds: Duration = 5.0,
    out: Path | None = None,
    force: bool = False,
    assignments: SettingsOption = None,
) -> int:
    """Measure how late the real servo loop is on this machine, with the configured driver, at several rates.

    The amplifier stays off. For each rate: how late the loop woke and how long a tick took (p50, p99, p99.9, maximum) and
    what was missed; the highest rate that leaves margin; and what the delay that was measured does to the stability
    limit: τ_D and the largest stiffness that is stable at every speed, as declared and as measured.

    Exits with 1 when the configured rate does not hold on this machine.

    Args:
        rate (HZ): Rate to try. Repeatable. Default: 200 to 8000.
        seconds (S): How long each rate runs.
        out (-o, --output FIG): Draw the lateness into this file (.png, .svg or .pdf).
        force: Replace FIG if it exists.
    """
    resolved = resolve_config(config, assignments)
    for value in rate or ():
        if not 1.0 <= value <= 20_000.0:
            raise UsageError(f"--rate {value:g}: must be between 1 and 20000 Hz")
    check_figure_name(out, force=force)
    from hapticd.doctor.latency import RATES_HZ, measure, write_figure

    rates = {*(rate or RATES_HZ), resolved.servo.rate_hz}
    with output.progress_bar("latency") as progress:
        result = measure(resolved, rates, seconds, progress)
    if out is not None:
        write_figure(result, out)
    wanted = next((one for one in result.rates if one.rate_hz == resolved.servo.rate_hz), None)
    holds = wanted is not None and wanted.holds
    document = {**_document(result), "configured": {"rate_hz": resolved.servo.rate_hz, "holds": holds}}
    output.emit(document, report(result, resolved.servo.rate_hz, holds, resolved.is_linear))
    return exits.DONE if holds else exits.NO


def _document(result: LatencyResult) -> dict[str, Any]:
    return {
        "driver": result.driver,
        "declared_latency_s": result.declared_s,
        "highest_rate_hz": result.highest_hz,
        "not_granted": list(result.grants),
        "refused": [{"rate_hz": rate, "reason": reason} for rate, reason in result.refused.items()],
        "rates": [
            {
                "rate_hz": rate.rate_hz,
                **rate.timing,
                "exchanges_missed": rate.exchanges_missed,
                "period_used_p999": rate.used,
                "holds": rate.holds,
                "tau_d": {"declared": rate.tau_d, "measured": rate.tau_d_effective},
                "stiffness_max": {
                    "declared": rate.stiffness_max,
                    "measured": rate.stiffness_max_effective,
                },
            }
            for rate in result.rates
        ],
    }


def report(result: LatencyResult, wanted_hz: float, holds: bool, linear: bool) -> str:
    """The measured latencies as the command prints them."""
    unit = "N/m" if linear else "N m/rad"
    lines = [
        "         late by, µs                     tick, µs        missed  period    τ_D               largest stiffness",
        f"     Hz      p50     p99   p99.9     max    p50   p99.9  periods    used   declared  now     in {unit}, now",
    ]
    for rate in result.rates:
        wake, tick = rate.timing["wake_us"], rate.timing["exec_us"]
        used = f"{100 * rate.used:5.1f} %" if rate.used is not None else "      -"
        lines.append(
            f"{rate.rate_hz:7g}  {_us(wake['p50'])} {_us(wake['p99'])} {_us(wake['p999'])} {_us(wake['max'])}"
            f" {_us(tick['p50'], 6)} {_us(tick['p999'])} {rate.timing['missed']:8d} {used}  "
            f"{rate.tau_d:8.4f} {rate.tau_d_effective:8.4f} {number(rate.stiffness_max):>9} "
            f"{number(rate.stiffness_max_effective):>9}"
        )
    lines += [f"{rate:7g}  refused: {reason}" for rate, reason in result.refused.items()]
    lines += ["", *(f"not granted: {grant}" for grant in result.grants)]
    ended = next((rate for rate in result.rates if not rate.holds), None)
    if ended is not None:
        lines.append(f"{ended.rate_hz:g} Hz: the loop {ended.verdict}.")
    if result.highest_hz is None:
        lines.append("No rate tried holds with half a period to spare; see 'hapticd doctor'.")
    else:
        lines.append(
            f"The highest rate that holds, with half a period to spare at p99.9, is {result.highest_hz:g} Hz. "
            f"The configured {wanted_hz:g} Hz {'holds' if holds else 'does not hold'}."
        )
    return "\n".join(lines)


def _us(value: float | None, width: int = 7) -> str:
    return f"{value:{width}.1f}" if value is not None else f"{'-':>{width}}"
