"""Every loader under mutated and forged files; ``python -m tests.hostile`` tries as many more of the same as one likes."""

from __future__ import annotations

import io
import os
import signal
import socket
import struct
import subprocess
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import zstandard
from mcap.records import Chunk
from mcap.stream_reader import StreamReader
from scipy.io import loadmat, savemat

from drivers import DriverConfigError
from drivers.canopen.eds import load_eds
from drivers.canopen.profile import FOLDER
from hapticd.config import ConfigError, load_config, parse_yaml
from hapticd.record import RunFileError, read_run
from hapticd.record.listing import listed
from hapticd.record.matfile import read_mat

from ..docs.snippets import ROOT
from . import isolation
from .loaders import LOADERS, Loader

BY_NAME = {loader.name: loader for loader in LOADERS}
NAMES = sorted(BY_NAME)


@pytest.mark.parametrize("name", NAMES)
def test_what_is_mutated_is_accepted_as_it_is(tmp_path: Path, name: str) -> None:
    loader = BY_NAME[name]
    for number, data in enumerate(loader.samples()):
        path = tmp_path / f"{number}{loader.suffix}"
        path.write_bytes(data)
        loader.load(path)


@pytest.mark.parametrize(
    ("count", "seed"), [(20, 17), pytest.param(2000, 7, marks=[pytest.mark.attack, pytest.mark.timeout(3600)])]
)
def test_no_input_ends_otherwise_than_in_a_result_or_a_clear_error(count: int, seed: int) -> None:
    command = [sys.executable, "-m", "tests.hostile", "--count", str(count * len(LOADERS)), "--seed", str(seed)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.count(f": {count} inputs, ") == done.stdout.count(", 0 findings; ") == len(LOADERS)


def test_a_finding_is_told_with_its_case(tmp_path: Path) -> None:
    def load(path: Path) -> None:
        case = int(path.read_bytes())
        if case == 2:
            os.kill(os.getpid(), signal.SIGKILL)
        raise [ValueError, KeyError(case), RunFileError("elsewhere"), RunFileError("case")][case]

    loader = Loader("odd", ".txt", load, (RunFileError,), lambda: [b""])
    object.__setattr__(loader, "case", lambda seed, number: b"%d" % (number % 4))
    found = isolation.run(loader, 0, 4, 0)
    assert [case for case, _ in found.findings] == [0, 1, 2]
    assert (found.accepted, found.refused) == (0, 1)
    assert "ValueError" in found.findings[0][1]
    assert found.findings[2][1] == "the process ended with SIGKILL"


@pytest.fixture
def odd_paths(tmp_path: Path) -> Path:
    """Paths that are no files, without their suffix."""
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "folder").mkdir()
    (tmp_path / "loop").symlink_to(tmp_path / "other")
    (tmp_path / "other").symlink_to(tmp_path / "loop")
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(tmp_path / "socket"))
    return tmp_path


FOUND = (
    ("run", b"\xff\xff\xff\xff\0\0\0\0"),
    ("import-csv", 1001, 2911),
    ("import-mat", struct.pack("<5i2s3d", 4000, 3, 1, 0, 2, b"t\0", 0.0, 1.0, 2.0)),
    ("import-mat", 7, 5545),
    ("import-mat", 7, 14019),
    ("import-mat", 7, 37415),
    ("import-npy", 7, 29613),
    ("import-npy", 7, 42554),
    ("mcap", 1001, 1043),
)
"""What mutation has found once, by loader: bytes, or seed and case of the loader's own."""


@pytest.mark.parametrize("found", FOUND, ids=[f"{found[0]}-{found[-1]!r:.8}" for found in FOUND])
def test_what_was_found_once_is_refused(tmp_path: Path, found: tuple[Any, ...]) -> None:
    loader = BY_NAME[found[0]]
    path = tmp_path / f"case{loader.suffix}"
    path.write_bytes(found[1] if len(found) == 2 else loader.case(*found[1:]))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(loader.errors, match="case"):
            loader.load(path)


