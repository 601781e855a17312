from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from record_samples import CONFIG, Ring

from hapticd.record import Recorder


@pytest.fixture
def ring() -> Ring:
    return Ring()


@pytest.fixture
def recorder(ring: Ring, tmp_path: Path) -> Iterator[Recorder]:
    made = Recorder(ring.drain, lambda: ring.lost, ring.history, lambda: {"config": CONFIG}, tmp_path / "runs")
    yield made
    made.shutdown()
