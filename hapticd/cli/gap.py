"""``hapticd gap``: find where simulation and measured data disagree, name what is missing, add it, show the gap shrink."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hapticd.cli import exits, output
from hapticd.cli.command import command
from hapticd.cli.exits import UsageError
from hapticd.cli.experiments import experiment_named
from hapticd.cli.inspecting import first_look
from hapticd.cli.options import (
    RunsArgument,
    SettingsOption,
    SocketOption,
    check_folder,
    connect,
    model_of_daemon,
    model_of_run,
)

if TYPE_CHECKING:
    from hapticd.config import Config
    from hapticd.gap.recording import Recording
    from hapticd.gap.result import GapResult


@command(
    "hapticd gap run.arrow --model rig.yaml -o gap",
    "hapticd gap ramp.arrow steps.csv --model re35 --refit-base -o gap --json",
    "hapticd gap ramp.arrow steps.csv --validate chirp.arrow -o gap",
    "hapticd gap run.arrow --model rig.yaml --nominal my_simulator.py:torque -o gap",
    "hapticd gap --live --excite steps -o gap",
    codes=(exits.NO, exits.UNREACHABLE, exits.DEVICE, exits.FAULT, exits.INTERRUPTED),
)
def gap(
    out: Path,
    runs: RunsArgument = None,
    model: str | None = None,
    refit_base: bool = False,
    effect: list[str] | None = None,
    nominal: str | None = None,
    validate: Path | None = None,
    live: bool = False,
    excite: str | None = None,
    force: bool = False,
    socket: SocketOption = None,
    assignments: SettingsOption = None,
) -> int:
    """Find where model and measurement disagree, name what is missing, add it, and show the gap shrink.

    Computes how probable every encoder count is, given those before it, the recorded current and the model; what the model
    lacks shows as a disturbance torque. Every effect of the catalogue (docs/effects) is judged on held-out data, and added
    to the model where it has evidence, until none has. The answer is one of: effect_found;
    partly_explained, named, and something is left; no_missing_effect; ambiguous, with an experiment to distinguish
    them; unexplained, something is missing that no effect explains.

    Written into DIR: report.html, for people; model.yaml, the improved model, which simulate, check and the simulated
    hardware take; gap.json; and next_experiment.yaml, which 'hapticd excite' runs, where the answer is open. Files appear
    when all are finished. Ctrl-C ends the search, and what has been named until then is written; before that DIR stays as it
    was.

    With --live the daemon excites the device and records; where the answer is open, the designed experiment follows, and
    the answer is sought in both recordings. Ctrl-C stops the daemon. Default model: the daemon's config.

    Args:
        out (-o, --output DIR): Folder for report.html, model.yaml and gap.json; made if missing.
        model (MODEL.yaml): The nominal model: a config or a preset. Default: the config inside the first recording.
        refit_base: No longer needed: inertia and friction are always fitted. With --effect: them as well.
        effect (SLUG): Consider only this effect of the catalogue. Repeatable; a warning names what cannot be.
        nominal (MODULE:FUNCTION|FILE.fmu): Your own simulator as the nominal model: a Python function torque(x, v, i, t), in
            a module or as FILE.py:FUNCTION, or an FMU with these names (else FILE.fmu:x=NAME,v=NAME,i=NAME,torque=NAME); it
            is run. From position, velocity, motor current in A and time it gives the torque of all there is, the motor's
            among it; what is found is added to it. Inertia, amplifier and encoder are MODEL's.
        validate (RUN): Another recording of the device, which is not fitted: how the model as given and the improved one
            predict it, 50 ms ahead and in a free run, is said and drawn.
        live: Make the recordings now, with the running daemon; takes no RUN.
        excite (NAME|FILE): With --live: the first experiment, as in 'hapticd excite'. Default: all.
        force: Replace an earlier answer in DIR.
    """
    check_folder(out)
    _check_choices(runs, effect, live, excite)
    from hapticd.client import find_run
    from hapticd.gap import find_gap
    from hapticd.gap.data import load_recording
    from hapticd.gap.outputs import document_of, keep, write_outputs
    from hapticd.gap.own_simulator import find_torque, with_simulator
    from hapticd.gap.workflow import considered

    with _refusing("--nominal"):
        torque = find_torque(nominal) if nominal else None
    keep(out, [Path(read) for read in (model, excite, validate, *(runs or ())) if read], force=force)
    document: dict[str, Any] = {}
    said: list[str] = []
    test = find_run(validate) if validate else None

    def loaded(path: Path, config: Config) -> Recording:
        recording = load_recording(path, config)
        for warning in recording.warnings:
            output.warn(f"warning: {warning}")
        said.extend(recording.warnings)
        return recording

    def check(config: Config) -> Config:
        with _refusing("--effect"):
            considered(config, effect)
        return config

    def analyse(config: Config, validation: Recording | None, recordings: Sequence[Recording]) -> GapResult:
        if torque:
            with _refusing(f"--nominal {nominal}"):
                recordings = [with_simulator(recording, config, torque) for recording in recordings]
                validation = with_simulator(validation, config, torque) if validation else None
            document["nominal"] = nominal
        with output.progress_bar("gap") as bar:
            result = find_gap(
                recordings,
                config,
                refit_base=refit_base,
                candidates=effect,
                progress=lambda fraction, what: bar(fraction),
                validation=validation,
            )
        document.update(document_of(result, config))
        try:
            write_outputs(document, result, recordings, config, out, model)
        except OSError:  # a full disk: the answer is not lost with it
            output.emit(document, describe(document, None))
            raise
        return result

    if live:
        from hapticd.gap.live import find_gap_live

        experiment = experiment_named(excite or "all")
        client = connect(socket)
        config = check(model_of_daemon(client, model, assignments))
        of_daemon = partial(analyse, config, loaded(test, config) if test else None)
        result = find_gap_live(client, config, experiment, of_daemon, output.note, output.progress_bar)[0]
    else:
        paths = [find_run(run) for run in runs or ()]
        first_look(paths)
        config = check(model_of_run(paths[0], model, assignments))
        recordings = [loaded(path, config) for path in paths]
        result = analyse(config, loaded(test, config) if test else None, recordings)
    return _tell(document, result, out, said)


def _tell(document: dict[str, Any], result: GapResult, out: Path, said: Sequence[str]) -> int:
    """Print the answer, and what has not yet been warned of; the exit code."""
    output.emit(document, describe(document, out))
    for warning in document["warnings"]:
        if warning not in said:
            output.warn(f"warning: {warning}")
    if result.interrupted:
        return exits.INTERRUPTED
    return exits.NO if result.verdict == "unexplained" else exits.DONE


def _check_choices(runs: Sequence[Path] | None, effects: Sequence[str] | None, live: bool, excite: str | None) -> None:
    """Refuse options that do not go together, and effects that there are none of."""
    if live == bool(runs):
        raise UsageError("--live makes its own recordings" if live else "name at least one recording, or --live")
    if excite and not live:
        raise UsageError("--excite goes with --live")
    from hapticd.gap.workflow import why_unknown

    for slug in effects or ():
        if reason := why_unknown(slug):
            raise UsageError(f"--effect {slug}: {reason}")


@contextmanager
def _refusing(option: str) -> Iterator[None]:
    """What an option's value is wrong in is a wrong command line."""
    try:
        yield
    except ValueError as error:
        raise UsageError(f"{option}: {error}") from error


