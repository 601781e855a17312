"""How outputs are written down: JSON, numbers to nine digits, so that another libm's last bit is no difference."""

from __future__ import annotations

import re
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
    """Floats to nine significant digits; what a clock measured or chaos counted is left out, its key stays."""
    if isinstance(data, float):
        return float(f"{data:.9g}")
    if isinstance(data, str):
        return without_counts(data)
    if isinstance(data, dict):
        named = {**dict.fromkeys(WALL_CLOCK, "measured")}
        if isinstance(data.get("explored"), dict):
            named["explored"] = sorted(data["explored"])
        return {key: named.get(key) or rounded(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [rounded(value) for value in data]
    return data


def without_counts(text: str) -> str:
    """What became of thousands of starts hangs on the last bit of each: the sentences about it lose their numbers."""
    text = re.sub(r"(?<=[Ss]imulated exactly, ).*?(?=\n\n|$)", "…", text, flags=re.DOTALL)
    text = re.sub(r"(?<=starts end in).*(\n {18}.*)*", " …", text)
    return re.sub(r"(?<=To see one of them: hapticd simulate).*", " …", text)


@pytest.fixture
def snapshot(snapshot: SnapshotAssertion) -> SnapshotAssertion:
    """The committed output; `pytest tests/snapshots --snapshot-update` writes it anew."""
    return snapshot.use_extension(_Rounded)
