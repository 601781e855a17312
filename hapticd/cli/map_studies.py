"""The further studies of ``hapticd map``: the Z-width of a device, and what the passivity controller changes in the maps."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from hapticd.cli import exits, output
from hapticd.cli.options import resolve_config
from hapticd.cli.output import number
from hapticd.figures.files import save_figure

if TYPE_CHECKING:
    from hapticd.stability.maps import Study


def zwidth(
    source: str,
    assignments: list[str] | None,
    velocity: float,
    picture: Path | None,
    jobs: int | None,
) -> int:
    """Work out and draw the Z-width of a device."""
    from drivers import declared_latency
    from hapticd.stability.zwidth import zwidth as work_out

    config = resolve_config(source, assignments)
    latency, doubt = declared_latency(config)
    if doubt:
        output.warn(doubt)
    found = work_out(config, latency, velocity=velocity, jobs=jobs)
    report: dict[str, Any] = {"zwidth": source, **found.report}
    if picture is not None:
        from hapticd.stability import zwidth_figure

        save_figure(zwidth_figure.draw(found, source), picture)
        report["figure"] = picture
    output.emit(report, _describe_zwidth(report, config.is_linear))
    return exits.DONE


def _describe_zwidth(report: dict[str, Any], linear: bool) -> str:
    K, B = ("N/m", "N s/m") if linear else ("N m/rad", "N m s/rad")
    lines = [
        f"Z-width of {report['zwidth']}: {report['points']} points of (B, K), motions that pass the origin at "
        f"{number(report['velocity_ticks_per_period'])} ticks per period",
        "largest calm K       without damping          with        at B              of the plane",
    ]
    for variant, row in report["largest_calm"].items():
        lines.append(
            f"{variant:20} {number(row['without_damping']):>8} {K:8}  {number(row['stiffness']):>8} {K:8}  "
            f"{number(row['damping']):>9} {B:10}  {100.0 * row['calm']:.3g} %"
        )
    lines.append(
        f"passive              {number(report['passive_stiffness']):>8} {K:8}  (Colgate and Schenkel, without damping)"
    )
    if figure := report.get("figure"):
        lines.append(f"figure  {figure}")
    return "\n".join(lines)


def passivity(study: Study, picture: Path | None, jobs: int | None) -> int:
    """Run the maps with and without the passivity controller, and draw what it changes."""
    from hapticd.stability.passivity_map import passivity_map

    found = passivity_map(study, jobs=jobs)
    report = found.report
    if picture is not None:
        from hapticd.stability import passivity_figure

        save_figure(passivity_figure.draw(found), picture, dpi=120)
        report["figure"] = picture
    output.emit(report, _describe_passivity(report))
    return exits.DONE


def _percent(fraction: float | None) -> str:
    return "-" if fraction is None else f"{100.0 * fraction:.3g} %"


def _describe_passivity(report: dict[str, Any]) -> str:
    lines = [f"Passivity controller on the maps of Fig. 6 and 7, mu = {number(report['mu'])}"]
    for row in report["maps"]:
        force, share, left = row["added_force_ticks"], row["added_force_share"], row["left_amplitude_ticks"]
        lines += [
            f"tau_D {number(row['tau_d'])}, {row['counts_per_tick']} counts a tick: of {row['points']} points "
            f"{row['unstable']} do not come to rest, {row['growing']} of them grow",
            f"  made stable  {row['made_stable']}: {_percent(row['share_made_stable'])} of them, "
            f"{_percent(row['share_made_stable_where_friction_holds_a_tick'])} of those with sigma >= 1/2",
            f"  still going  {row['bounded']} bounded (median {number(left['median'])} ticks), {row['still_grows']} grow; "
            f"spoilt {row['spoilt']}",
            f"  added force  median {number(force['median'])}, at most {number(force['max'])} ticks; "
            f"{_percent(share['median'])} of the largest force, at most {_percent(share['max'])}",
        ]
    if figure := report.get("figure"):
        lines.append(f"figure  {figure}")
    return "\n".join(lines)
