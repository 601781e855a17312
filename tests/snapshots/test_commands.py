"""What the public commands say, word for word and to nine digits, as committed.

A change here is a change of what users see: `pytest tests/snapshots --snapshot-update`, and the difference goes into the
review. The command line's help and the control API's document have pages of their own that tests keep (docs/reference).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from syrupy.assertion import SnapshotAssertion

from hapticd.record import read_run
from hapticd.servo import faults
from tests.cli.conftest import Run
from tests.snapshots.conftest import without_counts

STRIBECK = "{name: stribeck, s: 0.5, omega_s: 2.0}"
BIAS = "{name: constant_bias, tau_0: 5e-4}"


def _set(section: str, **values: Any) -> tuple[str, ...]:
    return tuple(word for key, value in values.items() for word in ("--set", f"{section}.{key}={value}"))


IDEAL = _set("amplifier", bandwidth_hz=0, dac_bits=0)
FIG8 = {
    "a": (*IDEAL, "--set", "encoder.decimation=217", "--deflection", "20.3"),
    "b": (*IDEAL, "--set", "encoder.decimation=2172", "--deflection", "3.3"),
    "c": (*IDEAL, "--set", "encoder.decimation=217", "--set", "servo.rate_hz=100", "--deflection", "2.3"),
    "d": (*IDEAL, "--set", "encoder.decimation=217", "--set", "servo.rate_hz=100", "--deflection", "10.3"),
}
OTHERS = {
    "testbed": ("--deflection", "500.25"),
    "velocity": ("--velocity", "150.5"),
    "delay": (*_set("delay", computation_s=0.00125), "--deflection", "900.5"),
    "sine": (*_set("dither", target="position", waveform="sine", amplitude=0.5, frequency_hz=90), "--velocity", "60"),
    "uniform": (*_set("dither", target="current", waveform="uniform", amplitude=0.02, seed=5), "--deflection", "300"),
    "one side": (*_set("spring", side="positive", half_tick_bias="false"), "--deflection", "400"),
    "grip": (*_set("hand", inertia=1e-6, damping=1e-5, stiffness=0.003), "--deflection", "400"),
    "effects": (*_set("plant", effects=f"[{STRIBECK}, {BIAS}]"), "--deflection", "700"),
    "safety": ("--set", "safety.max_excursion=0.2", "--deflection", "400", "--safety"),
    "runaway": (*FIG8["d"], "--set", "plant.viscous=0", "--set", "plant.coulomb=0"),
}
CASES = {**FIG8, **OTHERS}


@pytest.mark.parametrize("case", CASES)
def test_simulate(hapticd: Run, snapshot: SnapshotAssertion, tmp_path: Path, case: str) -> None:
    """The report, the text, and a sample of the rows of half a second."""
    path = tmp_path / "run.arrow"
    outcome = hapticd("simulate", "--duration", "0.5", *CASES[case], "-o", str(path), "--json")
    document = outcome.document
    assert document.pop("run") == str(path)
    run = read_run(path)
    # Every row of every column counts, without all of them written down: the sums weigh each row with another number.
    weights = np.cos(np.arange(run.rows))
    sums = {name: float(np.nan_to_num(column.astype(float)) @ weights) for name, column in run.columns.items()}
    some = {name: np.nan_to_num(column[::125].astype(float)).tolist() for name, column in run.columns.items()}
    found = {"code": outcome.code, "stderr": outcome.err, "report": document}
    assert {**found, "weighted sums": sums, "some rows": some} == snapshot


def test_run_file(hapticd: Run, snapshot: SnapshotAssertion, tmp_path: Path) -> None:
    """Columns with their types and units, and which metadata there is."""
    path = tmp_path / "run.arrow"
    assert hapticd("simulate", "--duration", "0.1", "-o", str(path)).code == 0
    with pa.ipc.open_stream(path) as stream:
        schema = stream.schema
    columns = [
        {
            "name": f.name,
            "type": str(f.type),
            "metadata": {k.decode(): v.decode() for k, v in (f.metadata or {}).items()},
        }
        for f in schema
    ]
    assert {"columns": columns, "metadata": sorted(key.decode() for key in schema.metadata)} == snapshot


@pytest.mark.parametrize("case", [case for case in CASES if case not in ("velocity", "safety", "runaway")])
def test_check(hapticd: Run, snapshot: SnapshotAssertion, case: str) -> None:
    """The report as JSON and as text."""
    outcome = hapticd("check", *CASES[case], "--json")
    text = hapticd("check", *CASES[case])
    assert text.code == outcome.code
    assert {"code": outcome.code, "report": outcome.document, "text": without_counts(text.out).splitlines()} == snapshot


@pytest.mark.parametrize("device", ["delta", "impulse_engine"])
def test_check_of_a_device(hapticd: Run, snapshot: SnapshotAssertion, device: str) -> None:
    """A device of Table II, and a motion that begins with a speed."""
    outcome = hapticd("check", device, "--velocity", "2", "--json")
    assert {"code": outcome.code, "report": outcome.document, "stderr": outcome.err} == snapshot


def test_map(hapticd: Run, snapshot: SnapshotAssertion, tmp_path: Path) -> None:
    """The summary of four small maps and every point of them."""
    path = tmp_path / "maps.npz"
    size = ("--beta-count", "9", "--sigma-count", "8", "--periods", "2000", "--velocity", "5", "--velocity", "50")
    outcome = hapticd("map", *size, "-o", str(path), "--no-figure", "--json")
    report = outcome.document
    report["output"] = "MAPS"
    with np.load(path) as maps:
        points = {name: _numbers(maps[name]) for name in maps.files if maps[name].dtype.kind in "fiub"}
    assert {"code": outcome.code, "report": report, "points": points} == snapshot


def _numbers(array: np.ndarray[Any, Any]) -> list[float]:
    return np.nan_to_num(array.astype(float).ravel(), posinf=1e300).tolist()


@pytest.mark.parametrize(
    "words",
    [
        ("config", "schema"),
        ("config", "show", "--json"),
        ("config", "show"),
        ("drivers", "--json"),
        ("drivers",),
        ("check", "--set", "servo.rate_hz=-1", "--json"),
        ("simulate", "--duration", "0.0001"),
        ("config", "show", "--set", "servo.rat_hz=1"),
    ],
    ids=" ".join,
)
def test_words(hapticd: Run, snapshot: SnapshotAssertion, words: tuple[str, ...]) -> None:
    """Configuration, drivers, and how bad input is answered."""
    outcome = hapticd(*words)
    out: Any = outcome.document if outcome.out.startswith(("{", "[")) else outcome.out.splitlines()
    assert {"code": outcome.code, "stdout": out, "stderr": outcome.err.splitlines()} == snapshot


def test_faults(snapshot: SnapshotAssertion) -> None:
    """Code, cause and page of every fault."""
    texts = [faults.describe(number, 12.5, 10.0, is_linear=False) for number in sorted(faults.KINDS)]
    assert texts == snapshot
