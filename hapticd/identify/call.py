"""An identification as one call: ``hapticd.identify_plant``."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hapticd.config.editing import text_of
from hapticd.config.loading import ConfigSource, config_of
from hapticd.figures.files import write_text
from hapticd.gap.call import own_model, runs_of
from hapticd.identify import workflow
from hapticd.identify.config_file import refuse_another, with_plant

if TYPE_CHECKING:
    from hapticd.gap.call import Recorded
    from hapticd.identify.result import Identified


def identify_plant(
    runs: Recorded | Sequence[Recorded],
    model: ConfigSource = None,
    *,
    settings: Mapping[str, Any] | None = None,
    known_inertia: float | None = None,
    out: str | PathLike[str] | None = None,
    force: bool = False,
    progress: Callable[[float], None] = lambda fraction: None,
) -> Identified:
    """Find inertia, friction, bias, delay and the encoder's sign of a device, with 95 % intervals.

    Args:
        runs: one recording or several of one device: a file, ``"@last"``, a `hapticd.Run`.
        model: encoder and torque constant of the device, as for `hapticd.check`; its plant is not used. By default the
            config that the first recording carries.
        settings: dotted key to value, applied to the model.
        known_inertia: kg m² or kg, where it is known otherwise: tells what the torque constant must be.
        out: config to write, with the plant that was found and its uncertainty; the comments of a model that is a file stay.
            It may be the model's file.
        force: replace another file that exists.
        progress: called with the fraction done.

    Returns:
        ``inertia``, ``viscous``, ``coulomb``, ``bias`` and ``delay``, each with ``value``, ``ci95`` and ``unit``; ``sign``;
        what was ``assumed``; ``warnings``.

    Raises:
        RunFileError: a recording cannot be read.
        RecordingError: nothing can be concluded from one.
        ConfigError: no model, or anything wrong in it.
        ValueError: no recording.
        FileExistsError: ``out`` exists, and is not the model, without ``force``.
    """
    source = str(model) if isinstance(model, str | PathLike) else None
    recorded = runs_of(runs)
    if out is not None:
        refuse_another(Path(out), source, [run.path for run in recorded], force=force)
    nominal = config_of(model if model is not None else own_model(recorded[0]), settings)
    found = workflow.identify(
        [workflow.readable(run, nominal) for run in recorded], nominal, known_inertia=known_inertia, progress=progress
    )
    if out is not None:
        # Settings belong into the file too: the plant was found under them.
        write_text(Path(out), with_plant(text_of(None if settings else source, nominal), found))
    return found
