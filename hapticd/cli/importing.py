"""``hapticd import``: measured data from elsewhere as a run file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hapticd.cli import output
from hapticd.cli.command import command
from hapticd.cli.exits import UsageError
from hapticd.cli.options import check_run_name

if TYPE_CHECKING:
    from hapticd.record import Imported

FileArgument = Annotated[
    Path,
    typer.Argument(
        metavar="FILE",
        show_default=False,
        help="Measured data: .csv, .mat, .npy or .parquet; a robot's bag; or a run that was exported as .mcap.",
    ),
]


@command(
    "hapticd import measured.csv --map columns.yaml -o measured.arrow",
    "hapticd import robot_bag --map elbow.yaml -o elbow.arrow",
    "hapticd import run.mcap -o run.arrow",
    name="import",
)
def import_data(
    file: FileArgument,
    out: Path,
    mapping: Path | None = None,
    force: bool = False,
) -> None:
    """Bring in measured data from elsewhere as a run that gap, energy and export read.

    The map says which column is the time (or the rate), the position (counts, angle or length), and the command (current
    or force), each with its unit; and whether the device is rotary or linear. Time stamps keep their jitter.

    Of a robot's bag (ROS 1 .bag; ROS 2 folder, .db3 or .mcap) a column is a joint's signal, elbow.position, with its topic
    where more than one has joints, /arm/joint_states:elbow.effort, or a number in any other message, /command:data[2]; the
    time is column stamp or log_time, in ns. Signals of other topics are joined as they were at each position's instant.
    Needs rosbags: pip install 'hapticd[rosbag]'.

    An .mcap that 'hapticd export' wrote needs no map and becomes the run that it was, bit for bit.

    Args:
        out (-o, --output RUN): Run file to write (.arrow).
        mapping (--map MAP.yaml): What the columns are, with their units; every key is in docs/reference/import-map.md.
            An .mcap of hapticd's own needs none.
        force: Replace RUN if it exists.
    """
    check_run_name(out, force=force, source=file)
    from hapticd.record import import_mcap, import_run, load_map
    from hapticd.robots import hold_against, import_bag, is_bag, limits_of

    if mapping is None and file.suffix.lower() == ".mcap":
        done = import_mcap(file, out, force=force)
    elif mapping is None:
        raise UsageError(f"{file} does not say what its columns are: give --map")
    else:
        columns = load_map(mapping)
        limits = limits_of(columns)
        done = (import_bag if is_bag(file) else import_run)(file, columns, out, force=force)
        done = hold_against(done, limits) if limits else done
    for warning in done.warnings:
        output.warn(f"{file}: {warning}")
    document = {
        "run": done.path,
        "rows": done.rows,
        "duration_s": done.duration_s,
        "rate_hz": done.rate_hz,
        "resolution": done.resolution,
        "position": list(done.position),
        "force" if done.is_force else "current": list(done.command),
        **({"hints": dict(done.hints)} if done.hints else {}),
        "warnings": list(done.warnings),
    }
    output.emit(document, _describe(done))


def _describe(done: Imported) -> str:
    """What was read, in SI units, so that a wrong unit meets the eye."""
    angle, force = ("m", "N") if done.is_linear else ("rad", "N m")
    kind, unit = ("force", force) if done.is_force else ("current", "A")
    low, high, least, most = (output.number(value) for value in (*done.position, *done.command))
    return (
        f"{done.path}: {done.rows} rows, {output.number(done.duration_s)} s at {output.number(done.rate_hz)} Hz\n"
        f"  position {low} to {high} {angle} in steps of {output.number(done.resolution)} {angle}\n"
        f"  {kind} {least} to {most} {unit}"
        + "".join(f"\n  for a config, by the URDF: {key}: {output.number(value)}" for key, value in done.hints.items())
    )
