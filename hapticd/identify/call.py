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
        runs: one or several recordings of one device: a file, ``"@last"``, a `hapticd.Run`.
        model: encoder and torque constant of the device, as for `hapticd.check`; its plant is not used. By default the
            config in the first recording.
        settings: dotted key to value, applied to the model.
        known_inertia: inertia from another source, kg m² or kg; from it the torque constant is computed.
        out: config to write, with the identified plant and its uncertainty. If the model is a file, its comments are kept.
            It may be the model's file.
        force: replace another existing file.
        progress: called with the fraction done.

    Returns:
        ``inertia``, ``viscous``, ``coulomb``, ``bias`` and ``delay``, each with ``value``, ``ci95`` and ``unit``; ``sign``;
        ``assumed`` values; ``warnings``.

    Raises:
        RunFileError: a recording cannot be read.
        RecordingError: a recording is unusable.
        ConfigError: there is no model, or it is invalid.
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
        # The file also gets the settings: the plant was identified with them.
        write_text(Path(out), with_plant(text_of(None if settings else source, nominal), found))
    return found