def describe(document: dict[str, Any], out: Path | None) -> str:
    """A few lines about what was found, from the content of gap.json, and about what was written, if it was."""
    from hapticd.gap import text

    gap = document["gap"]
    held_out, unit = gap["held_out"], gap["unit"]
    lines = [f"timing of the data: {text.timing(document)}"]
    lines.append(f"{document['verdict']}: {document['statement']}")
    if simulator := document.get("nominal"):
        lines.append(f"  added to the torque of {simulator}, which is taken as known; model.yaml has no part of it")
    for step in document["steps"]:
        values = [*text.chosen(step), *(f"{name} = {_estimate(value)}" for name, value in step["parameters"].items())]
        lines.append(f"  {step['effect']}: {', '.join(values)}")
        lines.append(f"    {step['evidence']:.1f} standard errors; {text.behind(step)}")
    lines += [f"  {name} is {_estimate(value)}" for name, value in document["base"].items()]
    lines += [f"where: {place}" for place in text.places(document["where"], unit)]
    lines.append(
        f"missing force, RMS on held-out data: {held_out['before']:.3g} {unit} before, "
        f"{held_out['after']:.3g} {unit} after; noise floor {gap['noise_floor']:.2g} {unit}"
    )
    lines += [f"predicted {sentence}" for sentence in text.predictions(document)]
    lines += text.validated(document)
    left = document["remainder"]["words"]
    is_news = document["verdict"] != "no_missing_effect" or document["remainder"]["fingerprint"]
    if is_news and left not in document["statement"]:
        lines.append(f"left: {left}")
    lines += [f"consequence: {sentence}" for sentence in document["consequences"]["words"]]
    lines.append(f"next: {document['next']}")
    planned = document["next_experiment"]
    if out and planned and planned["file"]:
        lines.append(f"next: hapticd excite {out / planned['file']}")
    return "\n".join([*lines, f"{out / 'report.html'}, {out / 'model.yaml'}"] if out else lines)


def _estimate(estimate: dict[str, Any]) -> str:
    low, high = estimate["ci95"]
    text = f"{estimate['value']:.4g} ({low:.4g} … {high:.4g})"
    return f"{text} {estimate['unit']}" if estimate["unit"] else text
