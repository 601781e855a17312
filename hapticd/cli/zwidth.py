"""``hapticd zwidth``: which stiffness and damping a device renders, whoever holds it and however fast."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from hapticd.cli import exits, output
from hapticd.cli.command import command
from hapticd.cli.options import (
    ConfigArgument,
    Count,
    Length,
    PositiveQuantity,
    Quantity,
    SettingsOption,
    check_figure_name,
    device_unit,
    resolve_config,
)
from hapticd.cli.output import number

if TYPE_CHECKING:
    from hapticd.config import Config

_NAMES = {
    "linear": "linear loop (Hulin)",
    "exact": "exact, calm",
    "proven": "proven",
    "passive": "passive, no hand",
}


@command(
    "hapticd zwidth rig.yaml -o zwidth.png",
    "hapticd zwidth omega --set spring.velocity_periods=4 --velocity 0.5m/s",
    "hapticd zwidth re35 --radius 0.05 --json",
    codes=(exits.INTERRUPTED,),
)
def zwidth(
    source: ConfigArgument = None,
    out: Path | None = None,
    force: bool = False,
    velocity: Quantity | None = None,
    radius: Length = 0.02,
    damping_max: PositiveQuantity | None = None,
    stiffness_max: PositiveQuantity | None = None,
    points: Annotated[int, typer.Option(min=2, max=1000)] = 48,
    jobs: Count | None = None,
    assignments: SettingsOption = None,
) -> None:
    """Say which stiffness K and virtual damping B a device can render: its Z-width, and the boundaries that theory draws.

    Every point of the (B, K) plane is run exactly, with ticks, friction, delay and the config's velocity estimate: in no
    hand, in three that grip it lightly to firmly (the human operator of the paper's Table II, whole and in parts) and in
    the config's own, and at speeds up to what safety.max_velocity, safety.max_excursion and amplifier.peak_current admit.
    It is as good as the worst of them: stable (all come to rest), buzzes (below one tick), oscillates (one tick and more)
    or unstable (grows). Beside it: the boundary of the linear loop with delay and arm (Hulin), what a theorem proves, and
    what is passive (Colgate and Schenkel).

    spring.stiffness and spring.damping do not matter, but for the point of this config in the figure. Some seconds.

    Args:
        out (-o, --figure FIG): Draw the plane into this file (.png, .svg or .pdf).
        force: Replace FIG if it exists.
        velocity (SPEED): No motion faster than this at the spring's origin, in coarse ticks per servo period; or with a
            unit: 2rad/s, 100rpm, 0.5m/s. Default: what the limits admit.
        radius (M): Radius of the handle of a rotary device, in m: the hands are known in N and m.
        damping_max (B): Largest B of the plane, in N m s/rad or N s/m. Default: a little beyond the linear boundary.
        stiffness_max (K): Largest K of the plane, in N m/rad or N/m. Default: likewise.
        points (N): Points along each axis.
        jobs (N): Threads. Default: one per usable core.
    """
    check_figure_name(out, force=force)
    config = resolve_config(source, assignments)
    from drivers import declared_latency
    from hapticd.config.assumed import assumed_text
    from hapticd.config.units import velocity_ticks
    from hapticd.stability.zwidth import zwidth as work_out

    latency, doubt = declared_latency(config)
    for said in (doubt, assumed_text(config)):
        if said:
            output.warn(said)
    more: dict[str, Any] = {}
    if velocity is not None:
        more["velocity"] = velocity_ticks(velocity, config) * config.resolution / config.period
        if not more["velocity"] > 0.0:
            raise exits.UsageError(f"--velocity must be above 0, got {velocity}")
    with output.progress_bar("Z-width") as progress:
        found = work_out(
            config,
            latency,
            radius=radius,
            damping_max=device_unit(damping_max, "N m s/rad", "N s/m", config.is_linear),
            stiffness_max=device_unit(stiffness_max, "N m/rad", "N/m", config.is_linear),
            count=points,
            jobs=jobs,
            progress=progress,
            **more,
        )
    name = source or "re35"
    report: dict[str, Any] = {"zwidth": name, **found.report}
    if out is not None:
        from hapticd.figures.files import save_figure
        from hapticd.stability.figures.zwidth import draw

        save_figure(draw(found, Path(name).name), out)
        report["figure"] = out
    output.emit(report, describe(report, config))


def describe(report: dict[str, Any], config: Config) -> str:
    """The report as text: the largest stiffness by every measure, then the hands."""
    K, B, speed = ("N/m", "N s/m", "m/s") if config.is_linear else ("N m/rad", "N m s/rad", "rad/s")
    hands = report["hands"]
    lines = [
        f"Z-width of {report['zwidth']}: {len(report['rows'])} points of (B, K), each in {len(hands)} hands at "
        f"{report['speeds']} speeds up to {number(report['fastest'], 3)} {speed}",
        f"{'largest K':26}  {'without damping':>18}  {'with damping':>18}  at B",
    ]

    def row(name: str, limit: dict[str, float]) -> str:
        bare, best = (f"{number(limit[key], 3)} {K}" for key in ("without_damping", "stiffness"))
        return f"{name:26}  {bare:>18}  {best:>18}  {number(limit['damping'], 3)} {B}"

    lines += [row(name, report["largest"][key]) for key, name in _NAMES.items()]
    lines.append("the linear loop in")
    lines += [row(f"  {hand['name']}", hand["linear"]) for hand in hands]
    if figure := report.get("figure"):
        lines.append(f"figure  {figure}")
    return "\n".join(lines)
