"""The daemon's own stops: `estop` while current flows, and the trips of speed and excursion at low values."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from hapticd.client import settings_for_a_while, stop_channel
from hapticd.commission.step import DisturbedError, Picture, Result, Seen, StepError, line, skipped
from hapticd.hil.errors import HilError
from hapticd.record import read_run

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from hapticd.commission.rig import Rig
    from hapticd.hil.daemon import DaemonProcess

LOST: Final = ("missed_exchanges", "device_fault", "driver_lost", "overrun")
"""Faults of the way to the device, which end a motion before what was asked for can."""
STOP_LIMIT_S: Final = 0.05
"""From the command to the servo loop's answer that the current is zero; a machine without real time included."""
ZERO_PERIODS: Final = 3
"""In which a motion clearly beyond a limit must be followed by zero current."""
CLEARLY: Final = 1.1
STEPS_S: Final = 4.0
STEP: Final = 6.0
"""Current over what overcomes friction."""
SWING: Final = 3.0
SWING_HZ: Final = (5.0, 6.0)
PUSHED: Final = 0.5
"""Of the swing's amplitude, with which motion tells best when a push ended."""
PUSHED_S: Final = 0.005
"""In which it then moves by as many counts as it takes."""
SWUNG_S: Final = 3.0
HAND_S: Final = 15.0
REARM_S: Final = 0.5
LAGS_S: Final = 0.0001 * np.arange(200)
LONGEST_S: Final = 15.0
LOW_SHARE: Final = 0.05
"""Of a safety limit, where it is tried."""
FEWEST_COUNTS: Final = 12
"""A tick: a lower limit of speed would be tripped by the encoder's own steps."""


def estop(rig: Rig) -> Result:
    """Starts a daemon, swings the shaft at 5 Hz, sends estop, and times zero current and the end of the push."""
    with _swinging(rig) as (daemon, job):
        begun, begun_ns = time.monotonic(), time.monotonic_ns()
        state = stop_channel.ask(daemon.client.socket_path, "estop", 1.0)
        obeyed = time.monotonic() - begun
        found = daemon.client.wait(job)["result"] or {}
        code = fault_of(daemon)
        late_s = rig.late_s(begun_ns)
        daemon.client.clear()
    figures: dict[str, Any] = {"obeyed_ms": 1e3 * obeyed, "answer": state, "fault": code}
    limit = {"obeyed_ms": 1e3 * STOP_LIMIT_S, "fault": "estop"}
    seen = Seen(figures, limit, _end_of_swing(rig, found, figures), dangerous=True)
    if code == "estop" and STOP_LIMIT_S < obeyed < STOP_LIMIT_S + late_s:
        raise DisturbedError(
            f"the answer to estop took {1e3 * obeyed:.0f} ms, and programs waited for {1e3 * late_s:.0f} ms"
        )
    if state != "fault" or code != "estop" or obeyed > STOP_LIMIT_S:
        return seen.fails(
            f"zero current {1e3 * obeyed:.0f} ms after estop; the answer was {state}, the fault {code}",
            "this machine keeps the servo loop waiting",
            "hapticd doctor, hapticd latency",
        )
    return seen.passes(f"zero current within {1e3 * obeyed:.1f} ms of the command")


def enable(rig: Rig) -> Result:
    """Asks you to let go of the enable and to hold it again, first with the amplifier off, then while the shaft swings."""
    if not rig.config.safety.enable:
        return skipped("safety.enable is false: nobody has to hold anything")
    with rig.bench() as bench:
        for held, what in ((False, "Let go of the enable"), (True, "Hold the enable again, and go on holding it")):
            if not rig.operator.does(f"{what}. It has {HAND_S:g} s from Enter"):
                return skipped("nobody was there to let go of the enable")
            if bench.wait_held(held, HAND_S) is None:
                return Seen({"held": not held}, {"held": held}, dangerous=True).fails(
                    f"the enable input reads {'released' if held else 'held'} whatever the hand does",
                    "a bridge or a broken wire at the switch, or another input than the config says",
                    "the switch and its wire with a meter; driver.enable_bit on a CAN drive",
                )
        if bench.hand_is_simulated:
            return Result(
                "pass", "the input follows the hand; the simulated one never lets go of a daemon's", {"held": True}
            )
    asked = f"The shaft is going to swing: let go of the enable within {LONGEST_S:g} s of Enter, then hold it again"
    if not rig.operator.does(asked):
        return skipped("nobody was there to let go of the enable")
    with _swinging(rig) as (daemon, job):
        found = daemon.client.wait(job)["result"] or {}
        fault = fault_of(daemon)
        daemon.wait_until(lambda: daemon.client.status()["enable"]["held"], "the enable was held again", HAND_S)
        states = [_state_after(daemon)]
        if fault:
            daemon.client.clear()
            states.append(_state_after(daemon))
    figures: dict[str, Any] = {"fault": fault, "held_again": states[0][0], "cleared": states[-1][0]}
    limit = {"fault": "enable_released", "held_again": "fault", "cleared": "off"}
    seen = Seen(figures, limit, _end_of_swing(rig, found, figures), dangerous=True)
    figures.pop("zero_by_motion_ms", None)  # a hand lets go at any phase of the swing
    if (
        fault != "enable_released"
        or [state for state, _ in states] != ["fault", "off"]
        or any(flows for _, flows in states)
    ):
        return seen.fails(
            f"after the release the fault was {fault}; held again, {' then '.join(state for state, _ in states)}",
            "nobody let go in time, or the loop went on without the enable",
            "this step again; the daemon's log",
        )
    return seen.passes("released, the current ends; held again, nothing begins by itself")