def test_a_signalling_nan_is_read_as_any_other(tmp_path: Path) -> None:
    signalling = np.array([0x3F800000, 0x7F800001], "u4").view("f4")
    columns = {"tick": [0, 1], "time_s": [0.0, 1e-3], "position": signalling, "current_command_A": [0.0, 0.0]}
    path = tmp_path / "case.parquet"
    pq.write_table(pa.table(columns), path)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        np.testing.assert_array_equal(read_run(path).columns["position"], [1.0, np.nan])


def test_a_counter_that_64_bits_with_a_sign_do_not_hold_is_refused(tmp_path: Path) -> None:
    columns = {"tick": np.array([0, 1 << 63], "u8"), "time_s": [0.0, 1e-3], "position": [0.0, 0.0]}
    path = tmp_path / "case.parquet"
    pq.write_table(pa.table({**columns, "current_command_A": [0.0, 0.0]}), path)
    with pytest.raises(RunFileError, match=r"tick must hold whole numbers.* more than the 64 bits"):
        read_run(path)


@pytest.mark.timeout(30)
@pytest.mark.parametrize("text", ["x" * 150_000, "!odd " + "9" * 150_000], ids=["text", "no number"])
def test_a_long_text_that_aliases_repeat_is_quoted_as_far_as_it_is_shown(tmp_path: Path, text: str) -> None:
    path = tmp_path / "case.yaml"
    path.write_text(f"x: &a {text}\nservo: [{', '.join(['*a'] * 19_000)}]\n")
    with pytest.raises(ConfigError, match="case") as refused:
        load_config(path)
    assert len(str(refused.value)) < 20_000


@pytest.mark.timeout(30)
@pytest.mark.parametrize("name", NAMES)
def test_what_is_no_file_is_refused_at_once(odd_paths: Path, name: str) -> None:
    loader: Loader = BY_NAME[name]
    targets = [*(odd_paths / kind for kind in ("pipe", "folder", "loop", "socket", "nothing")), Path("/dev/zero")]
    for target in targets:
        path = odd_paths / f"to-{target.name}{loader.suffix}"
        path.symlink_to(target)
        with pytest.raises((*loader.errors, AssertionError) if name == "flight" else loader.errors):
            loader.load(path)


def test_a_list_of_recordings_passes_over_what_is_none(odd_paths: Path) -> None:
    for kind, words in (("pipe", "a pipe"), ("folder", "a folder")):
        assert words in (listed(odd_paths / kind).error or "")


# Arrow


def arrow_file(path: Path, columns: dict[str, Any], compression: str | None = None, **metadata: str) -> Path:
    batch = pa.RecordBatch.from_pydict(columns)
    schema = batch.schema.with_metadata({"hapticd.format_version": "1", **metadata})
    options = pa.ipc.IpcWriteOptions(compression=compression)
    with pa.OSFile(str(path), "wb") as sink, pa.ipc.new_stream(sink, schema, options=options) as stream:
        stream.write_batch(batch.replace_schema_metadata(schema.metadata))
    return path


ZEROS = np.zeros(1 << 20)
LIMIT = "unpacks to more than [1-3] MiB"


@pytest.fixture
def small_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    """1 MiB instead of 256, so that a bomb is packed quickly."""
    monkeypatch.setattr("hapticd.record.sizes.LEAST", 1 << 20)


def test_a_dictionary_cannot_bring_compressed_values_in(tmp_path: Path) -> None:
    columns = {name: np.zeros(1) for name in ("time_s", "position", "force")}
    words = pa.DictionaryArray.from_arrays(pa.array([0], pa.int32()), pa.array(ZEROS))
    path = arrow_file(tmp_path / "bomb.arrow", {**columns, "words": words}, "zstd")
    assert path.stat().st_size < 10_000
    before = pa.total_allocated_bytes()
    with pytest.raises(RunFileError, match="neither numbers nor text"):
        read_run(path)
    assert pa.total_allocated_bytes() - before < 1 << 20


