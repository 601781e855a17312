"""The suite: device up, daemon up, Fig. 8 and an excitation, everything compared with `simulate`, the delay measured."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from drivers import declared_latency
from hapticd.client import RequestRefused
from hapticd.config import Config, apply_settings, unit_of
from hapticd.config.text import significant
from hapticd.hil.cases import (
    EXCITATION,
    EXCITATION_S,
    EXCITATION_SPAN_S,
    FIG_8,
    FIRMWARE_RATE_HZ,
    Case,
    slower_case,
    slower_rig,
)
from hapticd.hil.compare import (
    GROWTH,
    LOG2_DRAWS,
    Comparison,
    compare,
    measured_trace,
    possible,
    recorded_times,
    rest_torque,
    simulated_trace,
)
from hapticd.hil.daemon import DaemonProcess
from hapticd.hil.device import Device
from hapticd.record import FLAG_MISSED_EXCHANGE, read_run
from hapticd.record.schema import FLAG_MISSED_PERIOD, FLAG_RUNNING
from hapticd.service.jobs import shown_outcome
from hapticd.servo import excitation

ATTEMPTS: Final = 4
"""A run that met what the simulation cannot replay is another experiment, and is repeated."""
PATIENCE_S: Final = 0.02
"""On a machine shared with other work the kernel may keep the bytes of a pseudo-terminal for some scheduler ticks of 4 ms.
The default of two tolerated exchanges in a row would end most runs there; how many there were is in the report."""
CURRENT_TOLERANCE: Final = 0.10
"""Largest RMS difference of the current over the first swing, of its RMS."""
_FEWEST: Final = 4
"""Periods of which an outcome can be told."""
MOST_LOG2_DRAWS: Final = 8
"""Binary logarithm of the number of simulations where none of `2**LOG2_DRAWS` is like the release."""
REST_TOLERANCE: Final = 0.10
"""By how much more than twice the friction the motor's torques at rest may differ, of that."""


@dataclass(frozen=True)
class CaseResult:
    """One experiment on the device beside its simulation."""

    name: str
    what: str
    comparison: Comparison
    report: dict[str, Any]
    problems: tuple[str, ...]


@dataclass(frozen=True)
class Released:
    """A release as it was done.

    Attributes:
        config: of the case. result: what the daemon says of it.
        tries: ``attempts`` and the last one's ``disturbances``: ticks that a simulation cannot replay.
    """

    case: Case
    config: Config
    result: dict[str, Any]
    tries: dict[str, int]


@dataclass(frozen=True)
class SuiteResult:
    """Everything the suite found."""

    driver: str
    cases: tuple[CaseResult, ...]
    latency_s: np.ndarray[Any, np.dtype[np.float64]]
    declared_s: float
    timing: dict[str, Any]
    warnings: tuple[str, ...]

    @property
    def agrees(self) -> bool:
        """Whether every experiment came out as simulated."""
        return not any(case.problems for case in self.cases)


def run_suite(
    config: Config,
    *,
    plant: Config | None = None,
    cases: Sequence[Case] = FIG_8,
    with_excitation: bool = True,
    board: str | None = None,
    keep: Path | None = None,
    progress: Callable[[float], None] = lambda fraction: None,
) -> SuiteResult:
    """Run the suite against simulated hardware.

    Args:
        config: the daemon's; its driver names the device.
        plant: the device's own plant; None: the config's.
        cases: releases to do. with_excitation: whether to play an excitation as well.
        board: run the reference firmware on this board in place of the simulated device, with the releases alone, each on a
            rig slowed down to its rate (:func:`hapticd.hil.cases.slower_rig`).
        keep: folder that takes recordings, logs and the device's log; None: they are thrown away.
        progress: called with the fraction done.

    Raises:
        HilError: a process did not come up, or the driver has no simulated device.
        RequestRefused: the daemon refuses an experiment.
    """
    with tempfile.TemporaryDirectory(prefix="hapticd-hil-") as scratch:
        # Sockets have short names: the folder to keep may be anywhere, the processes work in the scratch one.
        folder = Path(scratch)
        try:
            if board is None:
                return _run(config, plant, cases, with_excitation, folder, progress)
            return _run_on_firmware(config, cases, board, folder, progress)
        finally:
            if keep is not None:
                ignored = shutil.ignore_patterns("state", "*.sock", "tty")
                shutil.copytree(folder, keep, dirs_exist_ok=True, ignore=ignored)


