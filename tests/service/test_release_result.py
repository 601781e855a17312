"""What a release did, from its recording: a shaft that friction holds has not come to rest, it never moved."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hapticd.record import RunWriter
from hapticd.record.schema import FLAG_RUNNING
from hapticd.service.jobs import release_result
from hapticd.servo import faults
from tests.record.record_samples import CONFIG, make_rows


def result_of(counts: np.ndarray, folder: Path, fault: int) -> dict[str, Any]:
    """What is said of a release that these counts recorded, about an origin of 0 and with ticks of 10 counts."""
    rows = make_rows(len(counts))
    rows["encoder_counts"] = counts
    rows["flags"] = FLAG_RUNNING
    with RunWriter(folder / "run.arrow", {"config": CONFIG}) as writer:
        writer.write(rows)
    return release_result(folder / "run.arrow", 10, 0, fault)


@pytest.mark.parametrize("fault", [faults.OVER_SPEED, faults.EXCURSION, faults.OVER_CURRENT, faults.ENCODER_JUMP])
@pytest.mark.parametrize(("growth", "outcome"), [(-1.0, None), (0.0, None), (1.0, "growing")])
def test_a_trip_alone_is_no_growth(growth: float, outcome: str | None, fault: int, tmp_path: Path) -> None:
    time = np.arange(900) / 1000.0
    counts = np.floor(400.0 * np.exp(growth * time) * np.cos(30.0 * time)).astype(int)
    assert result_of(counts, tmp_path, fault)["outcome"] == outcome


@pytest.mark.parametrize(("moves", "held"), [(0, True), (3, False)])
def test_held_by_friction_is_told_from_coming_to_rest(moves: int, held: bool, tmp_path: Path) -> None:
    found = result_of(50 - np.minimum(np.arange(1000), moves), tmp_path, 0)
    assert (found["held_by_friction"], found["outcome"]) == (held, "decaying")
    assert found["rest"]["after_periods"] == moves
