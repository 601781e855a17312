"""What a recording can and cannot tell: each statement against a recording that was made to lack it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hapticd.record import RunFileError
from hapticd.record.inspection import inspect
from hapticd.record.run import Run

N = 20_000
T = 0.001 * np.arange(N)
WIDE = np.sin(0.4 * T) * np.sin(2 * np.pi * 3 * T)
DRIVE = 0.3 * np.sin(2 * np.pi * (1 + 3 * T) * T) + 0.01 * np.cos(17 * T)


def run(time_s: Any = T, counts: Any = None, current: Any = DRIVE, **more: Any) -> Run:
    counts = np.rint(5000 * np.clip(WIDE, -0.5, 0.5)) if counts is None else counts
    columns = {"time_s": time_s, "encoder_counts": counts.astype(np.int64), "current_command_A": current, **more}
    return Run(Path("made.arrow"), columns, {"config": {"encoder": {"counts_per_rev": 4096}}})


def lacks(found: Run) -> dict[str, str]:
    return {text.partition(" (")[0]: text.partition(" (")[2].rstrip(")") for text in inspect(found).cannot_tell}


def test_a_rich_recording_lacks_little() -> None:
    found = inspect(run())
    assert set(lacks(run())) == {"current limit", "warming up"}
    assert {"inertia", "Coulomb friction", "viscous friction", "delay and lag", "ripple in angle"} <= set(
        found.can_tell
    )
    assert found.stamps["rate_hz"] == pytest.approx(1000.0)
    assert (found.stamps["lost_rows"], found.stamps["grid_s"]) == (0, None)
    assert found.next_experiment == "hapticd excite steps"


POOR: dict[str, tuple[Callable[[], Run], str, str]] = {
    "one way": (lambda: run(counts=np.rint(3000 * T)), "Coulomb friction", "it moves one way only"),
    "still": (lambda: run(counts=np.rint(2 * WIDE)), "inertia", "cells in all"),
    "one speed": (
        lambda: run(counts=np.rint(2000 * np.abs((T / 2) % 2 - 1))), "viscous friction", "its speeds differ by"
    ),
    "constant": (lambda: run(current=0 * T + 0.2), "delay and lag", "the command never changes"),
    "slow": (lambda: run(current=0.3 * np.sin(T)), "delay and lag", "the command has nothing above 0."),
    "closed": (
        lambda: run(counts=np.rint(5000 * np.sin(2 * np.pi * (1 + 2 * T) * T)),
                    current=-1e-4 * np.rint(5000 * np.sin(2 * np.pi * (1 + 2 * T) * T))),
        "delay and lag", "% of the command is a law of the position: a closed loop",
    ),
    "short travel": (lambda: run(counts=np.rint(400 * WIDE)), "ripple in angle", "of a turn"),
    "rounded": (
        lambda: run(time_s=np.round(np.arange(N) / 997.0, 3)), "times within a period", "its stamps lie on a grid of 1 ms"
    ),
    "lost": (
        lambda: run(*(np.delete(values, range(778, 782)) for values in (T, np.rint(5000 * WIDE), DRIVE))),
        "what happened in lost rows", "4 are missing",
    ),
    "short": (
        lambda: run(T[:3000], np.rint(5000 * WIDE[:3000]), DRIVE[:3000]), "small effects", "3 s are too short"
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", POOR)
def test_what_is_missing_is_said_with_its_reason(name: str) -> None:
    make, what, why = POOR[name]
    assert why in lacks(make())[what]
    assert inspect(make()).next_experiment is not None


def test_saturation_and_lateness() -> None:
    late = np.zeros(N, np.int64)
    late[5] = 123_000
    found = inspect(run(current=np.clip(DRIVE, -0.2, 0.2), wake_late_ns=late))
    assert found.current["saturated"]
    assert "current limit" in found.can_tell
    assert found.stamps["late_max_s"] == pytest.approx(123e-6)


def test_what_is_no_recording_is_refused() -> None:
    with pytest.raises(RunFileError, match="a clock that does not rise"):
        inspect(run(time_s=T[::-1]))
    with pytest.raises(RunFileError, match="5 rows"):
        inspect(run(T[:5], T[:5], T[:5]))