def fault_of(daemon: DaemonProcess) -> str | None:
    """The code of the fault that is latched.

    Raises:
        StepError: it is one of the way to the device.
    """
    fault = daemon.client.status()["fault"] or {}
    if fault.get("code") in LOST:
        raise StepError(f"{fault['code']} ended the motion first: {fault['cause']}")
    return fault.get("code")


def _state_after(daemon: DaemonProcess) -> tuple[str, bool]:
    """The state, and whether current flowed, within a time in which something might begin by itself."""
    flows, end = False, time.monotonic() + REARM_S
    while time.monotonic() < end:
        status = daemon.client.status()
        flows |= status["current"] != 0.0 or status["state"] == "running"
    return str(status["state"]), flows


@contextmanager
def _swinging(rig: Rig) -> Iterator[tuple[DaemonProcess, int]]:
    """A daemon and its experiment that swings the shaft, while current pushes it the way it moves already."""
    with rig.daemon() as daemon, settings_for_a_while(daemon.client, {"spring.stiffness": 0.0}, force=True):
        daemon.client.origin(force=True)
        low, high = SWING_HZ
        amplitude = _current(rig, SWING)
        swing = daemon.client.excite(
            "chirp", amplitude=amplitude, duration_s=LONGEST_S, low_hz=low, high_hz=high, force=True
        )

        def pushed() -> bool:
            status = daemon.client.status()
            towards = float(status["velocity"] * np.sign(status["current"]))
            fast = FEWEST_COUNTS * rig.config.raw_resolution / PUSHED_S
            return abs(float(status["current"])) > PUSHED * amplitude and towards > fast

        daemon.wait_until(lambda: daemon.client.status()["current"] != 0.0, "a current", LONGEST_S)
        with suppress(HilError):  # a coarse encoder may never see so much
            daemon.wait_until(pushed, "the shaft swung", SWUNG_S)
        yield daemon, int(swing["experiment"])


def _end_of_swing(rig: Rig, found: Mapping[str, Any], figures: dict[str, Any]) -> Picture | None:
    """Add to the figures when the current ended, by the recording and by the motion; its picture."""
    if not found.get("run"):
        return None
    t, current, position = _rows(rig, found["run"])
    last = int(np.flatnonzero(current)[-1])
    near = slice(max(0, last - 100), last + 200)
    # from where the shaft turned: under friction to the other side nothing of this holds
    turned = np.flatnonzero(np.diff(position[: last + 1]) * current[last] < 0.0)
    late = _lag(t, current, position, int(turned[-1]) + 1 if len(turned) else 0)
    figures["rows_at_zero"] = len(t) - last - 1
    figures["zero_by_motion_ms"] = None if late is None else 1e3 * late
    return Picture("s", "A", (line("command", t[near], current[near], "steps"),), {"the last current": float(t[last])})


