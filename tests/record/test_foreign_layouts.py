"""Layouts that people bring, none edited: names twice, units, stamps as text, counters that start again, matrices."""

from __future__ import annotations

import datetime
import errno
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat

from hapticd.record import RunFileError, import_run, parse_map, read_run
from hapticd.record.matfile import read_mat

N = 50
T = np.round(0.001 * np.arange(N), 3)
Q = np.rint(1000 * np.sin(20 * T)).astype(np.int64)
I = np.round(np.cos(30 * T), 6)  # noqa: E741 - a current

MAP: dict[str, Any] = {
    "device": "rotary",
    "time": {"column": "t"},
    "position": {"column": "q", "unit": "count"},
    "current": {"column": "i"},
    "encoder": {"counts_per_rev": 8192},
}


def bring(path: Path, **keys: Any) -> tuple[dict[str, Any], tuple[str, ...]]:
    done = import_run(path, parse_map({**MAP, **keys}, "map.yaml"), path.parent / "run.arrow", force=True)
    return read_run(done.path).columns, done.warnings


def check(columns: dict[str, Any]) -> None:
    assert np.allclose(columns["time_s"] - columns["time_s"][0], T, rtol=0, atol=1e-9)
    assert np.array_equal(columns["encoder_counts"], Q)
    assert np.allclose(columns["current_command_A"], I)


def lines(sep: str = ",", stamp: Callable[[int], str] = lambda k: f"{T[k]:.3f}") -> str:
    return "\n".join(sep.join((stamp(k), str(Q[k]), f"{I[k]:.6f}")) for k in range(N)) + "\n"


TEXTS: dict[str, tuple[str, str]] = {
    "numpy's header": ("data.csv", "# t,q,i\n" + lines()),
    "numpy's header behind a title": ("data.csv", "# made by a lab\n#t , q, i\n" + lines()),
    "tabs in .txt": ("data.txt", "t\tq\ti\n" + lines("\t")),
    "tabs in .tsv": ("data.tsv", "t\tq\ti\n" + lines("\t")),
    "semicolons": ("data.csv", "t;q;i\n" + lines(";")),
    "aligned with spaces": ("data.dat", "  t     q   i\n" + lines("   ")),
    "spaces behind a comma": ("data.csv", "t, q, i\n" + lines(", ")),
    "a row of units": ("data.csv", "t,q,i\ns,counts,A\n" + lines()),
    "a row of units in brackets": ("data.csv", "t,q,i\n[s],[counts],[A]\n" + lines()),
    "quoted names": ("data.csv", '"t","q","i"\n' + lines()),
    "quoted values": ("data.csv", "t,q,i\n" + "".join(f'"{T[k]}","{Q[k]}","{I[k]}"\n' for k in range(N))),
    "ISO 8601": ("data.csv", "t,q,i\n" + lines(stamp=lambda k: f"2026-03-29T01:59:59.{975 + k:03d}Z" if k < 25 else
                                            f"2026-03-29T02:00:00.{k - 25:03d}Z")),
    "a time of day": ("data.csv", "t,q,i\n" + lines(stamp=lambda k: f"01:59:58.{k:03d}")),
    "across midnight": ("data.csv", "t,q,i\n" + lines(stamp=lambda k: f"23:59:59.{975 + k:03d}" if k < 25 else
                                                f"00:00:00.{k - 25:03d}")),
    "a comma in an instant": ("data.csv", "t;q;i\n" + lines(";", lambda k: f"2026-03-29 01:59:58,{k:03d}")),
}  # fmt: skip


@pytest.mark.parametrize("name", TEXTS)
def test_a_text_file_is_read_as_it_is(tmp_path: Path, name: str) -> None:
    file, text = TEXTS[name]
    (tmp_path / file).write_text(text)
    columns, warnings = bring(tmp_path / file)
    check(columns)
    assert warnings == (("the times of day pass midnight at row 25",) if "midnight" in name else ())


