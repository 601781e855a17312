"""Bad recordings, each with the statement that helps."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from hapticd.gap.checks import check_recording, check_samples, check_together
from hapticd.gap.errors import RecordingError
from hapticd.gap.recording import Recording

from .synthetic import model

Spoil = Callable[[Recording], Recording]


def _wrapped(recording: Recording, span: int) -> Recording:
    counts = np.floor(recording.position / recording.resolution).astype(np.int64)
    wrapped = (counts + span // 2) % span - span // 2
    return replace(recording, position=(wrapped + 0.5) * recording.resolution)


def _in_ms(recording: Recording) -> Recording:
    return replace(recording, time_s=1e3 * recording.time_s, period_s=1e3 * recording.period_s)


ERRORS: dict[str, tuple[Spoil, str]] = {
    "time in ms": (_in_ms, "1 s between samples is 1 Hz, slower than 20 Hz; is it in ms? It must be in s"),
    "time in ks": (
        lambda r: replace(r, time_s=1e-3 * r.time_s, period_s=1e-3 * r.period_s),
        "1e-06 s between samples is 1e+06 Hz, faster than 100000 Hz",
    ),
    "short": (lambda r: replace(r, time_s=r.time_s[:500], position=r.position[:500]), "0.499 s are too short"),
    "current in mA": (
        lambda r: replace(r, current=1e3 * r.current),
        "times amplifier.peak_current = 6 A of the model; is it in mA?",
    ),
    "current beyond all units": (
        lambda r: replace(r, current=1e300 * np.sign(r.current)),
        "the current reaches 1e+300 A, 1.667e+299 times amplifier.peak_current = 6 A",
    ),
    "position in counts": (
        lambda r: replace(r, position=np.floor(r.position / r.resolution), resolution=1.0),
        "position holds whole numbers only; are they counts? It must be in rad",
    ),
    "no motion": (
        lambda r: replace(r, position=0 * r.position),
        "there is no motion: the position changes by 0 encoder counts",
    ),
    "12 bits": (lambda r: _wrapped(r, 4096), "a counter that overflows at 4096; import it with position.wrap"),
    "one revolution": (lambda r: _wrapped(r, 8192), "a counter that overflows at 8192; import it with position.wrap"),
    "16 bits, moving fast": (
        lambda r: _wrapped(replace(r, position=40 * r.position), 65536),
        "a counter that overflows at 65536; import it with position.wrap: 65536",
    ),
    "position in mrad": (
        lambda r: replace(r, position=1e3 * r.position, resolution=1e3 * r.resolution),
        "times the commanded force for this motion, more than 200: a unit is wrong by a large factor",
    ),
    "current in kA": (
        lambda r: replace(r, current=1e-3 * r.current),
        "times the commanded force for this motion, more than 200: a unit is wrong by a large factor",
    ),
    "no current": (
        lambda r: replace(r, current=0 * r.current),
        "the commanded current is 0 A in every row, and yet the shaft moves to and fro: is it the right column?",
    ),
    "a quarter missing": (
        lambda r: replace(r, time_s=r.time_s + np.where(r.time_s > 5.0, 8.0, 0.0)),
        "more than 20 % of the record is missing",
    ),
}


@pytest.mark.parametrize("name", ERRORS)
def test_error(name: str, nominal_run: Recording) -> None:
    spoil, statement = ERRORS[name]
    with pytest.raises(RecordingError, match=re.escape(statement)) as caught:
        check_recording(spoil(nominal_run), model())
    assert str(caught.value).startswith("synthetic: ")


def test_a_jump_of_a_counter_that_goes_farther_is_none_of_its_overflows(nominal_run: Recording) -> None:
    """At 400 Hz a light shaft hops 270 counts from one sample to the next."""
    position = nominal_run.position.copy()
    position[4980:5000], position[5000:5020] = position[4980], position[4980] + 262.0 * nominal_run.resolution
    recording = replace(nominal_run, position=position)
    assert float(np.ptp(recording.position)) > 1000.0 * recording.resolution
    check_recording(recording, model())


WARNINGS: dict[str, tuple[Spoil, str]] = {
    "one way": (
        lambda r: replace(r, position=np.maximum.accumulate(r.position)),
        "the motion goes in the positive direction only: Coulomb friction, a constant bias",
    ),
    "few seconds": (
        lambda r: replace(r, time_s=r.time_s[:3000], position=r.position[:3000], current=r.current[:3000]),
        "3 s is short",
    ),
    "gap": (
        lambda r: replace(r, time_s=r.time_s + np.where(r.time_s > 5.0, 0.5, 0.0)),
        "1 gap(s) of more than 10 periods, 0.501 s in all, the longest 0.501 s at row 5001; what happened in them",
    ),
    "one command": (lambda r: replace(r, current=0 * r.current + 0.1), "the commanded current never changes"),
    "coasting": (
        lambda r: replace(r, current=0 * r.current, position=np.maximum.accumulate(r.position)),
        "the commanded current never changes",
    ),
    "degrees": (
        lambda r: replace(r, position=57.3 * r.position, resolution=57.3 * r.resolution),
        "times the commanded force for this motion; is position in degrees or mm",
    ),
    "the other way": (
        lambda r: replace(r, position=-r.position),
        "the shaft moves as if the current pushed the other way: is the sign of the current or of the position wrong",
    ),
    "mA without a limit": (
        lambda r: replace(r, current=150.0 * r.current),
        "times what the model needs for this motion; is the current in mA",
    ),
}


@pytest.mark.parametrize("name", WARNINGS)
def test_warning(name: str, nominal_run: Recording) -> None:
    spoil, statement = WARNINGS[name]
    assert any(statement in warning for warning in check_recording(spoil(nominal_run), model()))


def test_a_good_run_has_no_warnings(nominal_run: Recording) -> None:
    assert check_recording(nominal_run, model()) == ()


def test_a_command_that_the_motion_s_samples_miss_is_there_all_the_same(nominal_run: Recording) -> None:
    """A sine of 50 Hz is zero every hundredth of a second."""
    time_s = nominal_run.time_s
    fast = replace(nominal_run, current=np.sin(2.0 * np.pi * 50.0 * time_s))
    assert not any("sign" in warning for warning in check_recording(fast, model()))


def test_a_recording_counts_once(nominal_run: Recording) -> None:
    check_together([nominal_run, replace(nominal_run, current=2.0 * nominal_run.current)])
    with pytest.raises(RecordingError, match="copy and synthetic are the same recording: name it once"):
        check_together([replace(nominal_run, name="copy"), nominal_run])


def test_samples_that_are_none() -> None:
    time, position, current = np.arange(300) * 1e-3, np.zeros(300), np.zeros(300)
    check_samples("f", time, position, current)
    time[10], position[20], current[30] = time[8], np.nan, np.inf
    with pytest.raises(RecordingError) as caught:
        check_samples("f", time, position, current)
    lines = str(caught.value).splitlines()
    assert lines[0] == "f: position is missing or not finite in 1 row(s), first in row 20"
    assert lines[1] == "f: current is missing or not finite in 1 row(s), first in row 30"
    assert lines[2].startswith("f: the clock runs backwards or stops at 1 place(s), first at row 10 (0.009 s, ")


def test_too_few_samples() -> None:
    with pytest.raises(RecordingError, match="50 samples are too few; at least 200 are needed"):
        check_samples("f", np.arange(50.0), np.zeros(50), np.zeros(50))
