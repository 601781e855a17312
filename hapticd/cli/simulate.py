"""``hapticd simulate``: the servo loop and the plant in virtual time."""

from __future__ import annotations

import contextlib
import signal
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from hapticd.cli import exits, output
from hapticd.cli.command import command
from hapticd.cli.completion import complete_run
from hapticd.cli.exits import UsageError
from hapticd.cli.options import ConfigArgument, Duration, Quantity, SettingsOption, check_run_name, resolve_config
from hapticd.cli.output import number

if TYPE_CHECKING:
    from hapticd.config import Config
    from hapticd.record.schema import Rows

ReplayOption = Annotated[Path | None, typer.Option(metavar="RUN", show_default=False, autocompletion=complete_run)]
_LONGEST_S = 9.2e9  # nanoseconds in 64 bits, with a little room
_MANY_TICKS = 3e9


@command(
    "hapticd simulate --duration 1 --deflection 20.3 --set encoder.decimation=217",
    "hapticd simulate --duration 500ms --deflection 30deg",
    "hapticd simulate rig.yaml --replay release.arrow --deflection 20.3 -o model.arrow",
    "hapticd simulate rig.yaml --duration 10 --velocity 5 -o run.arrow --json",
    codes=(exits.INTERRUPTED,),
)
def simulate(
    config: ConfigArgument = None,
    duration: Duration | None = None,
    replay: ReplayOption = None,
    deflection: Quantity | None = None,
    velocity: Quantity | None = None,
    out: Path | None = None,
    force: bool = False,
    safety: bool = False,
    seed: Annotated[int, typer.Option(min=0, max=2**63 - 1)] | None = None,
    no_energies: bool = False,
    assignments: SettingsOption = None,
) -> int:
    """Run the same servo code and plant in virtual time, as fast as the machine allows.

    Says how it ended: monotone (energy falls at every sample), decaying, persistent or growing, and when it came to rest;
    the plant's true state at the end, from the spring's origin; the largest deflection, speed and current; and the
    frequency of its last swings. A run that grows past 1e9 ticks ends there. The same config and seed give the same rows,
    bit for bit.

    Args:
        duration: Simulated time in s, or 500ms, 2min. Needed without --replay.
        replay (--replay RUN): Tick when the loop of this recording did, with the periods that it missed, and as late as it
            was, from the first tick in which it rendered the spring to the last.
        deflection (TICKS): Begin at exactly this deflection from the spring's origin, in coarse ticks, at rest unless a
            velocity is given too; or with a unit: 0.5rad, 30deg, 2mm, 217counts.
        velocity (TICKS_PER_PERIOD): Begin with this velocity, in coarse ticks per servo period, at the origin unless a
            deflection is given too; or with a unit: 2rad/s, 90deg/s, 100rpm.
        out (-o, --output RUN): Write every tick to this run file.
        force: Replace RUN if it exists.
        safety: Apply the safety trips of the config, as the daemon does; a run that ends in a fault exits with 1.
        seed: Seed of everything random. Default: dither.seed.
        no_energies: Leave out the energies, and with them the outcome: faster by a tenth.
    """
    resolved = resolve_config(config, assignments)
    from hapticd.config.units import deflection_ticks, velocity_ticks

    if (duration is None) == (replay is None):
        raise UsageError("one of --duration and --replay is needed, and only one")
    times = None
    if replay is not None:
        from hapticd.client import find_run
        from hapticd.hil.compare import recorded_times
        from hapticd.record import read_run

        times = recorded_times(read_run(find_run(replay)))
        duration = times.shape[1] * resolved.period
    assert duration is not None
    ticks = None if deflection is None else deflection_ticks(deflection, resolved)
    ticks_per_period = None if velocity is None else velocity_ticks(velocity, resolved)
    if round(duration * resolved.servo.rate_hz) < 1:
        raise UsageError(f"--duration {duration:g} s is shorter than one servo period ({resolved.period:g} s)")
    if duration > _LONGEST_S:
        raise UsageError(
            f"--duration {duration:g} s is too long: the loop counts nanoseconds in 64 bits, at most {_LONGEST_S:.3g} s"
        )
    if (periods := duration * resolved.servo.rate_hz) > _MANY_TICKS:
        output.note(
            f"{periods:.3g} ticks: at some 10 million a second this takes {periods / 3.6e10:.2g} hours; Ctrl-C ends it"
        )
    check_run_name(out, force=force, source=replay)
    from hapticd.servo.simulate import simulate as run

    with _rows_to(out, resolved, seed) as on_rows, output.progress_bar("simulating") as progress:
        report = run(
            resolved,
            duration,
            deflection=ticks,
            velocity=ticks_per_period,
            safety=safety,
            seed=seed,
            energies=not no_energies,
            replay=times,
            on_rows=on_rows,
            progress=progress,
        )
    if out:
        report["run"] = out
    output.emit(report, describe(report, resolved.is_linear))
    for warning in report["warnings"]:
        output.warn(f"warning: {warning}")
    if fault := report["fault"]:
        output.warn(f"fault {fault['code']} in tick {fault['tick']}: {fault['cause']}")
        return exits.NO
    return exits.DONE


@contextlib.contextmanager
def _rows_to(out: Path | None, config: Config, seed: int | None) -> Iterator[Callable[[Rows], None] | None]:
    """A consumer of rows that ends in a whole file under its final name, or in none."""
    if out is None:
        yield None
        return
    from hapticd.config import config_digest
    from hapticd.record import RunWriter
    from hapticd.record.files import written

    metadata: dict[str, Any] = {
        "config": config.model_dump(mode="json"),
        "config_digest": config_digest(config),
        "source": "simulate",
    }
    if seed is not None:
        metadata["seed"] = seed
    before = signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(128 + number))
    try:
        with written(out) as part, RunWriter(part, metadata) as writer:
            yield writer.write
    finally:
        signal.signal(signal.SIGTERM, before)


def describe(report: dict[str, Any], linear: bool) -> str:
    """A few lines of text about one simulation.

    Args:
        report: of `hapticd.servo.simulate.simulate`. linear: metres, not radians.
    """
    unit, final = "m" if linear else "rad", report["final"]
    lines = [
        f"outcome   {_outcome(report)}",
        f"final     {number(final['position_ticks'], 6)} ticks ({number(final['position'])} {unit}), "
        f"{number(final['velocity_ticks_per_period'], 6)} ticks/period ({number(final['velocity'])} {unit}/s)",
        f"current   up to {number(report['peak_current_A'])} A",
        f"ticks     {report['ticks']} in {number(report['wall_s'], 3)} s, {number(report['ticks_per_s'], 3)} ticks/s",
    ]
    if motion := report["motion"]:
        swing = f"; {number(motion['frequency_hz'])} Hz, over the last swings" if motion["frequency_hz"] else ""
        lines.insert(
            2,
            f"motion    up to {number(motion['peak_deflection'])} {unit} from the origin and "
            f"{number(motion['peak_velocity'])} {unit}/s{swing}",
        )
    if fault := report.get("fault"):
        lines.insert(1, f"fault     {fault['code']}: {fault['cause']}")
    if run := report.get("run"):
        lines.append(f"run       {run}")
    return "\n".join(lines)


def _outcome(report: dict[str, Any]) -> str:
    rest_s = (report["motion"] or {}).get("time_to_rest_s")
    if rest_s is None:
        return str(report["outcome"] or "not judged")
    if rest_s == 0.0:
        return f"{report['outcome']}: it did not move, held by friction"
    return f"{report['outcome']}, at rest after {number(rest_s)} s"