def _lag(
    t: NDArray[np.float64], current: NDArray[np.float64], position: NDArray[np.float64], begin: int
) -> float | None:
    """How long after the command the motion follows it, s: x = a + b t + c t² + g ∬ i(t − lag), the lag that fits best.

    Args:
        t: (n,) s. current: (n,) A, each until the next. position: (n,) rad or m, from row begin on of one direction.

    Returns:
        None where it moves by too little.
    """
    if len(np.flatnonzero(np.diff(position[begin:]))) < FEWEST_COUNTS:
        return None
    fine = np.arange(t[begin] - LAGS_S[-1], t[-1], LAGS_S[1])
    held = current[np.maximum(np.searchsorted(t, fine, "right") - 1, 0)]
    pushed = np.cumsum(np.cumsum(held)) * LAGS_S[1] ** 2
    t, position = t[begin:] - t[begin], position[begin:]
    errors = []
    for lag in LAGS_S:
        terms = np.column_stack([np.ones_like(t), t, t * t, np.interp(t - lag, fine - fine[0] - LAGS_S[-1], pushed)])
        errors.append(np.sum((position - terms @ np.linalg.lstsq(terms, position, rcond=None)[0]) ** 2))
    return float(LAGS_S[int(np.argmin(errors))])


def trips(rig: Rig) -> Result:
    """Sets both limits to a twentieth, and lets current steps run beyond them."""
    config = rig.config
    safety = config.safety
    assert safety.max_velocity is not None
    assert safety.max_excursion is not None
    slowest = FEWEST_COUNTS * config.raw_resolution / config.period
    low = {
        "over_speed": ("safety.max_velocity", min(max(LOW_SHARE * safety.max_velocity, slowest), safety.max_velocity)),
        "excursion": ("safety.max_excursion", LOW_SHARE * safety.max_excursion),
    }
    figures: dict[str, Any] = {}
    limit: dict[str, Any] = {"periods_to_zero": ZERO_PERIODS}
    problems, lines, marks = [], [], {}
    with rig.daemon() as daemon:
        for code, (key, value) in low.items():
            daemon.client.origin(force=True)
            with settings_for_a_while(daemon.client, {key: value, "spring.stiffness": 0.0}, force=True):
                found = daemon.client.wait(_steps(daemon, rig))["result"] or {}
                fault = fault_of(daemon)
                if fault:
                    daemon.client.clear()
            t, current, position = _rows(rig, found["run"])
            flowing = np.flatnonzero(current)
            ended = int(flowing[-1]) if len(flowing) else 0
            speed = np.abs(np.gradient(position, t))
            shown = speed if code == "over_speed" else np.abs(position)
            beyond = np.flatnonzero(shown > CLEARLY * value)
            late = ended + 1 - int(beyond[0]) if len(beyond) else 0
            figures |= {f"{code}_fault": fault, f"{code}_periods_to_zero": late}
            limit[f"{code}_fault"], limit[key] = code, value
            if fault != code:
                problems.append(f"{key} = {value:.3g} was passed with the fault {fault}")
            elif late > ZERO_PERIODS:
                problems.append(f"{key} = {value:.3g} was passed {late} periods before the current was zero")
            near = slice(max(0, ended - 200), ended + 200)
            lines.append(line(code, t[near] - t[ended], shown[near] / value))
            marks = {"zero current": 0.0}
    seen = Seen(figures, limit, Picture("s", "of the low limit", tuple(lines), marks), dangerous=True)
    if problems:
        return seen.fails(
            "; ".join(problems),
            "the loop does not see the motion as the config says, or runs late",
            "the encoder's resolution; hapticd latency",
        )
    return seen.passes("both trips at their low values, zero current in the same tick")


def _steps(daemon: DaemonProcess, rig: Rig) -> int:
    """An excitation of many current steps, strong enough for any low limit; the experiment's number."""
    return int(
        daemon.client.excite("steps", amplitude=_current(rig, STEP), duration_s=STEPS_S, force=True)["experiment"]
    )


def _current(rig: Rig, times: float) -> float:
    """So many times what overcomes friction, within what may flow, A."""
    amplifier = rig.config.amplifier
    current = min(times * rig.sliding_current, 0.8 * (amplifier.continuous_current or np.inf))
    return float(f"{max(current, 0.05 * rig.rated):.3g}")


def _rows(rig: Rig, recording: str) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Time, commanded current and position from the spring's origin of a recording, which is kept."""
    run = read_run(rig.keep(Path(recording)))
    if not len(run.columns["time_s"]):
        raise StepError(f"the recording {recording} is empty")
    counts = run.columns["encoder_counts"] - float(run.metadata.get("origin_counts") or 0.0)
    # a late tick looks later at the shaft
    t = run.columns["time_s"] + 1e-9 * run.columns["wake_late_ns"]
    return t, run.columns["current_command_A"], counts * rig.config.raw_resolution