@pytest.mark.parametrize("sep", [",", ";", "\t", "|", " "])
@pytest.mark.parametrize("lead", ["", "Rig 3, left\n\n", "# "])
@pytest.mark.parametrize("note", ["moves", 'starts, "slowly"; 1|2\tonce'])
def test_a_delimiter_between_quotes_is_none(tmp_path: Path, sep: str, lead: str, note: str) -> None:
    names, quoted = ["time, s", 'the "position"; deg', "i (A | rms)", "a note"], note.replace('"', '""')
    header = sep.join('"' + name.replace('"', '""') + '"' for name in names)
    rows = "".join(sep.join((f"{T[k]}", f"{Q[k]}", f"{I[k]}", f'"{quoted}"')) + "\n" for k in range(N))
    (tmp_path / "data.csv").write_text(f"{lead}{header}\n{rows}")
    keys = {"time": {"column": names[0]}, "position": {"column": names[1], "unit": "count"}}
    check(bring(tmp_path / "data.csv", **keys, current={"column": names[2]})[0])


def test_decimal_commas_between_quotes(tmp_path: Path) -> None:
    rows = [",".join(f'"{value}"'.replace(".", ",") for value in (T[k], Q[k], I[k])) for k in range(N)]
    (tmp_path / "data.csv").write_text("\n".join(["t,q,i", *rows]))
    check(bring(tmp_path / "data.csv", csv={"decimal": ","})[0])


@pytest.mark.parametrize("header", ["# t,q,i\n", "t,q,i\n", ""])
def test_numbers_of_columns_lose_no_row(tmp_path: Path, header: str) -> None:
    (tmp_path / "data.csv").write_text(header + lines())
    numbers = {"time": {"column": 0}, "position": {"column": 1, "unit": "count"}, "current": {"column": 2}}
    check(bring(tmp_path / "data.csv", **numbers)[0])


def test_columns_that_pandas_called_0_1_2(tmp_path: Path) -> None:
    (tmp_path / "data.csv").write_text("0,1,2\n" + lines())
    numbers = {"time": {"column": 0}, "position": {"column": 1, "unit": "count"}, "current": {"column": "2"}}
    check(bring(tmp_path / "data.csv", **numbers)[0])


def test_a_native_file_with_numpys_header(tmp_path: Path) -> None:
    text = "# time_s,encoder_counts,current_command_A\n" + lines()
    (tmp_path / "data.csv").write_text(text)
    check(read_run(tmp_path / "data.csv").columns)


def test_a_row_of_units_that_are_not_the_maps_is_said(tmp_path: Path) -> None:
    (tmp_path / "data.csv").write_text("t,q,i\nms,counts,mA\n" + lines())
    assert bring(tmp_path / "data.csv")[1] == (
        "time.unit is s, but the file says 'ms' of column t",
        "current.unit is A, but the file says 'mA' of column i",
    )


def test_a_name_that_two_columns_have_is_refused_with_their_numbers(tmp_path: Path) -> None:
    (tmp_path / "data.csv").write_text("t,q,i,q,i\n" + "\n".join(f"{T[k]},{Q[k]},{I[k]},7,0.25" for k in range(N)))
    with pytest.raises(RunFileError, match=r"= q: 2 columns have that name; give the number of one: 1, 3 \(from 0\)"):
        bring(tmp_path / "data.csv")
    check(bring(tmp_path / "data.csv", position={"column": 1, "unit": "count"}, current={"column": 2})[0])


@pytest.mark.parametrize(("size", "unit", "bits"), [(2**32, "us", 32), (2**16, "ms", 16), (4294967.296, "ms", 32)])
def test_a_counter_that_starts_again_is_refused_or_carried_on(
    tmp_path: Path, size: float, unit: str, bits: int
) -> None:
    scale = {"us": 1e6, "ms": 1e3}[unit]
    stamps = (T * scale + size - 20e-3 * scale) % size
    np.savetxt(
        tmp_path / "data.csv", np.stack([stamps, Q, I], 1), delimiter=",", header="t,q,i", comments="", fmt="%.9g"
    )
    with pytest.raises(
        RunFileError, match=rf"row 20: a counter of {bits} bits that starts again; time.wrap: {size:.15g}"
    ):
        bring(tmp_path / "data.csv", time={"column": "t", "unit": unit})
    columns, warnings = bring(tmp_path / "data.csv", time={"column": "t", "unit": unit, "wrap": size})
    assert np.allclose(np.diff(columns["time_s"]), 1e-3, atol=2e-5)
    assert warnings == ()


