"""Run files with checksums: every flipped bit is found, named by its rows, and costs only its batch."""

from __future__ import annotations

import random
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from record_samples import make_rows

from hapticd.cli.main import main
from hapticd.record import RunFileError, RunWriter, read_run, verify
from hapticd.record.stream import Damage

BATCH, BATCHES = 16, 8
ROWS = BATCH * BATCHES


@pytest.fixture
def run(tmp_path: Path) -> Path:
    with RunWriter(tmp_path / "run.arrow", {}) as writer:
        for first in range(0, ROWS, BATCH):
            writer.write(make_rows(BATCH, first))
            writer.flush()
    return writer.path


def value_at(data: bytes, tick: int) -> int:
    """Where the counts of a row lie."""
    return data.index(np.array([-3 * tick, -3 * tick - 3], np.int64).tobytes())


def flip(path: Path, at: int, bit: int = 0) -> None:
    data = bytearray(path.read_bytes())
    data[at] ^= 1 << bit
    path.write_bytes(data)


def test_a_whole_file_verifies(run: Path) -> None:
    verdict = verify(run)
    assert (verdict.version, verdict.rows, verdict.damage_text, verdict.whole) == (2, ROWS, [], True)
    assert main(["verify", str(run)]) == 0


def test_a_flipped_bit_is_an_error_that_names_its_rows_and_the_rest_is_kept(
    run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    flip(run, value_at(run.read_bytes(), 3 * BATCH + 5), 7)
    with pytest.raises(RunFileError, match=r"run\.arrow is damaged: rows 48 to 63 do not match their checksum"):
        read_run(run)
    left = read_run(run, salvage=True)
    assert left.damage == (Damage(48, 64),)
    assert left.columns["tick"].tolist() == [tick for tick in range(ROWS) if not 48 <= tick < 64]
    assert "rows 48 to 63" in left.warnings[0]
    assert main(["verify", str(run)]) == 1
    assert "rows 48 to 63" in capsys.readouterr().out
    assert main(["export", str(run), "--to", "csv"]) == 2
    assert main(["export", str(run), "--to", "csv", "--salvage"]) == 0
    exported = read_run(run.with_suffix(".csv"))
    assert exported.rows == ROWS - BATCH
    assert {"event": "damaged", "first_row": 48, "end_row": 64} in exported.events


def test_no_flipped_bit_goes_unseen(run: Path) -> None:
    whole = read_run(run)
    data = run.read_bytes()
    chance = random.Random(4)
    harmless = 0
    for at in sorted(chance.sample(range(len(data)), 150)):
        damaged = bytearray(data)
        damaged[at] ^= 1 << chance.randrange(8)
        run.write_bytes(damaged)
        try:
            found = read_run(run)
        except RunFileError:
            continue
        # Padding, or the end of the file: what is there is what was written.
        harmless += 1
        for name, values in found.columns.items():
            assert values.tobytes() == whole.columns[name][: found.rows].tobytes(), (at, name)
        assert found.metadata == whole.metadata, at
        assert found.rows == ROWS or found.truncated, at
    assert harmless < 75


def test_a_batch_whose_frame_is_destroyed_costs_that_batch_alone(run: Path) -> None:
    data = run.read_bytes()
    source = pa.BufferReader(data)
    stream = pa.ipc.open_stream(source)
    ends = []
    for _ in range(BATCHES + 1):
        stream.read_next_batch()
        ends.append(source.tell())
    run.write_bytes(data[: ends[2]] + bytes(ends[3] - ends[2]) + data[ends[3] :])
    left = read_run(run, salvage=True)
    assert left.damage == (Damage(2 * BATCH, 3 * BATCH),)
    assert left.rows == ROWS - BATCH


def test_a_flip_in_the_description_is_named(run: Path) -> None:
    flip(run, run.read_bytes().index(b"created_utc") + 30)
    with pytest.raises(RunFileError, match=r"its description .* does not match its checksum"):
        read_run(run)
    assert verify(run).metadata_damaged
    assert read_run(run, salvage=True).rows == ROWS


def test_the_last_rows_count_too(run: Path) -> None:
    flip(run, value_at(run.read_bytes(), ROWS - 2))
    assert verify(run).damage == [Damage(ROWS - BATCH, ROWS)]


@pytest.mark.parametrize("seed", range(20))
def test_pages_that_a_power_cut_kept_from_the_disk_cost_their_batches(run: Path, seed: int) -> None:
    """What was synced is there; of what came after, any page may be zero, and the file may be shorter."""
    with RunWriter(run.with_name("long.arrow"), {}) as writer:
        for first in range(0, 4096, BATCH):
            writer.write(make_rows(BATCH, first))
            writer.flush()
    whole = writer.path.read_bytes()
    data = bytearray(whole)
    chance = random.Random(seed)
    synced = 30 * 4096
    torn = [page for page in range(synced, len(data), 4096) if chance.random() < 0.3]
    for page in torn:
        data[page : page + 4096] = bytes(len(data[page : page + 4096]))
    del data[chance.randrange(torn[0], len(data)) :]
    writer.path.write_bytes(data)
    left = read_run(writer.path, salvage=True)
    ticks = left.columns["tick"]
    assert left.truncated
    assert np.all(np.diff(ticks) > 0)
    assert np.array_equal(left.columns["encoder_counts"], -3 * ticks)
    lost = {row for part in left.damage for row in range(part.first_row, part.end_row or 0)}
    assert set(ticks.tolist()) == set(range(int(ticks[-1]) + 1)) - lost
    writer.path.write_bytes(whole[: torn[0]])
    assert set(range(read_run(writer.path).rows)) <= set(ticks.tolist())


def test_compressed_values_are_refused_before_they_are_unpacked(tmp_path: Path) -> None:
    path = tmp_path / "bomb.arrow"
    schema = pa.schema([(name, pa.float64()) for name in ("time_s", "position", "force")])
    options = pa.ipc.IpcWriteOptions(compression="zstd")
    with pa.OSFile(str(path), "wb") as sink, pa.ipc.new_stream(sink, schema, options=options) as stream:
        stream.write_batch(pa.RecordBatch.from_arrays([np.zeros(1 << 20)] * 3, schema=schema))
    assert path.stat().st_size < 10_000
    before = pa.total_allocated_bytes()
    run = read_run(path)
    assert (run.rows, run.truncated) == (0, True)
    assert pa.total_allocated_bytes() - before < 1 << 20
