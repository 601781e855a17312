"""The gap workflow on a running daemon: excite, record, compare; if laws are tied, also run the designed experiment."""

from __future__ import annotations

from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING

from hapticd.client import settings_for_a_while, stop_on_interrupt
from hapticd.gap.data import load_recording
from hapticd.gap.recording import Recording
from hapticd.servo.experiment import Experiment, experiment_of

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from hapticd.client import Client
    from hapticd.config import Config
    from hapticd.gap.result import GapResult

    Bar = Callable[[str], AbstractContextManager[Callable[[float], None]]]
    Analyse = Callable[[Sequence[Recording]], GapResult]


class LiveError(Exception):
    """An experiment ended early, so there is nothing to compare; the text says why."""


def find_gap_live(
    client: Client, model: Config, experiment: Experiment, analyse: Analyse, say: Callable[[str], None], bar: Bar
) -> tuple[GapResult, list[Recording]]:
    """Excite, record, compare; if the verdict is ambiguous, run the designed experiment and compare both recordings.

    Args:
        client: of the daemon. On an interrupt while the shaft moves, it sends a stop.
        model: the nominal model.
        experiment: the first one.
        analyse: from recordings to a result; it also writes the outputs, so that a failed second experiment loses nothing.
        say: called with a text for each step.
        bar: progress bar with a label.

    Raises:
        LiveError: an experiment ended on a fault, or another client stopped it.
        RequestRefused: the daemon refuses an experiment.
        RecordingError: a recording is unusable.
    """
    recordings = [_record(client, model, experiment, say, bar)]
    say("searching for what the model lacks")
    result = analyse(recordings)
    say(result.statement)
    designed = (result.next_experiment or {}).get("experiment")
    if result.verdict == "ambiguous" and designed:
        recordings.append(_record(client, model, experiment_of(designed, "the designed experiment"), say, bar))
        say("searching again, in both recordings")
        result = analyse(recordings)
        say(result.statement)
    return result, recordings


def _record(client: Client, model: Config, experiment: Experiment, say: Callable[[str], None], bar: Bar) -> Recording:
    path = play(client, model, experiment, say, bar)
    say(f"recorded {path}")
    return load_recording(path, model)


def play(client: Client, model: Config, experiment: Experiment, say: Callable[[str], None], bar: Bar) -> Path:
    """Run an experiment on the daemon with the experiment's settings, wait for its end, and return the recording.

    Raises:
        LiveError: it ended on a fault, or another client stopped it.
    """
    say(f"playing {experiment.describe(model.is_linear)}")
    with settings_for_a_while(client, experiment.settings), stop_on_interrupt(client, say):
        job = client.excite(experiment.excitation, **experiment.plan())
        with bar(experiment.excitation) as progress:
            report = client.wait(job["experiment"], progress)
    found = report["result"] or {}
    if report["state"] != "done" or found.get("fault"):
        why = f"the fault {found['fault']}" if found.get("fault") else "being stopped"
        raise LiveError(f"{experiment.excitation} ended early on {why}; its recording is {found.get('run')}")
    return Path(found["run"])