def test_a_list_of_recordings_unpacks_nothing(tmp_path: Path) -> None:
    path = arrow_file(tmp_path / "bomb.arrow", {"time_s": ZEROS}, "zstd")
    before = pa.total_allocated_bytes()
    assert listed(path).rows == 0
    assert pa.total_allocated_bytes() - before < 1 << 20


@pytest.mark.parametrize("text", ["[" * 100_000, "9" * 5000, "[" * 400 + "]" * 400, "5", '{"a": [1]}'])
def test_metadata_may_be_anything(tmp_path: Path, text: str) -> None:
    columns = {name: np.arange(3.0) for name in ("time_s", "position", "force")}
    keys = ("config", "units", "events", "kind", "label", "linear")
    path = arrow_file(tmp_path / "run.arrow", columns, **{f"hapticd.{key}": text for key in keys})
    run = read_run(path)
    assert isinstance(run.metadata.get("config", {}), dict)
    assert (run.rows, run.events) == (3, [])
    assert listed(path).kind in (None, text)


# Parquet, MCAP


@pytest.mark.usefixtures("small_limit")
def test_a_parquet_file_that_unpacks_to_too_much_is_refused_before(tmp_path: Path) -> None:
    path = tmp_path / "bomb.parquet"
    columns = dict.fromkeys(("time_s", "position", "force"), ZEROS)
    pq.write_table(pa.table(columns), path, compression="zstd", use_dictionary=False, data_page_size=1 << 28)
    assert path.stat().st_size < 20_000
    before = pa.total_allocated_bytes()
    with pytest.raises(RunFileError, match=LIMIT):
        read_run(path)
    assert pa.total_allocated_bytes() - before < 1 << 20


@pytest.mark.usefixtures("small_limit")
def test_a_chunk_of_mcap_that_claims_too_much_is_refused_before_it_is_unpacked(tmp_path: Path) -> None:
    data = BY_NAME["mcap"].samples()[0]
    (chunk,) = (
        record for record in StreamReader(io.BytesIO(data), emit_chunks=True).records if isinstance(record, Chunk)
    )
    huge = zstandard.ZstdCompressor().compress(bytes(1 << 23))
    assert len(huge) < 10_000
    records_at = data.index(chunk.data)
    size_at = records_at - 8
    begin = data.index(chunk.compression.encode(), records_at - 20) - 4 - 4 - 8 - 8 - 8
    assert int.from_bytes(data[size_at:records_at], "little") == len(chunk.data)
    grown = len(huge) - len(chunk.data)
    length = int.from_bytes(data[begin - 8 : begin], "little") + grown
    head = data[: begin - 8] + length.to_bytes(8, "little") + data[begin:size_at]
    path = tmp_path / "bomb.mcap"
    path.write_bytes(head + len(huge).to_bytes(8, "little") + huge + data[records_at + len(chunk.data) :])
    with pytest.raises(RunFileError, match=LIMIT):
        read_run(path)


# MATLAB


@pytest.mark.parametrize("packed", [False, True])
def test_matlab_files_are_read_as_scipy_reads_them(tmp_path: Path, packed: bool) -> None:
    contents = {
        "t": np.arange(5.0),
        "matrix": np.arange(6, dtype=np.int16).reshape(2, 3),
        "small": np.array([1, 2], dtype=np.uint8),
        "flag": np.array([True, False]),
        "complex": np.array([1 + 2j, 3.0]),
        "none": np.zeros((0, 4)),
        "text": "µ words",
        "s": {"a": np.ones(3), "deeper": {"b": 2.5, "name": "x"}},
    }
    path = tmp_path / "data.mat"
    savemat(path, contents, do_compression=packed)
    ours, left_out = read_mat(path)
    assert left_out == {}
    theirs = loadmat(path, struct_as_record=False, squeeze_me=True)
    theirs |= {"s.a": theirs["s"].a, "s.deeper.b": theirs["s"].deeper.b, "s.deeper.name": theirs["s"].deeper.name}
    assert ours.keys() == {name for name in theirs if not name.startswith("__")} - {"s"}
    for name, value in ours.items():
        expected = np.asarray(theirs[name])
        assert (value.dtype.kind, value.shape) == (expected.dtype.kind, expected.shape), name
        assert np.array_equal(value, expected), name


