"""A device whose plant file holds a secret, a daemon that believes the nominal model, and what `gap` makes of it.

The device runs in a process of its own, so that nothing of its plant can reach the daemon or the workflow but through the
wire. First it is released as the nominal model is; then the workflow closes its circle on it; at the end the improved model
is released in simulation, from where the device really was.
"""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drivers import declared_latency
from hapticd.client import Client
from hapticd.config import Config, load_config
from hapticd.gap import GapResult, find_gap
from hapticd.gap.live import find_gap_live
from hapticd.gap.outputs import MODEL, document_of, write_outputs
from hapticd.hil.compare import Comparison, compare, measured_trace, simulated_trace
from hapticd.hil.daemon import DaemonProcess
from hapticd.hil.device import Device
from hapticd.stability.assessment import assess

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from hapticd.gap.recording import Recording
    from hapticd.servo.experiment import Experiment


@dataclass(frozen=True)
class Claim:
    """What a model says of the release, beside what the device did."""

    region: str
    meaning: str
    """Of the region, in words, as `check` says it."""
    outcome: str
    """Of `simulate`."""
    comparison: Comparison


@dataclass(frozen=True)
class Story:
    """What happened."""

    outcome: str
    """Of the release on the device, from its recording."""
    fault: str | None
    """How the daemon caught it, if it had to."""
    nominal: Claim
    improved: Claim
    result: GapResult
    model: Config
    """The improved model, read from the file that the workflow wrote."""


def find_hidden_effect(
    model: Config,
    secret: Config,
    first: Experiment,
    deflection: float,
    folder: Path,
    *,
    duration_s: float = 2.0,
    say: Callable[[str], None] = lambda text: None,
    bar: Callable[[str], AbstractContextManager[Callable[[float], None]]] | None = None,
) -> Story:
    """Release, find what the model lacks, and release the improved model in simulation.

    Args:
        model: the nominal model, with a driver that has a simulated device.
        secret: the device's own plant.
        first: the experiment that the workflow begins with.
        deflection: of the release, coarse ticks. duration_s: of the release.
        folder: for everything that is written; short enough for a Unix socket's name.
        say: called with every step. bar: progress bar with a label.

    Raises:
        HilError: a process did not come up.
        LiveError: an experiment ended early.
        RequestRefused: the daemon refuses an experiment.
    """

    def analyse(recordings: Sequence[Recording]) -> GapResult:
        found = find_gap(recordings, model)
        write_outputs(document_of(found, model), found, recordings, model, folder / "gap")
        return found

    device = Device(model, folder, plant=secret)
    with device:
        device.wait_ready()
        with DaemonProcess(model, folder, device.options) as daemon:
            daemon.wait_ready()
            say(f"releasing the device at {deflection:g} ticks")
            released = _release(daemon.client, deflection, duration_s)
            say(f"the device: {released['outcome']}")
            bars = bar or (lambda label: nullcontext(lambda fraction: None))
            result, _ = find_gap_live(daemon.client, model, first, analyse, say, bars)
    improved = load_config(folder / "gap" / MODEL)
    return Story(
        str(released["outcome"]),
        released.get("fault"),
        _claim(model, released, duration_s),
        _claim(improved, released, duration_s),
        result,
        improved,
    )


def _release(client: Client, deflection: float, duration_s: float) -> dict[str, Any]:
    job = client.release(deflection, duration_s)
    result = client.wait(job["experiment"])["result"]
    if client.status()["state"] == "fault":
        client.clear()
    return {**job, **result}


def _claim(model: Config, released: dict[str, Any], duration_s: float) -> Claim:
    deflection = float(released["achieved_deflection"])
    said = assess(model, deflection=deflection, latency_s=declared_latency(model)[0]).document
    measured = measured_trace(Path(released["run"]), model)
    simulated, report = simulated_trace(model, duration_s, deflection)
    return Claim(said["region"], said["meaning"], report["outcome"], compare(measured, simulated))
