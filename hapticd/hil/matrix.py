"""The fault matrix: inject, wait, then read from the device's own log when the current was zero, and for good."""

from __future__ import annotations

import json
import math
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from hapticd.client import Client, DaemonUnreachable, RequestRefused
from hapticd.config import Config, apply_settings
from hapticd.hil.clock import JumpingClock
from hapticd.hil.daemon import DaemonProcess
from hapticd.hil.device import Device
from hapticd.hil.device_log import SAMPLE, DeviceLog
from hapticd.hil.errors import HilError
from hapticd.hil.injections import AT_S, CANOPEN, INJECTIONS, Injection, watchdog_s
from hapticd.record import read_run
from hapticd.record.schema import FLAG_MISSED_EXCHANGE, FLAG_MISSED_PERIOD

ATTEMPTS: Final = 5
HOLDING_A: Final = 0.03
"""Current that flows while the shaft is at rest, so that its end can be seen."""
SETTLE_S: Final = 0.8
"""Time after the fault, and after the watchdog's time, in which everything must have happened."""
_SIGTERM_S: Final = 1.0
_CAN_FRAMES: Final = {"reply": "tpdo", "command": "rpdo"}
ENABLE_BIT: Final = 16
CRASH_REPORT_S: Final = 5e-3
"""In which a daemon that crashes writes the stacks of its threads. Its loop goes on meanwhile, and the watchdog hears it."""


@dataclass(frozen=True)
class Row:
    """What one injection did."""

    injection: Injection
    driver: str
    code: str | None = None
    """Fault code that the daemon latched; ``None`` for none."""
    cause: str = ""
    zero_after_s: float | None = None
    """From the injection to the instant since which the motor's current has been zero for good; None: it flows on."""
    tolerated: int = 0
    """Exchanges that failed and were counted without a fault."""
    missed_periods: int = 0
    """Periods that the host itself missed meanwhile."""
    rows_lost: int = 0
    """Rows missing inside the recording; all samples before the fault where there is none. Rows that a killed daemon had not
    yet written (`hapticd.record.writer.FLUSH_S`) are not counted."""
    after_first_miss: int | None = None
    """Periods from the first failed exchange to the tick of the fault."""
    problems: tuple[str, ...] = ()
    struck_ns: int = 0
    """When it struck, CLOCK_MONOTONIC; 0 where a start was refused."""

    @property
    def met(self) -> bool:
        """Whether everything came out as it must."""
        return not self.problems


def run_matrix(
    config: Config,
    *,
    injections: Sequence[Injection] = INJECTIONS,
    board: str | None = None,
    progress: Callable[[float], None] = lambda fraction: None,
) -> list[Row]:
    """Inject every fault that applies to the config's driver, each on a fresh device and a fresh daemon.

    Args:
        config: the daemon's; its driver names the device.
        injections: which faults.
        board: run the reference firmware on this board in place of the simulated device.
        progress: called with the fraction done.

    Returns:
        One row each; a fault that could not be injected is a row that says why.

    Raises:
        HilError: none of them applies.
    """
    chosen = [one for one in injections if config.driver.name in one.devices]
    if not chosen:
        raise HilError(
            f"driver.name = {config.driver.name!r}: has none of these faults; hil needs serial_dac or canopen"
        )
    rows: list[Row] = []
    for injection in chosen:
        with tempfile.TemporaryDirectory(prefix="hapticd-fault-") as folder:
            try:
                rows.append(run_injection(config, injection, Path(folder), board))
            except HilError as error:
                reason = f"not run: {str(error).splitlines()[-1]}"
                rows.append(Row(injection, config.driver.name, problems=(reason,)))
        progress(len(rows) / len(chosen))
    return rows


def with_current(config: Config) -> Config:
    """The config with ticks so coarse that the half tick of bias is a current worth speaking of, at rest too."""
    force = HOLDING_A * config.amplifier.torque_constant
    if config.spring.stiffness == 0.0:
        return config
    least = math.ceil(2.0 * force / (config.spring.stiffness * config.raw_resolution))
    encoder = config.encoder.model_copy(update={"decimation": max(config.encoder.decimation, least)})
    return config.model_copy(update={"encoder": encoder})


