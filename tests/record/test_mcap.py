"""MCAP: read back bit for bit, by hapticd and by two readers that know nothing of it."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from record_samples import CONFIG, make_rows

from hapticd.record import Run, RunFileError, RunWriter, export, import_mcap, read_run, run_metadata
from hapticd.record.mcap import LAYOUT, MESSAGE, TOPIC, definition, field_names, messages_of

EVENTS = [
    {"row": 5, "event": "set", "changed": {"spring.stiffness": 0.02}},
    {"row": 40, "event": "dropped", "rows": 3},
    {"row": 300, "event": "end", "rows": 300, "dropped": 3},
]


@pytest.fixture
def run(tmp_path: Path) -> Run:
    """A native run with NaN, infinity, numbers to their last bit, and events."""
    rows = make_rows(300)
    rows["current_measured_A"][::3] = 0.1
    rows["force_command"][7] = np.inf
    rows["encoder_counts"][9] = -(2**62) - 1
    path = tmp_path / "run.arrow"
    with RunWriter(path, {**run_metadata(CONFIG), "kind": "run", "label": "release"}) as writer:
        written = 0
        for event in EVENTS:
            writer.write(rows[written : event["row"]])
            written = event["row"]
            writer.annotate({key: value for key, value in event.items() if key != "row"})
    return read_run(path)


@pytest.fixture
def exported(run: Run) -> Path:
    return export(run, "mcap")


def equal(left: Run, right: Run) -> None:
    assert list(left.columns) == list(right.columns)
    for name, values in left.columns.items():
        assert values.dtype == right.columns[name].dtype
        np.testing.assert_array_equal(values.view(np.int64), right.columns[name].view(np.int64), err_msg=name)
    assert left.metadata == right.metadata
    assert left.units == right.units
    assert left.events == right.events
    assert left.truncated == right.truncated


def test_read_back_it_is_the_same_run(run: Run, exported: Path) -> None:
    assert run.events == EVENTS
    equal(read_run(exported), run)


def test_imported_it_is_the_same_native_file(run: Run, exported: Path, tmp_path: Path) -> None:
    found = import_mcap(exported, tmp_path / "back.arrow")
    equal(replace(read_run(found.path), path=run.path), run)
    assert found.rows == 300
    assert found.resolution == pytest.approx(2 * np.pi / 8192)


def test_the_source_is_never_overwritten(exported: Path) -> None:
    before = exported.read_bytes()
    with pytest.raises(FileExistsError, match="is the file that is read; give another name"):
        import_mcap(exported, exported, force=True)
    assert exported.read_bytes() == before


def test_mcap_ros2_support_reads_it(run: Run, exported: Path) -> None:
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    with exported.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        messages = list(reader.iter_decoded_messages())
    assert len(messages) == run.rows
    for name, field in field_names(run.columns).items():
        values = np.array(
            [getattr(message.decoded_message, field) for message in messages], dtype=run.columns[name].dtype
        )
        np.testing.assert_array_equal(values, run.columns[name], err_msg=name)
    first = messages[0]
    assert (first.channel.topic, first.channel.message_encoding) == (TOPIC, "cdr")
    assert (first.schema.name, first.schema.encoding) == (MESSAGE, "ros2msg")
    steps = np.diff([message.message.log_time for message in messages])
    np.testing.assert_array_equal(steps, np.full(299, 1_000_000))


def test_rosbags_reads_it(run: Run, exported: Path) -> None:
    from rosbags.rosbag2.storage_mcap import McapReader
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.EMPTY)
    reader = McapReader(exported)
    reader.open()
    try:
        definitions = {schema.name: schema.data for schema in reader.schemas.values()}
        store.register(get_types_from_msg(definitions[MESSAGE], MESSAGE))
        found = [store.deserialize_cdr(data, MESSAGE) for _, _, data in reader.messages(list(reader.connections))]
    finally:
        reader.close()
    assert len(found) == run.rows
    for name, field in field_names(run.columns).items():
        values = np.array([getattr(message, field) for message in found], dtype=run.columns[name].dtype)
        np.testing.assert_array_equal(values, run.columns[name], err_msg=name)


def test_metadata_hold_config_and_provenance(run: Run, exported: Path) -> None:
    from mcap.reader import make_reader

    with exported.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        (record,) = reader.iter_metadata()
        assert reader.get_header().profile == "ros2"
    assert record.name == "hapticd"
    assert json.loads(record.metadata["hapticd.config"]) == run.metadata["config"]
    assert json.loads(record.metadata["hapticd.units"])["current_command_A"] == "A"
    assert {f"hapticd.{key}" for key in ("versions", "host", "created_utc", "model")} <= set(record.metadata)


def test_the_definition_has_lower_case_fields_with_units(run: Run) -> None:
    lines = definition(run.columns, run.units).splitlines()
    assert "float64 current_command_a  # A; current commanded to the amplifier in this tick, after limits and " in (
        lines[5] + " "
    )
    assert "float64 time_s  # s; time at which the tick was due, from the start of the servo loop" in lines
    assert [line.split()[1] for line in lines[1:]] == [name.lower() for name in run.columns]


def test_names_that_ros_does_not_take_are_changed_and_stay_apart() -> None:
    found = field_names(dict.fromkeys(["time_s", "Kraft (N)", "kraft_n", "2nd", "a__b_"]))
    assert list(found.values()) == ["time_s", "kraft_n", "kraft_n_2", "x2nd", "a_b"]


def test_a_message_is_the_row_behind_a_header() -> None:
    rows = make_rows(60_000)
    columns = {name: np.ascontiguousarray(rows[name]) for name in rows.dtype.names or ()}
    messages = messages_of(columns)
    assert messages.shape == (60_000, 84)
    assert messages[7].tobytes() == b"\x00\x01\x00\x00" + rows[7].tobytes()


def test_columns_from_elsewhere_are_kept(tmp_path: Path) -> None:
    columns: dict[str, Any] = {
        "time_s": np.array([0.0, 0.5]),
        "position": np.array([1.5, 2.5]),
        "force": np.array([0.0, np.nan]),
        "Mode": np.array([1, 2], dtype=np.int16),
    }
    back = read_run(export(Run(tmp_path / "x.csv", columns), "mcap"))
    for name, values in columns.items():
        np.testing.assert_array_equal(back.columns[name], values)
    with pytest.raises(RunFileError, match="has no column tick, encoder_counts"):
        import_mcap(back.path, tmp_path / "y.arrow")
    assert not (tmp_path / "y.arrow").exists()


@pytest.mark.parametrize(
    ("name", "values", "said"),
    [
        ("note", np.array(["a", "b"]), "column note holds"),
        ("time_s", np.array([0.0, np.nan]), "time_s holds values that are not finite"),
    ],
)
def test_what_mcap_cannot_hold_is_refused_and_leaves_nothing(
    tmp_path: Path, name: str, values: np.ndarray, said: str
) -> None:
    columns: dict[str, Any] = {"time_s": np.arange(2.0), "position": np.zeros(2), "force": np.zeros(2), name: values}
    with pytest.raises(RunFileError, match=said):
        export(Run(tmp_path / "x.csv", columns), "mcap")
    assert list(tmp_path.iterdir()) == []


def test_what_is_no_recording_of_hapticd_says_so(exported: Path, tmp_path: Path) -> None:
    from mcap.writer import Writer

    other = tmp_path / "other.mcap"
    with other.open("wb") as file:
        writer = Writer(file)
        writer.start()
        writer.finish()
    with pytest.raises(RunFileError, match="is no recording of hapticd"):
        read_run(other)
    whole = exported.read_bytes()
    for content in (whole[: len(whole) // 2], b"no mcap at all", whole[:200] + b"\xff" * 50 + whole[250:]):
        other.write_bytes(content)
        with pytest.raises(RunFileError, match=r"is not a readable MCAP file|is damaged|no recording"):
            read_run(other)


def test_every_curve_of_the_layout_is_a_field(run: Run) -> None:
    fields = {f"{TOPIC}/{field}" for field in field_names(run.columns).values()}
    root = ET.parse(LAYOUT).getroot()
    assert root.tag == "root"
    curves = list(root.iter("curve"))
    named = {curve.get("curve_x") or curve.get("name") for curve in curves} | {
        curve.get("curve_y") for curve in curves if curve.get("curve_y")
    }
    assert named <= fields
    assert len(named) >= 7
    assert [tab.get("tab_name") for tab in root.iter("Tab")] == ["Motion", "Spring", "Timing"]
