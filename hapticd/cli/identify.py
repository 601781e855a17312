"""``hapticd identify``: inertia, friction, bias, delay and sign of a rig from its recordings, into its config."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from hapticd.cli import exits, output
from hapticd.cli.command import command
from hapticd.cli.exits import UsageError
from hapticd.cli.inspecting import first_look
from hapticd.cli.options import (
    PositiveQuantity,
    RunsArgument,
    SettingsOption,
    SocketOption,
    connect,
    device_unit,
    model_of_daemon,
    model_of_run,
)

if TYPE_CHECKING:
    from hapticd.gap.recording import Recording
    from hapticd.gap.result import Estimate
    from hapticd.identify import Identified


@command(
    "hapticd identify --live -o rig.yaml",
    "hapticd identify chirp.arrow steps.arrow --model rig.yaml -o rig.yaml",
    "hapticd identify run.csv --model rig.yaml --known-inertia 6.5e-6 --json",
    codes=(exits.NO, exits.UNREACHABLE, exits.DEVICE, exits.FAULT, exits.INTERRUPTED),
)
def identify(
    runs: RunsArgument = None,
    model: str | None = None,
    out: Path | None = None,
    force: bool = False,
    live: bool = False,
    keep_spring: bool = False,
    known_inertia: PositiveQuantity | None = None,
    socket: SocketOption = None,
    assignments: SettingsOption = None,
) -> None:
    """Find inertia, friction, bias, delay and the encoder's sign of a device, with 95 % intervals, for its config.

    Takes one recording or several of the same device, or with --live plays the experiments itself: a chirp that grows until
    the shaft moves, then two chirps as strong and as slow as the limits admit, the rendered spring switched off. The
    config's plant may be wrong by orders of magnitude. The torque constant cannot be measured from counts and currents; it
    must be the data sheet's.

    With -o the plant section is written: values, a constant_bias and a transport_delay where there are any, encoder.invert
    where the sign is wrong, and plant.uncertainty, from which 'hapticd check' says how sure a spring's stability is.

    Args:
        model (CONFIG): Config with encoder, torque constant and limits; its plant is not used. Default: the config
            inside the first recording, or the daemon's.
        out (-o, --output CONFIG): Write the config with the plant that was found; comments stay. May be the file of
            --model.
        force: Replace another file that exists.
        live: Make the recordings now, with the running daemon; takes no RUN.
        keep_spring: With --live: leave the rendered spring on, for a device that would fall.
        known_inertia (KG_M2): The inertia, where you know it otherwise (kg m², or kg): says which torque constant it
            needs.
    """
    if live == bool(runs):
        raise UsageError("--live makes its own recordings" if live else "name at least one recording, or --live")
    if keep_spring and not live:
        raise UsageError("--keep-spring goes with --live")
    from hapticd.client import find_run
    from hapticd.identify.config_file import refuse_another, with_plant

    paths = [find_run(run) for run in runs or ()]
    if out is not None:
        refuse_another(out, model, paths, force=force)
    from hapticd.config.editing import text_of
    from hapticd.identify import identify as identify_device
    from hapticd.identify import load_any

    recordings: Sequence[Recording]
    if live:
        from hapticd.identify.live import record_live

        client = connect(socket)
        nominal = model_of_daemon(client, model, assignments)
        recordings = record_live(client, nominal, output.note, output.progress_bar, keep_spring=keep_spring)
    else:
        first_look(paths)
        nominal = model_of_run(paths[0], model, assignments)
        recordings = [load_any(path, nominal) for path in paths]
    inertia = device_unit(known_inertia, "kg m²", "kg", nominal.is_linear)
    with output.progress_bar("identify") as bar:
        found = identify_device(recordings, nominal, known_inertia=inertia, progress=bar)
    document = {**found.document, "config": out}
    if out is not None:
        from hapticd.figures.files import write_text

        # settings of the command line belong into the file too: the plant was found under them
        source = None if assignments or model is None else model
        write_text(out, with_plant(text_of(source, nominal), found))
    output.emit(document, describe(found, out))
    for warning in found.warnings:
        output.warn(f"warning: {warning}")


def describe(found: Identified, out: Path | None) -> str:
    """A few lines about what was found, and into which config it was written."""
    lines = [
        f"inertia           {_interval(found.inertia)}",
        f"viscous friction  {_interval(found.viscous)}",
        f"Coulomb friction  {_interval(found.coulomb)}",
        f"bias              {_interval(found.bias)}{'' if found.has_bias else ': none'}",
        f"delay             {_interval(found.delay, 1e6, 'µs')}, declared {1e6 * found.declared_delay_s:.4g} µs",
        f"encoder           {'counts with the torque' if found.sign > 0 else 'counts AGAINST the torque: invert it'}",
    ]
    if found.current_gain is not None:
        lines.append(f"current           measured over commanded {_interval(found.current_gain, 1.0, '')}")
    if found.torque_constant_implied is not None:
        implied = _interval(found.torque_constant_implied)
        lines.append(f"torque constant   {implied}, if the known inertia is right; taken {found.torque_constant:g}")
    lines += [f"assumed: {text}" for text in found.assumed]
    if out is not None:
        lines.append(f"written: {out}; hapticd check {out} says what it means")
    return "\n".join(lines)


def _interval(estimate: Estimate, factor: float = 1.0, unit: str | None = None) -> str:
    from hapticd.identify.result import interval_digits

    low, value, high = (factor * number for number in (estimate.ci95[0], estimate.value, estimate.ci95[1]))
    digits = interval_digits(estimate)
    return (
        f"{value:.{digits}g} ({low:.{digits}g} … {high:.{digits}g}) {estimate.unit if unit is None else unit}".rstrip()
    )
