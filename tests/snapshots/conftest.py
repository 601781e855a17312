"""How outputs are written down: JSON, numbers to nine digits, so that another libm's last bit is no difference."""

from __future__ import annotations

from typing import Any

import pytest
from syrupy.assertion import SnapshotAssertion
from syrupy.extensions.json import JSONSnapshotExtension

from tests.cli.conftest import hapticd

__all__ = ["hapticd"]

WALL_CLOCK = ("wall_s", "ticks_per_s", "seconds")


class _Rounded(JSONSnapshotExtension):
    """JSON with keys in the order in which they were given."""

    def serialize(self, data: Any, **options: Any) -> str:
        """The text of a file."""
        return super().serialize(rounded(data), **options)


def rounded(data: Any) -> Any:
    """Floats to nine significant digits; what a clock measured is left out, its key stays."""
    if isinstance(data, float):
        return float(f"{data:.9g}")
    if isinstance(data, dict):
        return {key: "measured" if key in WALL_CLOCK else rounded(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [rounded(value) for value in data]
    return data


@pytest.fixture
def snapshot(snapshot: SnapshotAssertion) -> SnapshotAssertion:
    """The committed output; `pytest tests/snapshots --snapshot-update` writes it anew."""
    return snapshot.use_extension(_Rounded)