def test_what_no_column_can_come_from_is_named(tmp_path: Path) -> None:
    path = tmp_path / "data.mat"
    savemat(path, {"c": np.array([np.ones(2), "x"], dtype=object), "many": [{"a": 1.0}, {"a": 2.0}], "e": {"f": []}})
    found, left_out = read_mat(path)
    assert set(found) == {"c{1}", "c{2}", "many{1}.a", "many{2}.a", "e.f"}
    assert left_out == {}


def test_a_wrong_type_code_is_an_error_and_not_the_end_of_the_process(tmp_path: Path) -> None:
    sink = io.BytesIO()
    savemat(sink, {"t": np.arange(50.0)})
    data = bytearray(sink.getvalue())
    data[data.index(b"\x09\x00\x00\x00\x90\x01")] = 0xC8
    (tmp_path / "data.mat").write_bytes(data)
    with pytest.raises(RunFileError, match=r"data.mat is not a readable .mat file: "):
        read_mat(tmp_path / "data.mat")


@pytest.mark.usefixtures("small_limit")
def test_a_matlab_file_unpacks_up_to_a_limit(tmp_path: Path) -> None:
    savemat(tmp_path / "bomb.mat", {"t": np.zeros(1 << 20)}, do_compression=True)
    assert (tmp_path / "bomb.mat").stat().st_size < 20_000
    with pytest.raises(RunFileError, match=LIMIT):
        read_mat(tmp_path / "bomb.mat")


def test_a_matlab_file_that_asks_for_all_memory_gets_none(tmp_path: Path) -> None:
    sink = io.BytesIO()
    savemat(sink, {"t": np.zeros((3, 7))})
    data = bytearray(sink.getvalue())
    at = data.index((3).to_bytes(4, "little") + (7).to_bytes(4, "little"))
    data[at : at + 8] = (1 << 20).to_bytes(4, "little") + (1 << 18).to_bytes(4, "little")
    (tmp_path / "data.mat").write_bytes(data)
    with pytest.raises(RunFileError, match=r"data.mat (unpacks to more than|is not a readable .mat file)"):
        read_mat(tmp_path / "data.mat")


# EDS, YAML


def test_an_eds_cannot_claim_entries_without_end(tmp_path: Path) -> None:
    path = tmp_path / "drive.eds"
    text = (FOLDER / "copley.eds").read_text()
    path.write_text(f"{text}\n[1600Name]\nNrOfEntries=4294967295\n")
    with pytest.raises(DriverConfigError, match=r"NrOfEntries = 4294967295: must be at most 254"):
        load_eds(path, 1)


def test_an_eds_in_another_code_page_is_read(tmp_path: Path) -> None:
    path = tmp_path / "drive.eds"
    text = (FOLDER / "copley.eds").read_text().replace("[DeviceInfo]", "[DeviceInfo]\n;Verstärker", 1)
    path.write_bytes(text.encode("latin-1"))
    assert 0x1000 in load_eds(path, 1)


@pytest.mark.parametrize("number", ["9" * 400, "0x" + "f" * 5000, "9" * 5000])
def test_a_number_that_no_float_can_be_is_no_number(number: str) -> None:
    with pytest.raises(ConfigError, match="cannot be read as int") as refusal:
        parse_yaml(f"spring: {{stiffness: {number}}}", "lab.yaml")
    assert len(str(refusal.value)) < 200


def test_of_many_problems_the_first_twenty_are_shown() -> None:
    with pytest.raises(ConfigError) as refusal:
        parse_yaml("\n".join(f"k{number}: 1" for number in range(2000)), "lab.yaml")
    lines = str(refusal.value).splitlines()
    assert (len(refusal.value.problems), len(lines), lines[-1]) == (2000, 21, "and 1980 more")
