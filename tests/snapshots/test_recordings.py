"""What the commands that read recordings say of the same two releases, and of what power cuts and disks do to them."""

from __future__ import annotations

import csv
import json
import os
import re
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from mcap.reader import make_reader
from scipy.io import loadmat
from syrupy.assertion import SnapshotAssertion

from hapticd.record.mcap import LAYOUT
from tests.cli.conftest import Outcome, Run

RELEASE = ("--deflection", "20.3", "--set", "encoder.decimation=217")
WRITTEN_S = 1_700_000_000
LEFT_OUT = ("size", "layout", "balance_residual_J")
"""Bytes, which grow with the versions in a file's metadata; a path of the installation; the error of rounding."""


@pytest.fixture
def recordings(hapticd: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Two releases, the second with more friction; and a longer one, cut short, and with a flipped bit in row 1500."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TZ", "UTC")
    time.tzset()
    for name, viscous in (("one", "9e-6"), ("two", "1.2e-5")):
        more = ("--duration", "0.5", "--set", f"plant.viscous={viscous}")
        assert hapticd("simulate", *RELEASE, *more, "-o", f"{name}.arrow").code == 0
    assert hapticd("simulate", *RELEASE, "--duration", "2.5", "-o", "cut.arrow").code == 0
    data = bytearray(Path("cut.arrow").read_bytes())
    Path("cut.arrow").write_bytes(data[: 9 * len(data) // 10])
    data[data.index(np.arange(1500, 1502).tobytes())] ^= 1
    Path("damaged.arrow").write_bytes(data)
    for at, name in enumerate(("damaged", "cut", "one", "two")):
        os.utime(f"{name}.arrow", (WRITTEN_S + at, WRITTEN_S + at))
    yield
    monkeypatch.undo()
    time.tzset()


def _said(outcome: Outcome) -> dict[str, Any]:
    """Exit code and both streams, without what depends on the place, the versions or the last bit."""
    out: Any = _plain(outcome.document) if outcome.out.startswith("{") else _lines(outcome.out)
    return {"code": outcome.code, "stdout": out, "stderr": _lines(outcome.err)}


def _plain(document: Any) -> Any:
    if isinstance(document, list):
        return [_plain(item) for item in document]
    if not isinstance(document, dict):
        return document
    return {key: key if key in LEFT_OUT else _plain(value) for key, value in document.items()}


def _lines(text: str) -> list[str]:
    return re.sub(r" +[\d.]+ [kM]B", " size", text).replace(str(LAYOUT), "layout").splitlines()


WORDS = [
    ("energy", "one.arrow"),
    ("plot", "one.arrow", "--only", "trace", "-o", "one.svg"),
    ("plot", "one.arrow", "two.arrow", "--only", "difference", "-o", "both.svg"),
    ("plot", "one.arrow", "--only", "difference"),
    ("runs", "."),
    ("runs", ".", "--number", "1"),
    ("verify", "one.arrow"),
    ("verify", "cut.arrow"),
    ("verify", "damaged.arrow"),
    ("verify", "no.arrow"),
    ("export", "damaged.arrow", "--to", "csv"),
    ("export", "damaged.arrow", "--to", "csv", "--salvage"),
    ("export", "cut.arrow", "--to", "parquet"),
    ("export", "one.arrow", "--to", "mcap"),
]


@pytest.mark.usefixtures("recordings")
@pytest.mark.parametrize("words", WORDS, ids=" ".join)
def test_words(hapticd: Run, snapshot: SnapshotAssertion, words: tuple[str, ...]) -> None:
    """As text and as JSON."""
    text = _said(hapticd(*words))
    if words[0] in ("export", "plot"):
        words = (*words, "--force")
    assert {"text": text, "json": _said(hapticd(*words, "--json"))} == snapshot


@pytest.mark.usefixtures("recordings")
@pytest.mark.parametrize("form", ["csv", "parquet", "mat", "mcap"])
def test_export(hapticd: Run, snapshot: SnapshotAssertion, form: str) -> None:
    """Names, types and units as other programs find them."""
    assert hapticd("export", "one.arrow", "--to", form, "-o", f"out.{form}").code == 0
    assert {"csv": _csv, "parquet": _parquet, "mat": _mat, "mcap": _mcap}[form](Path(f"out.{form}")) == snapshot


def _csv(path: Path) -> dict[str, Any]:
    head, *rows = csv.reader(path.read_text().splitlines())
    some = [[float(value) if value else None for value in row[:-1]] for row in rows[:3]]
    return {"head": ",".join(head), "rows": len(rows), "first": some, "metadata": sorted(json.loads(rows[0][-1]))}


def _parquet(path: Path) -> dict[str, Any]:
    table = pq.read_table(path)
    columns = {field.name: f"{field.type}, {_text(field.metadata)['unit']}" for field in table.schema}
    return {"columns": columns, "rows": table.num_rows, "metadata": sorted(_text(table.schema.metadata))}


def _text(metadata: dict[bytes, bytes] | None) -> dict[str, str]:
    return {key.decode(): value.decode() for key, value in (metadata or {}).items()}


def _mat(path: Path) -> dict[str, Any]:
    found = loadmat(path)
    metadata = found.pop("hapticd")
    arrays = {name: f"{array.dtype} {array.shape}" for name, array in found.items() if not name.startswith("__")}
    return {"arrays": arrays, "metadata": list(metadata.dtype.names)}


def _mcap(path: Path) -> dict[str, Any]:
    with path.open("rb") as file:
        reader = make_reader(file)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        schemas = {schema.name: schema.data.decode().splitlines() for schema in summary.schemas.values()}
        channels = [[channel.topic, channel.message_encoding] for channel in summary.channels.values()]
        metadata = {record.name: sorted(record.metadata) for record in reader.iter_metadata()}
    messages = summary.statistics.message_count
    return {"schemas": schemas, "channels": channels, "metadata": metadata, "messages": messages}