def test_wraps_that_never_act_are_said(tmp_path: Path) -> None:
    degrees = (np.rint(np.linspace(0, 500, N) / 0.05) * 0.05) % 360.0
    np.savetxt(tmp_path / "data.csv", np.stack([T, degrees, I], 1), delimiter=",", header="t,q,i", comments="")
    for wrap, said in ((8192, "position.wrap = 8192 deg never acts"), (None, "position jumps by")):
        position = {"column": "q", "unit": "deg", **({"wrap": wrap} if wrap else {})}
        (warning,) = bring(tmp_path / "data.csv", position=position)[1]
        assert warning.startswith(said)
        assert "position.wrap: 360 " in warning
    assert bring(tmp_path / "data.csv", position={"column": "q", "unit": "deg", "wrap": 360})[1] == ()
    (warning,) = bring(tmp_path / "data.csv", position={"column": "q", "unit": "deg", "factor": 0.1, "wrap": 360})[1]
    assert "position.wrap: 36 would, for it is taken after position.factor" in warning
    assert bring(
        tmp_path / "data.csv",
        time={"column": "t", "wrap": 4294.967296},
        position={"column": "q", "unit": "deg", "wrap": 360},
    )[1] == ("time.wrap = 4294.97 s never acts: no stamp falls by more than half of it",)


def test_text_that_is_no_stamp_names_what_would_be_one(tmp_path: Path) -> None:
    (tmp_path / "data.csv").write_text("t,q,i\n" + lines(stamp=lambda k: f"29.3.2026 {k}"))
    with pytest.raises(
        RunFileError, match=r"'29.3.2026 0' in row 0\); stamps are numbers, instants of ISO 8601 .* or times"
    ):
        bring(tmp_path / "data.csv")
    (tmp_path / "data.csv").write_text("t,q,i\n" + lines(stamp=lambda k: f"01:59:58.{k:03d}"))
    with pytest.raises(RunFileError, match=r"time.unit = ms, but the stamps are instants"):
        bring(tmp_path / "data.csv", time={"column": "t", "unit": "ms"})


def structs(name: str, *values: Any) -> Any:
    """An array of structs with a field of that name and a label."""
    found = np.zeros((1, len(values)), dtype=[(name, object), ("label", object)])
    for number, value in enumerate(values):
        found[0, number] = (value, "words")
    return found


def cells(*values: Any) -> Any:
    found = np.zeros(len(values), dtype=object)
    found[:] = values
    return found


SIGNALS = structs("values", Q[:, None].astype(float), np.stack([0 * I, I], 1))


MATS: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "n x k": (
        {"t": T, "q": np.stack([0 * Q, Q, Q], 1), "i": np.stack([I, I])},
        {"position": {"column": "q(:,2)", "unit": "count"}, "current": {"column": "i(1,:)"}},
    ),
    "Simulink's structure with time": (
        {"out": {"time": T[:, None], "signals": SIGNALS}},
        {
            "time": {"column": "out.time"},
            "position": {"column": "out.signals(1).values", "unit": "count"},
            "current": {"column": "out.signals(2).values(:,2)"},
        },
    ),
    "the same within a variable": (
        {"out": {"time": T[:, None], "signals": SIGNALS}},
        {
            "variable": "out",
            "time": {"column": "time"},
            "position": {"column": "signals(1).values", "unit": "count"},
            "current": {"column": "signals(2).values[:,1]"},
        },
    ),
    "dSPACE ControlDesk": (
        {"rec": {"X": {"Data": T}, "Y": structs("Data", Q, I)}},
        {
            "time": {"column": "rec.X.Data"},
            "position": {"column": "rec.Y(1).Data", "unit": "count"},
            "current": {"column": "rec.Y(2).Data"},
        },
    ),
    "cells": (
        {"t": T, "c": cells(Q, I)},
        {"position": {"column": "c{1}", "unit": "count"}, "current": {"column": "c{2}"}},
    ),
}