def with_enable(config: Config) -> Config:
    """The config with `safety.enable`, on a drive by the input that the simulated one has."""
    settings: dict[str, Any] = {"safety.enable": True}
    if config.driver.name == CANOPEN:
        settings["driver.enable_bit"] = ENABLE_BIT
    return apply_settings(config, settings, source="hil")


def detection_s(config: Config) -> float:
    """Longest time from a fault that the daemon can see to zero current, s: (safety.missed_exchanges + 2) / servo.rate_hz.

    The exchanges that are tolerated, the one too many, in whose tick zero is written, and one period because the fault
    strikes anywhere between two exchanges.
    """
    return ((config.safety.missed_exchanges or 0) + 2) / config.servo.rate_hz


def limit_s(config: Config, injection: Injection) -> float | None:
    """Longest time from an injection to zero current, s; None where the current must go on."""
    if injection.name == "sigterm":
        return _SIGTERM_S
    if injection.by_watchdog:
        report_s = CRASH_REPORT_S if injection.name == "sigsegv" else 0.0
        return watchdog_s(config) + 1.0 / config.servo.rate_hz + report_s
    return detection_s(config) if injection.codes else None


def run_injection(config: Config, injection: Injection, folder: Path, board: str | None = None) -> Row:
    """One row of the matrix, tried again where the machine disturbed the run before the fault struck.

    Raises:
        HilError: it did so every time.
    """
    config = with_current(with_enable(config) if injection.enable else config)
    for attempt in range(ATTEMPTS):
        try:
            return _inject(config, injection, folder / str(attempt), board)
        except _DisturbedError as disturbance:
            reason = str(disturbance)
    raise HilError(f"{injection.name}: {reason}, {ATTEMPTS} times; this machine is too busy for the fault matrix")


class _DisturbedError(Exception):
    """The loop did not run undisturbed up to the fault."""


def _inject(config: Config, injection: Injection, folder: Path, board: str | None) -> Row:
    device = Device(config, folder, script=_script(config, injection), board=board)
    clock = JumpingClock(folder) if injection.clock_jump else None
    with device:
        device.wait_ready()
        daemon = DaemonProcess(config, folder, device.options)
        if clock is not None:
            daemon.add_environment(clock.environment)
        with daemon:
            if injection.refused:
                return _refusal(config, injection, daemon)
            daemon.wait_ready()
            _start(daemon)
            time.sleep(0.7 * AT_S)
            before, before_ns = daemon.client.status(), time.monotonic_ns()
            if before["state"] != "running" and not injection.fault:
                raise _too_early(before)
            time.sleep(0.3 * AT_S)
            struck_ns = time.monotonic_ns()
            if injection.act is not None:
                injection.act(daemon)
            if clock is not None:
                clock.jump(3600)
                time.sleep(SETTLE_S / 2)
                clock.jump(0)
            time.sleep(SETTLE_S + watchdog_s(config))
            status = _status(daemon)
            # Before anything is ended: what the device shows from here on is our doing.
            looked_ns = time.monotonic_ns()
    log = device.read_log()
    injected = log.injected_ns()
    if injected is not None:
        struck_ns = injected
    if before["state"] != "running" and before_ns < struck_ns:  # else we looked late, and it had struck by then
        raise _too_early(before)
    missed = int(before["exchanges_missed"])
    return _judge(config, injection, daemon, log, status, struck_ns, looked_ns, missed)


def _script(config: Config, injection: Injection) -> dict[str, Any]:
    """What the device plays: the fault from its first enable on, or from the beginning where a start must be refused."""
    fault = {**injection.fault} if injection.refused else {"at_s": AT_S, "from": "enabled", **injection.fault}
    if config.driver.name == CANOPEN and "frames" in fault:
        fault["frames"] = _CAN_FRAMES[fault["frames"]]
    if "delay_s" in fault:
        fault["delay_s"] = max(fault["delay_s"], 1.0 / config.servo.rate_hz)
    return {"faults": [fault] if injection.fault else [], **injection.script}


def _too_early(status: dict[str, Any]) -> _DisturbedError:
    return _DisturbedError(f"fault {(status['fault'] or {}).get('code')} before anything was injected")


