from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from record_samples import CONFIG

from hapticd.record import host_facts, run_metadata, versions
from hapticd.record.metadata import decode_metadata, encode_metadata
from hapticd.record.schema import COLUMNS, FLAG_MEANINGS, ROW


def test_importing_the_package_loads_no_arrow_scipy_or_numba() -> None:
    code = "import sys, hapticd.record; print(sorted({'pyarrow', 'scipy', 'numba'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True, text=True)
    assert done.stdout.strip() == "[]"


def test_rows_are_ten_words_of_eight_bytes_as_published() -> None:
    published = (
        "tick time_s encoder_counts ticks current_command_A current_measured_A force_command wake_late_ns exec_ns flags"
    )
    assert list(ROW.names or ()) == published.split() == [column.name for column in COLUMNS]
    assert ROW.itemsize == 80
    assert all(ROW[name].itemsize == 8 for name in ROW.names or ())
    assert all(column.unit and column.description for column in COLUMNS)


def test_versions_and_host_facts_name_what_shapes_a_run() -> None:
    assert {"python", "hapticd", "numpy", "numba", "pyarrow"} <= versions().keys()
    assert versions()["numpy"] == np.__version__
    facts = host_facts()
    assert {"hostname", "kernel", "kernel_realtime", "machine", "cpu", "cpu_count", "clocksource"} <= facts.keys()
    assert json.loads(json.dumps(facts)) == facts


def test_host_facts_survive_a_machine_that_tells_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(self: Path, *_: object, **__: object) -> str:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "read_text", refuse)
    facts = host_facts.__wrapped__()
    assert facts["cpu"] is None
    assert facts["kernel_realtime"] is False


def test_run_metadata_names_the_model_and_the_kind_of_device() -> None:
    rotary = run_metadata(CONFIG, config_digest="abc")
    assert rotary["model"] == {"plant": CONFIG["plant"], "encoder": CONFIG["encoder"]}
    assert (rotary["linear"], rotary["config_digest"], rotary["format_version"]) == (False, "abc", 2)
    assert run_metadata({"encoder": {"counts_per_metre": 1e5}})["linear"] is True
    assert run_metadata(CONFIG, model={"plant": {}}, linear=True)["model"] == {"plant": {}}


def test_metadata_of_any_kind_becomes_strict_json_and_comes_back() -> None:
    odd = {"a": np.float64(1.5), "b": (1, None), "c": Path("/x"), "d": float("nan"), "e": {1: np.arange(2)}, "ü": True}
    stored = encode_metadata(odd)
    assert stored[b"hapticd.d"] == b'"nan"'
    expected = {"a": 1.5, "b": [1, None], "c": "/x", "d": "nan", "e": {"1": [0, 1]}, "ü": True}
    assert decode_metadata({**stored, b"pandas": b"{}"}) == expected
    assert decode_metadata({b"hapticd.note": b"not json"}) == {"note": "not json"}
    assert decode_metadata(None) == {}


def test_the_reference_page_and_the_schema_agree() -> None:
    page = (Path(__file__).parents[2] / "docs" / "reference" / "run-files.md").read_text(encoding="utf-8")
    for column in COLUMNS:
        assert f"| `{column.name}` | {ROW[column.name].name} | {column.unit} |" in page
        if column.name != "flags":
            assert column.description in page
    for bit, meaning in FLAG_MEANINGS.items():
        assert f"| {bit} | {meaning} |" in page
