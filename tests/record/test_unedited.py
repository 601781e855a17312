"""Files as real programs write them, brought in as they are: only the map is ours."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from scipy.io import savemat

from hapticd.record import RunFileError
from tests.record.test_foreign_layouts import MAP, I, N, Q, T, bring, check

Layout = tuple[Callable[[Path], None], dict[str, Any]]
"""What writes the file, and what the map says of it."""


def text(
    lead: str, row: Callable[[int], str], tail: str = "", end: str = "\n", code: str = "utf-8"
) -> Callable[[Path], None]:
    lines = [*lead.split("\n"), *(row(k) for k in range(N))] if lead else [row(k) for k in range(N)]
    return lambda path: path.write_bytes((end.join(lines) + end + tail).encode(code)) and None


def commas(value: float) -> str:
    return f"{value:.6f}".replace(".", ",")


NUMBERED = {"time": {"column": 0}, "position": {"column": 1, "unit": "count"}, "current": {"column": 2}}
LABVIEW = """LabVIEW Measurement\t
Writer_Version\t2
Reader_Version\t2
Separator\tTab
Decimal_Separator\t.
Multi_Headings\tNo
X_Columns\tOne
Time_Pref\tRelative
Date\t2026/03/29
***End_of_Header***\t
\t
Channels\t2\t
Samples\t50\t50\t
Y_Unit_Label\tcounts\tA\t
X0\t0.0000000000000000E+0\t0.0000000000000000E+0\t
Delta_X\t0.001000\t0.001000\t
***End_of_Header***\t\t\t
X_Value\tq\ti\tComment"""
TWINCAT = """Name;C:\\\\scope\\\\axis.tcscopex
File;C:\\\\scope\\\\axis.csv
Starttime of export;134192951980000000
sample time;1000
Data-Type;INT64;REAL64
Name;q;i
"""
TEXTS: dict[str, tuple[str, Layout]] = {
    "dSPACE ControlDesk": (
        "rec.csv",
        (
            text(
                "sep=,\nuserinfo,\nversion,1\ntype,xaxis,yaxis,yaxis\nid,1,2,3\n"
                "path,,Model Root/q,Model Root/i\nunit,s,counts,A\ntrace_values,,,",
                lambda k: f",{T[k]},{Q[k]},{I[k]}",
            ),
            {"time": {"column": 1}, "position": {"column": 2, "unit": "count"}, "current": {"column": 3}},
        ),
    ),
    "LabVIEW": (
        "test.lvm",
        (text(LABVIEW, lambda k: f"{T[k]:.6f}\t{Q[k]}\t{I[k]:.6f}", end="\r\n"), {"time": {"column": "X_Value"}}),
    ),
    "LabVIEW, with a comment at the first sample": (
        "test.lvm",
        (
            text(LABVIEW, lambda k: f"{T[k]:.6f}\t{Q[k]}\t{I[k]:.6f}" + "\tstart" * (k == 0)),
            {"time": {"column": "X_Value"}},
        ),
    ),
    "LabVIEW SignalExpress": (
        "waves.txt",
        (
            text(
                "waveform\t[0]\t[1]\nt0\t29/03/2026 01:59:58\t29/03/2026 01:59:58\ndelta t\t0.001\t0.001\n\nt\tq\ti",
                lambda k: f"{T[k]:.3f}\t{Q[k]}\t{I[k]:.6f}",
            ),
            {},
        ),
    ),
    "dSPACE, with a title as wide as the table": (
        "rec.csv",
        (text("Created by ControlDesk;;\nversion;1;\nt;q;i\ns;counts;A", lambda k: f"{T[k]};{Q[k]};{I[k]}"), {}),
    ),
    "an oscilloscope's facts beside the samples": (
        "tek0000.csv",
        (
            text(
                "",
                lambda k: (
                    (("Record Length,5e+01,", "Sample Interval,1e-03,", "Trigger,,")[k] if k < 3 else ",,")
                    + f",{T[k]:.6f},{Q[k]},{I[k]},"
                ),
            ),
            {"time": {"column": 3}, "position": {"column": 4, "unit": "count"}, "current": {"column": 5}},
        ),
    ),
    "an oscilloscope with wider first rows": (
        "newfile1.csv",
        (
            text(
                "X,CH1,CH2,Start,Increment,\nSequence,Volt,Volt,0.000000e+00,1.000000e-03",
                lambda k: f"{k},{Q[k]},{I[k]},,",
            ),
            {**NUMBERED, "time": {"column": 0, "unit": "ms"}},
        ),
    ),
    "an oscilloscope whose first line is as wide as the table": (
        "c1.csv",
        (
            text(
                "LECROYWR,12345,Waveform\nSegments,1,SegmentSize,50\nSegment,TrigTime,TimeSinceSegment1\n"
                "#1,29-Mar-2026 01:59:58,0\nt,q,i",
                lambda k: f"{T[k]},{Q[k]},{I[k]}",
            ),
            {},
        ),
    ),
    "units in brackets above an empty line": (
        "pico.csv",
        (
            text("t,q,i\n(ms),(counts),(A)\n", lambda k: f"{1000 * T[k]:.6f},{Q[k]},{I[k]}"),
            {"time": {"column": "t", "unit": "ms"}},
        ),
    ),
    "words beside numbers without names": (
        "log.csv",
        (text("", lambda k: f"{T[k]},{Q[k]},{I[k]},moves"), NUMBERED),
    ),
    "MATLAB's writetimetable": (
        "tt.csv",
        (text("Time,q,i", lambda k: f"{T[k]:g} sec,{Q[k]},{I[k]}"), {"time": {"column": "Time"}}),
    ),
    "an Arduino that greets": (
        "putty.log",
        (
            text(
                "=~=~=~=~=~=~=~=~=~=~=~= PuTTY log 2026.03.29 01:59:58 =~=~=~=~=~=~=~=~=~=~=~=\nReady.\nt,q,i",
                lambda k: f"{1000 * k},{Q[k]},{I[k]}",
                end="\r\n",
            ),
            {"time": {"column": "t", "unit": "us"}},
        ),
    ),
    "an Arduino without names, with a comma at the end": (
        "serial.txt",
        (
            text("", lambda k: f"{1000 * k},{Q[k]},{I[k]},", end="\r\n"),
            {**NUMBERED, "time": {"column": 0, "unit": "us"}},
        ),
    ),
    "a log that ends within a row": (
        "serial.csv",
        (text("t,q,i", lambda k: f"{T[k]},{Q[k]},{I[k]}", tail="0.050,12"), {}),
    ),
    "PlotJuggler": (
        "joint_states.csv",
        (
            text(
                "__time,/joint_states/elbow/position,/joint_states/elbow/effort",
                lambda k: f"{1.7e9 + T[k]:.6f},{Q[k]},{I[k]}",
            ),
            {
                "time": {"column": "__time"},
                "position": {"column": "/joint_states/elbow/position", "unit": "count"},
                "current": {"column": "/joint_states/elbow/effort"},
            },
        ),
    ),
    "rostopic echo -p": (
        "states.csv",
        (
            text(
                "%time,field.header.frame_id,field.name0,field.position0,field.effort0",
                lambda k: f"{1_700_000_000_000_000_000 + 1_000_000 * k},,elbow,{Q[k]},{I[k]}",
            ),
            {
                "time": {"column": "%time", "unit": "ns"},
                "position": {"column": "field.position0", "unit": "count"},
                "current": {"column": "field.effort0"},
            },
        ),
    ),
    "Excel in Germany": (
        "mappe.csv",
        (
            text("\ufeffsep=;\nt;q;i", lambda k: f"{commas(T[k])};{Q[k]};{commas(I[k])}", end="\r\n"),
            {"csv": {"decimal": ","}},
        ),
    ),
    "R's write.table": (
        "r.txt",
        (text('"t" "q" "i"', lambda k: f'"{k + 1}" {T[k]} {Q[k]} {I[k]}'), {"time": {"column": "t"}}),
    ),
    "pandas with its index": ("frame.csv", (text(",t,q,i", lambda k: f"{k},{T[k]},{Q[k]},{I[k]}"), {})),
    "a logic analyser": (
        "digital.csv",
        (
            text("Time [s],q [counts],i [A]", lambda k: f"{T[k]:.9f},{Q[k]},{I[k]}"),
            {
                "time": {"column": "Time [s]"},
                "position": {"column": "q [counts]", "unit": "count"},
                "current": {"column": "i [A]"},
            },
        ),
    ),
    "TwinCAT's scope": (
        "axis.csv",
        (text(TWINCAT + "\nTime;q;i", lambda k: f"{k};{Q[k]};{I[k]}"), {"time": {"column": "Time", "unit": "ms"}}),
    ),
}


@pytest.mark.parametrize("name", TEXTS)
def test_a_text_file_of_a_program(tmp_path: Path, name: str) -> None:
    file, (write, keys) = TEXTS[name]
    write(tmp_path / file)
    columns, warnings = bring(tmp_path / file, **keys)
    if name == "PlotJuggler":  # seconds since 1970 have no nanoseconds
        columns["time_s"] = np.round(columns["time_s"], 6) - 1.7e9
        columns["time_s"] = np.round(columns["time_s"], 6)
    check(columns)
    assert warnings == (("the last line is cut off, and left out",) if "ends within" in name else ())


def labelled(kind: str) -> Any:
    found = np.zeros(N, dtype=[("t", "f8"), ("q", f"{kind}i4"), ("i", f"{kind}f8"), ("all", "f4", (3,))])
    found["t"], found["q"], found["i"], found["all"][:, 1] = T, Q, I, Q
    return found


def saved(contents: Any) -> Callable[[Path], None]:
    return lambda path: np.save(path, contents)


def zipped(*plain: Any, **named: Any) -> Callable[[Path], None]:
    return lambda path: np.savez(path, *plain, **named)


START = np.datetime64("2026-03-29T01:59:58.000000", "us")
STAMPED = np.zeros(N, dtype=[("t", "M8[us]"), ("q", "i8"), ("i", "f4")])
STAMPED["t"], STAMPED["q"], STAMPED["i"] = START + (1000 * np.arange(N)).astype("m8[us]"), Q, I

NUMPYS: dict[str, tuple[str, Layout]] = {
    "a structured array": ("log.npy", (saved(labelled("<")), {})),
    "the same of another byte order": ("log.npy", (saved(labelled(">")), {})),
    "a field with three joints": (
        "log.npy",
        (saved(labelled("<")), {"position": {"column": "all[:,1]", "unit": "count"}}),
    ),
    "a structured array with instants": ("log.npy", (saved(STAMPED), {})),
    "a column of a matrix a row": ("log.npy", (saved(np.stack([T, Q, I])), NUMBERED)),
    "Fortran order, single precision": (
        "log.npy",
        (
            saved(np.asfortranarray(np.stack([1000 * T, Q, I], 1, dtype="f4", casting="same_kind"))),
            {**NUMBERED, "time": {"column": 0, "unit": "ms"}},
        ),
    ),
    "arrays without names": (
        "log.npz",
        (
            zipped(T, Q, I),
            {
                "time": {"column": "arr_0"},
                "position": {"column": "arr_1", "unit": "count"},
                "current": {"column": "arr_2"},
            },
        ),
    ),
    "with the rate beside them": ("log.npz", (zipped(t=T, q=Q, i=I, rate=1000.0, robot=np.array("arm")), {})),
    "columns that are n x 1": ("log.npz", (zipped(t=T[:, None], q=Q[:, None], i=I[:, None]), {})),
    "a structured array by its name": ("log.npz", (zipped(log=labelled("<")), {"variable": "log"})),
    "its fields from outside": (
        "log.npz",
        (
            zipped(log=labelled("<")),
            {
                "time": {"column": "log.t"},
                "position": {"column": "log.all[:,1]", "unit": "count"},
                "current": {"column": "log.i"},
            },
        ),
    ),
}


@pytest.mark.parametrize("name", NUMPYS)
def test_a_file_of_numpys(tmp_path: Path, name: str) -> None:
    file, (write, keys) = NUMPYS[name]
    write(tmp_path / file)
    columns, _ = bring(tmp_path / file, **keys)
    columns = {**columns, "time_s": np.round(columns["time_s"], 6)} if "single" in name else columns
    if "single" in name or "instants" in name:
        columns["current_command_A"] = np.round(columns["current_command_A"].astype(float), 6)
    check(columns)


FRAME = pd.DataFrame({"q": Q, "i": I})
WHEN = pd.Timestamp("2026-03-29T01:59:58Z") + pd.to_timedelta(np.arange(N), unit="ms")
THREE = np.stack([0 * Q, Q, 0 * Q], 1).astype(float)


def framed(frame: pd.DataFrame) -> Callable[[Path], None]:
    return frame.to_parquet


def tabled(**columns: Any) -> Callable[[Path], None]:
    return lambda path: pq.write_table(pa.table(columns), path)


LISTS = pa.array(THREE.tolist())
PARQUETS: dict[str, Layout] = {
    "pandas, its index": (framed(FRAME.set_index(pd.Index(T))), {"time": {"column": "__index_level_0__"}}),
    "pandas, an index with a name": (framed(FRAME.set_index(pd.Index(T, name="t"))), {}),
    "pandas, instants with a zone": (
        framed(FRAME.set_index(pd.DatetimeIndex(WHEN, name="t").tz_convert("Europe/Berlin"))),
        {},
    ),
    "pandas, time since the start": (framed(FRAME.assign(t=WHEN - WHEN[0])), {}),
    "pandas, numbers that may be missing": (framed(FRAME.assign(t=T, q=pd.array(Q, dtype="Int32"))), {}),
    "pandas, two levels of names": (
        framed(pd.concat({"elbow": FRAME.assign(t=T)}, axis=1)),
        {
            "time": {"column": "('elbow', 't')"},
            "position": {"column": "('elbow', 'q')", "unit": "count"},
            "current": {"column": "('elbow', 'i')"},
        },
    ),
    "lists of joints": (tabled(t=T, position=LISTS, i=I), {"position": {"column": "position[:,1]", "unit": "count"}}),
    "lists of a fixed size": (
        tabled(t=T, position=LISTS.cast(pa.list_(pa.float64(), 3)), i=I),
        {"position": {"column": "position(:,2)", "unit": "count"}},
    ),
    "structs": (
        tabled(t=T, log=pa.StructArray.from_arrays([pa.array(Q), LISTS], ["q", "all"]), i=I),
        {"position": {"column": "log.q", "unit": "count"}},
    ),
    "decimals": (tabled(t=pa.array(T).cast(pa.decimal128(12, 6)), q=Q, i=I), {}),
    "a dictionary of values": (tabled(t=T, q=pa.array(Q).dictionary_encode(), i=pa.array(I, pa.float32())), {}),
}


@pytest.mark.parametrize("name", PARQUETS)
def test_a_parquet_file_of_a_program(tmp_path: Path, name: str) -> None:
    write, keys = PARQUETS[name]
    write(tmp_path / "log.parquet")
    columns, warnings = bring(tmp_path / "log.parquet", **keys)
    columns["current_command_A"] = np.round(columns["current_command_A"].astype(float), 6)
    check(columns)
    assert warnings == ()


MATS: dict[str, tuple[dict[str, Any], dict[str, Any], dict[str, Any]]] = {
    "To File: a row a signal": ({"ans": np.stack([T, Q, I])}, {}, {"variable": "ans", **NUMBERED}),
    "To Workspace, structure with time": (
        {
            "simout": {
                "time": T[:, None],
                "signals": {"values": np.stack([Q, I], 1), "dimensions": 2.0, "label": ""},
                "blockName": "m/s",
            }
        },
        {},
        {
            "time": {"column": "simout.time"},
            "position": {"column": "simout.signals.values(:,1)", "unit": "count"},
            "current": {"column": "simout.signals.values(:,2)"},
        },
    ),
    "a table as a struct": (
        {"S": {"t": T[:, None], "q": Q[:, None].astype("i4"), "i": I[:, None]}},
        {},
        {"variable": "S"},
    ),
    "version 4": ({"t": T[:, None], "q": Q[:, None].astype(float), "i": I[:, None]}, {"format": "4"}, {}),
    "single precision and int16": ({"t": T, "q": Q.astype("i2"), "i": I.astype("f4")}, {"do_compression": True}, {}),
}


@pytest.mark.parametrize("name", MATS)
def test_a_mat_file_of_a_program(tmp_path: Path, name: str) -> None:
    contents, options, keys = MATS[name]
    savemat(tmp_path / "log.mat", contents, **options)
    columns, warnings = bring(tmp_path / "log.mat", **keys)
    columns["current_command_A"] = np.round(columns["current_command_A"].astype(float), 6)
    check(columns)
    assert warnings == ()


def test_a_value_beyond_the_last_column_is_refused(tmp_path: Path) -> None:
    text("t,q,i", lambda k: f"{T[k]},{Q[k]},{I[k]}" + ",7" * (k == 30))(tmp_path / "log.csv")
    with pytest.raises(RunFileError, match=r"Expected 3 columns, got 4: 0.03,565,"):
        bring(tmp_path / "log.csv")


def test_the_maps_default_is_what_most_of_them_take() -> None:
    assert {"t", "q", "i"} == {MAP[key]["column"] for key in ("time", "position", "current")}
