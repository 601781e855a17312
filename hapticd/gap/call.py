"""The gap workflow as one call: ``hapticd.gap``."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hapticd.client import find_run
from hapticd.config import ConfigError, Problem, parse_config
from hapticd.config.loading import ConfigSource, config_of
from hapticd.gap import workflow
from hapticd.gap.data import recording_of
from hapticd.gap.own_simulator import Torque, find_torque, with_simulator
from hapticd.record import Run, read_run

if TYPE_CHECKING:
    from hapticd.gap.result import GapResult

    Recorded = str | PathLike[str] | Run


def find_gap(
    runs: Recorded | Sequence[Recorded],
    model: ConfigSource = None,
    *,
    settings: Mapping[str, Any] | None = None,
    refit_base: bool = False,
    effects: Sequence[str] | None = None,
    nominal: str | Torque | None = None,
    validate: Recorded | None = None,
    out: str | PathLike[str] | None = None,
    force: bool = False,
    progress: Callable[[float, str], None] | None = None,
) -> GapResult:
    """Find where model and measurement disagree, name the missing effects, and measure the gap with them.

    Args:
        runs: one or several recordings of one device: a file, ``"@last"``, a `hapticd.Run`.
        model: the nominal model, as for `hapticd.check`; by default the config in the first recording.
        settings: dotted key to value, applied to the model.
        refit_base: fit inertia and friction of the model as well.
        effects: consider only these effects of the catalogue.
        nominal: your own simulator as a function ``torque(x, v, i, t)``, or its name as ``module:function``. It returns the
            total torque, the motor's included, for a position, velocity, motor current and time. Effects are added to it;
            inertia, amplifier and encoder are the model's.
        validate: another recording of the device, which is not fitted: ``validation`` of the result has the errors
            of the given and the improved model's predictions of it.
        out: folder for report.html, model.yaml and gap.json, created if missing.
        force: replace an earlier result in it.
        progress: called with the fraction done and the present step.

    Returns:
        ``verdict``, ``statement``, ``steps`` (the named effects, in order, with intervals), and the gap in numbers.

    Raises:
        RunFileError: a recording cannot be read.
        RecordingError: a recording is unusable, or given twice.
        ConfigError: there is no model, or it is invalid.
        ValueError: no recording, a simulator that fails, an unknown effect, or no effect to consider.
        FileExistsError: ``out`` has a result and ``force`` is not given, or an output file would overwrite an input file.
    """
    recorded = runs_of(runs)
    config = config_of(model if model is not None else own_model(recorded[0]), settings)
    torque = find_torque(nominal) if isinstance(nominal, str) else nominal
    tests = runs_of([validate]) if validate is not None else []
    taken = [recording_of(run, config) for run in [*recorded, *tests]]
    taken = [with_simulator(one, config, torque) for one in taken] if torque else taken
    recordings, validation = taken[: len(recorded)], taken[-1] if tests else None
    if out is not None:
        from hapticd.gap.outputs import keep

        keep(
            Path(out),
            [run.path for run in [*recorded, *tests]]
            + [Path(name) for name in [model] if isinstance(name, str | PathLike)],
            force=force,
        )
    result = workflow.find_gap(
        recordings, config, refit_base=refit_base, candidates=effects, progress=progress, validation=validation
    )
    if out is not None:
        from hapticd.gap.outputs import document_of, write_outputs

        source = str(model) if isinstance(model, str | PathLike) else None
        write_outputs(document_of(result, config), result, recordings, config, Path(out), source)
    return result


def runs_of(runs: Recorded | Sequence[Recorded]) -> list[Run]:
    """One recording or several, read.

    Raises:
        RunFileError: one cannot be read.
        ValueError: there is none.
    """
    several = [runs] if isinstance(runs, str | PathLike | Run) else list(runs)
    if not several:
        raise ValueError("no recording: give at least one run")
    return [run if isinstance(run, Run) else read_run(find_run(run)) for run in several]


def own_model(run: Run) -> ConfigSource:
    """The config in a recording.

    Raises:
        ConfigError: it has none.
    """
    stored = run.metadata.get("config")
    if not stored:
        raise ConfigError([Problem(str(run.path), "", None, "carries no config; give the nominal model")])
    return parse_config(stored, f"config of {run.path.name}")
