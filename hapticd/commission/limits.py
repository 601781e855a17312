"""The daemon's own stops: `estop` while current flows, and the trips of speed and excursion at low values."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from hapticd.client import settings_for_a_while, stop_channel
from hapticd.commission.step import Picture, Result, StepError, line
from hapticd.commission.stopping import knee
from hapticd.record import read_run

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from hapticd.commission.rig import Rig
    from hapticd.hil.daemon import DaemonProcess

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
LONGEST_S: Final = 15.0
LOW_SHARE: Final = 0.05
"""Of a safety limit, where it is tried."""
FEWEST_COUNTS: Final = 12
"""A tick: a lower limit of speed would be tripped by the encoder's own steps."""


def estop(rig: Rig) -> Result:
    """`estop` while current flows: when does the loop say zero, and when does the motion."""
    with rig.daemon() as daemon, settings_for_a_while(daemon.client, {"spring.stiffness": 0.0}, force=True):
        daemon.client.origin(force=True)
        low, high = SWING_HZ
        amplitude = _current(rig, SWING)
        swing = daemon.client.excite(
            "chirp", amplitude=amplitude, duration_s=LONGEST_S, low_hz=low, high_hz=high, force=True
        )
        job = int(swing["experiment"])
        daemon.wait_until(lambda: abs(daemon.client.status()["current"]) > 0.0, "a current", LONGEST_S)
        begun = time.monotonic()
        state = stop_channel.ask(daemon.client.socket_path, "estop", 1.0)
        obeyed = time.monotonic() - begun
        found = daemon.client.wait(job)["result"] or {}
        code = (daemon.client.status()["fault"] or {}).get("code")
        daemon.client.clear()
    figures: dict[str, Any] = {"obeyed_ms": 1e3 * obeyed, "answer": state, "fault": code}
    limit = {"obeyed_ms": 1e3 * STOP_LIMIT_S, "fault": "estop"}
    picture = None
    if found.get("run"):
        t, current, position = _rows(rig, found["run"])
        last = int(np.flatnonzero(current)[-1])
        near = slice(max(0, last - 100), last + 200)
        towards = np.sign(position[last] - position[max(0, last - 5)]) or 1.0
        figures["rows_at_zero"] = len(t) - last - 1
        ended = knee(t[near], towards * position[near])
        figures["zero_by_motion_ms"] = None if ended is None else 1e3 * float(ended - t[last])
        picture = Picture("s", "A", (line("command", t[near], current[near], "steps"),), {"estop": float(t[last])})
    if state != "fault" or code != "estop" or obeyed > STOP_LIMIT_S:
        return Result(
            "fail",
            f"zero current {1e3 * obeyed:.0f} ms after estop; the answer was {state}, the fault {code}",
            figures,
            limit,
            "this machine keeps the servo loop waiting",
            "hapticd doctor, hapticd latency",
            dangerous=True,
            picture=picture,
        )
    return Result("pass", f"zero current within {1e3 * obeyed:.1f} ms of the command", figures, limit, picture=picture)


def trips(rig: Rig) -> Result:
    """Limits of speed and excursion set low, and a motion that goes beyond them."""
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
                fault = daemon.client.status()["fault"] or {}
                if fault:
                    daemon.client.clear()
            t, current, position = _rows(rig, found["run"])
            flowing = np.flatnonzero(current)
            ended = int(flowing[-1]) if len(flowing) else 0
            speed = np.abs(np.gradient(position, t))
            shown = speed if code == "over_speed" else np.abs(position)
            beyond = np.flatnonzero(shown > CLEARLY * value)
            late = ended + 1 - int(beyond[0]) if len(beyond) else 0
            figures |= {f"{code}_fault": fault.get("code"), f"{code}_periods_to_zero": late}
            limit[f"{code}_fault"], limit[key] = code, value
            if fault.get("code") != code:
                problems.append(f"{key} = {value:.3g} was passed with the fault {fault.get('code')}")
            elif late > ZERO_PERIODS:
                problems.append(f"{key} = {value:.3g} was passed {late} periods before the current was zero")
            near = slice(max(0, ended - 200), ended + 200)
            lines.append(line(code, t[near] - t[ended], shown[near] / value))
            marks = {"zero current": 0.0}
    picture = Picture("s", "of the low limit", tuple(lines), marks)
    if problems:
        return Result(
            "fail",
            "; ".join(problems),
            figures,
            limit,
            "the loop does not see the motion as the config says, or runs late",
            "the encoder's resolution; hapticd latency",
            dangerous=True,
            picture=picture,
        )
    return Result(
        "pass", "both trips at their low values, zero current in the same tick", figures, limit, picture=picture
    )


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