def _run(
    config: Config,
    plant: Config | None,
    cases: Sequence[Case],
    excited: bool,
    folder: Path,
    progress: Callable[[float], None],
    board: str | None = None,
) -> SuiteResult:
    config = patient(config)
    results: list[CaseResult] = []
    steps = len(cases) + int(excited)
    device = Device(config, folder, plant=plant, board=board)
    with device:
        device.wait_ready()
        with DaemonProcess(config, folder, device.options) as daemon:
            daemon.wait_ready()
            for case in cases:
                results.append(judged(release(daemon, case)))
                progress(len(results) / steps)
            if excited:
                results.append(_excite(daemon, config))
                progress(1.0)
            status = daemon.client.status()
    declared, doubt = declared_latency(daemon.config)
    return SuiteResult(
        config.driver.name,
        tuple(results),
        device.read_log().sample_to_current_s(),
        declared,
        {**status["timing"], "exchanges_missed": status["exchanges_missed"]},
        (doubt,) if doubt else (),
    )


def _run_on_firmware(
    config: Config, cases: Sequence[Case], board: str, folder: Path, progress: Callable[[float], None]
) -> SuiteResult:
    """Each case on a rig of its own, which is at the emulated board's rate what the config's is at the case's."""
    parts = []
    for case in cases:
        rig = slower_rig(config, case.rate_hz, FIRMWARE_RATE_HZ)
        slow = [slower_case(case, FIRMWARE_RATE_HZ)]
        parts.append(_run(rig, None, slow, False, folder / case.name, lambda fraction: None, board))
        progress(len(parts) / len(cases))
    counted = ("ticks", "missed", "exchanges_missed")
    return SuiteResult(
        f"{config.driver.name}, firmware on {board}",
        tuple(result for part in parts for result in part.cases),
        np.concatenate([part.latency_s for part in parts]),
        parts[0].declared_s,
        {**parts[0].timing, **{key: sum(part.timing[key] for part in parts) for key in counted}},
        tuple(dict.fromkeys(warning for part in parts for warning in part.warnings)),
    )


def patient(config: Config) -> Config:
    """The config with as many missed exchanges allowed as its rate has in `PATIENCE_S`."""
    missed = config.safety.missed_exchanges
    if missed:
        missed = max(missed, round(PATIENCE_S * config.servo.rate_hz))
    return config.model_copy(update={"safety": config.safety.model_copy(update={"missed_exchanges": missed})})


def release(daemon: DaemonProcess, case: Case) -> Released:
    """One release of Fig. 8 on a running daemon."""
    client = daemon.client
    # The suite shows what theory says, so the guard has no say: some cases are unstable on purpose.
    client.set(dict(case.settings), force=True)
    config = apply_settings(daemon.config, case.settings, source="Fig. 8")
    result, tries = _undisturbed(
        daemon, lambda: client.release(case.deflection, case.duration_s, force=True), FLAG_MISSED_EXCHANGE
    )
    return Released(case, config, result, tries)


def judged(released: Released) -> CaseResult:
    """A release beside its simulations, at the times of its own ticks: few, and many where none of the few agrees.

    Near a boundary of outcomes, a good rig is unlike all of n simulations in one of n + 1 releases.

    The outcome must be that of one of them, the current near that of one, and friction must hold the shaft at both rests.

    Raises:
        RunFileError: the recording is gone, or lacks rows.
    """
    result = _compared(released, LOG2_DRAWS)
    return _compared(released, MOST_LOG2_DRAWS) if result.problems else result