def _start(daemon: DaemonProcess) -> None:
    try:
        if daemon.client.status()["fault"]:
            daemon.client.clear()
        daemon.client.start()
        daemon.wait_state("running", "fault")  # the injected one may be faster than we look
    except (RequestRefused, HilError) as error:
        raise _DisturbedError(str(error)) from error


def _status(daemon: DaemonProcess) -> dict[str, Any] | None:
    try:
        return Client(daemon.client.socket_path, timeout_s=2.0).status() if daemon.running else None
    except DaemonUnreachable:
        return None


def _judge(
    config: Config,
    injection: Injection,
    daemon: DaemonProcess,
    log: DeviceLog,
    status: dict[str, Any] | None,
    struck_ns: int,
    looked_ns: int,
    missed_before: int,
) -> Row:
    fault = status["fault"] if status else _latched(daemon)
    code = fault["code"] if fault else None
    zero_ns = log.until(looked_ns).zero_current_after(struck_ns)
    zero_after = None if zero_ns is None else (zero_ns - struck_ns) * 1e-9
    lost, first_miss = _recording(daemon, log, struck_ns)
    problems = [] if log.flows_at(struck_ns) else ["no current flowed when the fault struck: nothing is shown"]
    if injection.codes and status is None:
        problems.append("the daemon does not answer any more")
    if injection.codes and code not in injection.codes:
        problems.append(f"fault {code or 'none'} instead of {' or '.join(injection.codes)}")
    if not injection.codes and code is not None and status is not None:
        problems.append(f"fault {code}, though it should be tolerated")
    problems += _late(config, injection, zero_after)
    if lost:
        problems.append(f"{lost} rows before the fault are not in the recording")
    return Row(
        injection,
        config.driver.name,
        code,
        fault["cause"] if fault else "",
        zero_after,
        int(status["exchanges_missed"]) - missed_before if status else 0,
        int(status["timing"]["missed"]) if status else 0,
        lost,
        first_miss,
        tuple(problems),
        struck_ns,
    )


def _late(config: Config, injection: Injection, zero_after: float | None) -> list[str]:
    limit = limit_s(config, injection)
    if limit is None:
        return ["the current stopped"] if zero_after is not None else []
    if zero_after is None:
        return ["the current never became zero"]
    if zero_after <= limit:
        return []
    return [f"zero current after {1e3 * zero_after:.3g} ms, {1e3 * limit:.3g} ms allowed"]


def _recording(daemon: DaemonProcess, log: DeviceLog, struck_ns: int) -> tuple[int, int | None]:
    """Rows missing inside the recording, and periods from the first failed exchange to the fault."""
    runs = sorted(daemon.runs.glob("*"), key=lambda path: path.stat().st_mtime)
    runs = [path for path in runs if path.is_file() and "fault" not in path.name]
    if not runs:
        return int(np.sum((log.event == SAMPLE) & (log.time_ns < struck_ns))), None
    run = read_run(runs[-1])
    ticks, flags = run.columns["tick"], run.columns["flags"]
    # A period that the host itself missed has no row, and the next row says so.
    holes = (np.diff(ticks) - 1) * (flags[1:] & FLAG_MISSED_PERIOD == 0)
    gaps = int(np.sum(holes))
    missed = np.flatnonzero(flags & FLAG_MISSED_EXCHANGE)
    first_miss = int(ticks[-1] - ticks[missed[0]]) if len(missed) else None
    return gaps, first_miss


def _latched(daemon: DaemonProcess) -> dict[str, Any] | None:
    """The fault on disk of a daemon that is gone."""
    for path in (daemon.folder / "state").rglob("*.json"):
        document = json.loads(path.read_text())
        if "code" in document:
            return dict(document)
    return None


def _refusal(config: Config, injection: Injection, daemon: DaemonProcess) -> Row:
    try:
        daemon.wait_ready()
    except HilError:
        lines = daemon.last_output().splitlines()
        problems = () if daemon.code == 4 else (f"exit code {daemon.code} instead of 4",)
        return Row(injection, config.driver.name, "refused", lines[-1], 0.0, problems=problems)
    return Row(injection, config.driver.name, problems=("the daemon started on such a device",))
