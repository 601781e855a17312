"""``hapticd map``: region maps by exact simulation, held against theory."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from hapticd.cli import exits, output
from hapticd.cli.command import command
from hapticd.cli.exits import UsageError
from hapticd.cli.options import Count, Finite, Positive
from hapticd.cli.output import number
from hapticd.figures.files import refuse_existing, save_figure

if TYPE_CHECKING:
    from hapticd.stability.map_engines import Results
    from hapticd.stability.maps import Chunk, Maps

_FIGURE_FORMATS = ("png", "svg", "pdf")
_LISTED = 10
_DEFAULT = Path("maps.npz")


@command(
    "hapticd map                                        Fig. 6 and 7 of the paper",
    "hapticd map --tau-d 0.5 --velocity 2 -o half.npz --figure half.svg",
    "hapticd map --beta-count 340 --sigma-count 210 --dask tcp://cluster:8786 -o fine.npz",
    codes=(exits.NO, exits.INTERRUPTED),
    name="map",
)
def region_map(
    mu: Positive = 100.0,
    tau_d: list[Finite] | None = None,
    velocity: list[Finite] | None = None,
    periods: Annotated[int, typer.Option(min=12)] = 50_000,
    beta_count: Count = 34,
    beta_max: Positive | None = None,
    sigma_count: Count = 21,
    sigma_max: Positive = 3.0,
    out: Path = _DEFAULT,
    figure: Path | None = None,
    no_figure: bool = False,
    jobs: Count | None = None,
    dask: str | None = None,
    force: bool = False,
) -> int:
    """Simulate a grid of friction values and compare what becomes of the motion with what the theory promises.

    Every point of the (beta, sigma) plane is run exactly until its fate is certain or the horizon is reached, and sorted
    into monotone (comes to rest, energy falls all the time), decaying, persistent or growing. The defaults are the eight
    maps of Fig. 6 and 7 of the paper. Written: the maps (.npz) and a figure with the theoretical boundaries.

    Ctrl-C keeps what is finished; the same command again goes on from there. Exit code 1 means that some point
    contradicts its region; the points are listed.

    Args:
        mu (MU): Inertia m/(K T^2).
        tau_d (TAU_D): Loop delay in periods, one row of maps each. Repeatable. Default: 0 and 1.25.
        velocity (TICKS_PER_PERIOD): Initial velocity, from the spring's origin, one column of maps each. Repeatable.
            Default: 1, 5, 10, 50.
        periods (N): Horizon in sampling periods.
        beta_count (N): Points along beta = b/(K T).
        beta_max (BETA): Largest beta; the grid is even over (0, BETA]. Default: 1.5 + TAU_D, one unit past the
            boundary.
        sigma_count (N): Points along sigma = c/(K Delta).
        sigma_max (SIGMA): Largest sigma; even over (0, SIGMA].
        out (-o, --output FILE): The maps as .npz (added where FILE has no suffix); continued if it holds unfinished
            ones.
        figure (FILE): The figure: png, svg or pdf. Default: FILE of -o as .png.
        no_figure: Draw none.
        jobs (N): Threads. Default: one per usable core.
        dask (ADDRESS): Compute on the workers of this Dask cluster instead, e.g. tcp://host:8786 (needs the optional
            extra 'dask').
        force: Begin anew and replace FILE, whatever it holds, and the figure.
    """
    out, picture = _targets(out, figure, no_figure)
    if jobs is not None and dask is not None:
        raise UsageError("--jobs is for this machine; how many workers a Dask cluster has is the cluster's affair")
    from hapticd.stability import map_report, map_store
    from hapticd.stability.map_engines import ClusterError
    from hapticd.stability.maps import Study

    try:
        study = Study(
            mu=mu,
            delays=tuple(tau_d) if tau_d else Study.delays,
            velocities=tuple(velocity) if velocity else Study.velocities,
            beta_count=beta_count,
            beta_max=beta_max,
            sigma_count=sigma_count,
            sigma_max=sigma_max,
            periods=periods,
        )
        maps = map_store.begin(out, study, force=force)
    except ValueError as error:
        raise UsageError(str(error)) from None
    except map_store.MapFileError as error:
        raise UsageError(f"{error}: choose another -o, or replace it with --force") from None
    if picture is not None:  # by its default name it belongs to the maps, which go on
        refuse_existing(picture, force=force or (figure is None and out.exists()))
    interrupted = False
    if maps.done.any():
        output.note(f"{out} has {int(maps.done.sum())} of {study.size} points already")
    try:
        with output.progress_bar("mapping") as progress:
            map_store.fill(maps, _engine(jobs, dask), out, progress)
    except KeyboardInterrupt:
        interrupted = True
        output.note(f"{out} keeps {int(maps.done.sum())} of {study.size} points; the same command goes on from there")
    except ClusterError as error:
        raise UsageError(str(error)) from None
    found: dict[str, Any] = {**map_report.report(maps), "output": out}
    if picture is not None and not interrupted:
        from hapticd.stability.figures.map import draw

        save_figure(draw(maps), picture)
        found["figure"] = picture
    output.emit(found, describe(maps, found))
    if interrupted:
        return exits.INTERRUPTED
    return exits.DONE if found["holds"] else exits.NO


def _targets(out: Path, figure: Path | None, no_figure: bool) -> tuple[Path, Path | None]:
    """Where maps and figure go."""
    if figure is not None and no_figure:
        raise UsageError("--figure and --no-figure exclude each other")
    if not out.suffix and not out.is_dir():
        out = out.with_suffix(".npz")
    picture = None if no_figure else figure or out.with_suffix(".png")
    if picture is not None and picture.suffix.lstrip(".") not in _FIGURE_FORMATS:
        raise UsageError(f"{picture}: a figure is one of {', '.join(_FIGURE_FORMATS)}")
    if out.is_dir() or not out.parent.is_dir():
        raise UsageError(f"{out} cannot be written: it is a folder or its folder does not exist")
    return out, picture


def _engine(jobs: int | None, address: str | None) -> Callable[[list[Chunk]], Results]:
    from hapticd.stability import map_engines

    if address is None:
        return lambda chunks: map_engines.local(chunks, jobs)
    return lambda chunks: map_engines.dask(chunks, address)


def describe(maps: Maps, found: dict[str, Any]) -> str:
    """The report as text: one line a region, then what contradicts it."""
    head = "region  points  monotone  decaying  persistent  growing  agree"
    lines = [f"{found['done']} of {found['points']} points, mu = {number(maps.study.mu)}", head]
    for name, row in found["regions"].items():
        agree = "no claim" if row["agree"] is None else f"{100.0 * row['agree']:.4g} %"
        counts = (
            f"{row['points']:6}  {row['monotone']:8}  {row['decaying']:8}  {row['persistent']:10}  {row['growing']:7}"
        )
        lines.append(f"{name:6}  {counts}  {agree}")
    if amplitude := found["regions"].get("B", {}).get("amplitude"):
        if math.isfinite(amplitude["median"]):
            median, largest = number(amplitude["median"], 3), number(amplitude["max"], 3)
            rest = f" ({amplitude['unsettled']} points not settled yet)" if amplitude["unsettled"] else ""
            lines.append(f"B oscillates by {median} ticks in the median, {largest} at most{rest}")
    lines += _listed("at or above one tick in B", found["b_one_tick"])
    lines += _listed("against theory", found["exceptions"])
    lines.append(f"maps    {found['output']}")
    if figure := found.get("figure"):
        lines.append(f"figure  {figure}")
    return "\n".join(lines)


def _listed(title: str, rows: list[dict[str, Any]]) -> list[str]:
    lines = [f"{title}: {len(rows)}"] if rows else []
    for row in rows[:_LISTED]:
        place = f"beta {number(row['beta'])}, sigma {number(row['sigma'])}, tau_d {number(row['tau_d'])}"
        late = "" if row["settled"] or row["outcome"] == "growing" else ", still changing"
        start, end = number(row["xi_dot_0"]), number(row["amplitude_ticks"])
        lines.append(f"  {row['region']}: {place}, from {start} ticks/period: {row['outcome']}, {end} ticks{late}")
    if len(rows) > _LISTED:
        lines.append(f"  … {len(rows) - _LISTED} more with --json")
    return lines