def _compared(released: Released, log2_draws: int) -> CaseResult:
    case, config, result, tries = released.case, released.config, released.result, released.tries
    achieved, path = float(result["achieved_deflection"]), Path(result["run"])
    measured = measured_trace(path, config)
    count = round(case.duration_s * config.servo.rate_hz)
    times = recorded_times(read_run(path), count) if len(measured.ticks) else None
    plants = possible(config, log2_draws)
    simulated = [simulated_trace(plant, case.duration_s, achieved + start, times=times) for plant, start in plants]
    comparison = min((compare(measured, trace) for trace, _ in simulated), key=lambda each: each.current_rms_error)
    # The recording goes on for some periods after the release's time, and so does a motion that has not ended by then.
    outcome, rests = result["outcome"], False
    if not result.get("fault") and len(measured.ticks) >= _FEWEST:
        outcome, _, rests = shown_outcome(measured.ticks[:count], measured.time_s[:count])
    unit = unit_of("plant.coulomb", config.is_linear)
    shown = [shown_outcome(trace.ticks, trace.time_s) for trace, _ in simulated]
    expected = {
        str(report["outcome"]) if report["fault"] else seen
        for (seen, *_), (_, report) in zip(shown, simulated, strict=True)
    }
    found: dict[str, Any] = {
        "achieved_deflection": achieved,
        "outcome": outcome,
        "simulated_outcome": ", ".join(sorted(expected)),
        "paper": case.paper,
        "final_ticks": float(measured.ticks[:count][-1]) if len(measured.ticks) else None,
        "simulated_final_ticks": float(simulated[0][0].ticks[-1]),
        "fault": result.get("fault"),
        **tries,
        "run": result["run"],
    }
    problems = _trace_problems(comparison)
    if outcome not in expected:
        problems.append(f"outcome {outcome}, simulated {found['simulated_outcome']}")
    torques = [
        rest_torque(trace, config) for (*_, at_rest), (trace, _) in zip(shown, simulated, strict=True) if at_rest
    ]
    if rests and torques:
        # Friction holds a shaft wherever less than it acts; where in this band a motion ends depends on its last swings.
        found["rest_torque"] = rest_torque(measured, config)
        nearest = min(torques, key=lambda torque: abs(torque - found["rest_torque"]))
        friction = max(plant.plant.coulomb for plant, _ in plants)
        if abs(nearest - found["rest_torque"]) > 2.0 * (1.0 + REST_TOLERANCE) * friction:
            problems.append(
                f"at rest with a torque of {found['rest_torque']:.3g}, simulated {nearest:.3g} {unit}: a friction of "
                f"{friction:.3g} {unit} does not hold the shaft at both"
            )
    if problems and tries["disturbances"]:
        problems.append(f"this machine disturbed each of {tries['attempts']} tries")
    return CaseResult(case.name, f"release at {case.deflection:g} ticks", comparison, found, tuple(problems))


def _excite(daemon: DaemonProcess, config: Config) -> CaseResult:
    client = daemon.client
    client.set({"servo.rate_hz": config.servo.rate_hz, "encoder.decimation": config.encoder.decimation}, force=True)
    result, tries = _undisturbed(
        daemon,
        lambda: client.excite(EXCITATION, duration_s=EXCITATION_S, force=True),
        FLAG_MISSED_EXCHANGE | FLAG_MISSED_PERIOD,
    )
    fault = result.get("fault")
    table = excitation.build(config, EXCITATION, duration_s=EXCITATION_S)
    measured = measured_trace(Path(result["run"]), config)
    # The shaft may stand anywhere within its raw count; the middle of it is the best guess.
    start = 0.5 / config.encoder.decimation
    simulated, _ = simulated_trace(config, EXCITATION_S, start, table)
    comparison = compare(measured, simulated, round(EXCITATION_SPAN_S * config.servo.rate_hz))
    found = {"fault": fault, **tries, "run": result["run"]}
    problems = [f"fault {fault}"] if fault else _trace_problems(comparison)
    return CaseResult("excitation", f"{EXCITATION}, {EXCITATION_S:g} s", comparison, found, tuple(problems))


def _undisturbed(
    daemon: DaemonProcess, begin: Callable[[], dict[str, Any]], disturbing: int
) -> tuple[dict[str, Any], dict[str, int]]:
    """Run an experiment, and repeat it if a tick has one of these flags or sent its command too late; result and tries."""
    client = daemon.client
    attempts, disturbed = 0, 0
    result: dict[str, Any] = {}
    while attempts == 0 or (attempts < ATTEMPTS and (disturbed or result.get("fault") not in (None, *GROWTH))):
        attempts += 1
        try:
            result = client.wait(begin()["experiment"])["result"]
        except RequestRefused as refusal:
            if refusal.code != "fault" or attempts == ATTEMPTS:
                raise
            result = {"fault": refusal.code}
        if "run" in result:
            disturbed = _disturbances(Path(result["run"]), disturbing) + (result.get("fault") == "overrun")
        if client.status()["state"] == "fault":
            client.clear()
    return result, {"disturbances": disturbed, "attempts": attempts}


def _disturbances(path: Path, disturbing: int) -> int:
    """Rendered ticks with one of these flags, or that took longer than a period: their command was later than a replay's."""
    run = read_run(path)
    flags = run.columns["flags"]
    long = run.columns["exec_ns"] > 1e9 / run.metadata["config"]["servo"]["rate_hz"]
    return int(np.count_nonzero((flags & FLAG_RUNNING) * ((flags & disturbing != 0) | long)))


def _trace_problems(comparison: Comparison) -> list[str]:
    if comparison.swing < 5:
        return ["the recording is too short to compare"]
    if comparison.current_rms_error > CURRENT_TOLERANCE:
        return [
            f"the current differs by {significant(100 * comparison.current_rms_error)} % RMS over the first swing, "
            f"{100 * CURRENT_TOLERANCE:g} % allowed"
        ]
    return []
