"""What a release did, from its recording: a shaft that friction holds has not come to rest, it never moved."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hapticd.record import RunWriter
from hapticd.record.schema import FLAG_RUNNING
from hapticd.service.experiments import release_result
from tests.record.record_samples import CONFIG, make_rows


@pytest.mark.parametrize(("moves", "held"), [(0, True), (3, False)])
def test_held_by_friction_is_told_from_coming_to_rest(moves: int, held: bool, tmp_path: Path) -> None:
    rows = make_rows(1000)
    rows["encoder_counts"] = 50 - np.minimum(np.arange(1000), moves)
    rows["flags"] = FLAG_RUNNING
    with RunWriter(tmp_path / "run.arrow", {"config": CONFIG}) as writer:
        writer.write(rows)
    found = release_result(tmp_path / "run.arrow", 10, 0, 0)
    assert (found["held_by_friction"], found["outcome"]) == (held, "decaying")
    assert found["rest"]["after_periods"] == moves