@pytest.mark.parametrize("name", MATS)
@pytest.mark.parametrize("packed", [False, True])
def test_shapes_of_matlab_files(tmp_path: Path, name: str, packed: bool) -> None:
    contents, keys = MATS[name]
    savemat(tmp_path / "data.mat", contents, do_compression=packed)
    check(bring(tmp_path / "data.mat", **keys)[0])


def test_what_there_is_and_what_is_left_out_is_listed(tmp_path: Path) -> None:
    from scipy.sparse import csc_matrix

    savemat(
        tmp_path / "data.mat", {"t": T, "qs": np.zeros((N, 3)), "s": csc_matrix(np.eye(4)), "cube": np.zeros((2, 3, 4))}
    )
    with pytest.raises(
        RunFileError, match=r"i: no such column.* t, qs\(:,1\) to qs\(:,3\).*left out: s \(a sparse array of 4x4\)"
    ):
        bring(tmp_path / "data.mat", position={"column": "qs(:,1)", "unit": "count"})
    with pytest.raises(RunFileError, match=r"qs: a matrix of 50 x 3; one column of it is qs\(:,1\) to qs\(:,3\)"):
        bring(tmp_path / "data.mat", position={"column": "qs", "unit": "count"})
    with pytest.raises(RunFileError, match=r"qs\(:,4\): qs has 50 x 3"):
        bring(tmp_path / "data.mat", position={"column": "qs(:,4)", "unit": "count"})
    with pytest.raises(RunFileError, match=r"cube: .*it is an array of 2 x 3 x 4, which no column"):
        bring(tmp_path / "data.mat", position={"column": "cube", "unit": "count"})


def test_npz_with_columns(tmp_path: Path) -> None:
    np.savez(tmp_path / "data.npz", t=T, q=np.stack([0 * Q, Q], 1), i=I)
    check(bring(tmp_path / "data.npz", position={"column": "q[:,1]", "unit": "count"})[0])
    np.savez_compressed(tmp_path / "data.npz", log=np.stack([T, Q, I]))
    numbers = {"time": {"column": 0}, "position": {"column": 1, "unit": "count"}, "current": {"column": 2}}
    check(bring(tmp_path / "data.npz", variable="log", **numbers)[0])
    (tmp_path / "data.npz").write_bytes(b"PK\x03\x04 rubbish")
    with pytest.raises(RunFileError, match=r"data\.npz is not a readable \.npz file"):
        bring(tmp_path / "data.npz")


def test_parquet_with_instants(tmp_path: Path) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    begin = datetime.datetime(2026, 3, 29, 1, 59, 58, tzinfo=datetime.UTC)
    stamps = [begin + datetime.timedelta(milliseconds=k) for k in range(N)]
    pq.write_table(pa.table({"t": stamps, "q": Q, "i": I}), tmp_path / "data.parquet")
    check(bring(tmp_path / "data.parquet")[0])


def test_hdf5_is_named(tmp_path: Path) -> None:
    (tmp_path / "data.mat").write_bytes(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM" + bytes(512))
    with pytest.raises(RunFileError, match=r"MATLAB 7.3 \(HDF5\) file; save it with -v7"):
        read_mat(tmp_path / "data.mat")


def test_a_spelling_of_a_unit_is_its_unit(tmp_path: Path) -> None:
    (tmp_path / "data.csv").write_text("t,q,i\n" + lines())
    done = bring(tmp_path / "data.csv", time={"column": "t", "unit": "sec"}, position={"column": "q", "unit": "counts"})
    check(done[0])


@pytest.mark.parametrize("after", [0, 1, 2])
def test_a_disk_that_fills_up_names_the_run_and_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, after: int
) -> None:
    (tmp_path / "data.csv").write_text("t,q,i\n" + lines())
    done, write = [], os.write

    def full(descriptor: int, data: Any) -> int:
        done.append(descriptor)
        if len(done) > after:
            raise OSError(errno.ENOSPC, "No space left on device")
        return write(descriptor, data)

    monkeypatch.setattr("hapticd.record.writer.os.write", full)
    with pytest.raises(RunFileError) as caught:
        bring(tmp_path / "data.csv")
    assert str(caught.value) == f"cannot write {tmp_path}/run.arrow: No space left on device; nothing is left of it"
    assert [path.name for path in tmp_path.iterdir()] == ["data.csv"]
