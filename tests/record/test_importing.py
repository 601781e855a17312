"""Foreign files of every format become runs, to the last bit of their time stamps; wrong maps and files are explained."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from numpy.typing import NDArray
from scipy.io import savemat

from hapticd.config import ConfigError
from hapticd.record import Run, RunFileError, import_run, load_map, parse_map, read_run
from hapticd.record.importing_map import map_keys

N = 400
RNG = np.random.default_rng(11)
TIME = np.cumsum(RNG.uniform(0.0008, 0.0012, N))
COUNTS = np.rint(1000 * np.sin(2 * TIME)).astype(np.int64)
CURRENT = np.cos(3 * TIME)
CELL = 2 * np.pi / 8192

ROTARY: dict[str, Any] = {
    "device": "rotary",
    "time": {"column": "t"},
    "position": {"column": "q", "unit": "count"},
    "current": {"column": "i"},
    "encoder": {"counts_per_rev": 8192},
}
COLUMNS: dict[str, NDArray[Any]] = {"t": TIME, "q": COUNTS, "i": CURRENT}


def changed(**keys: Any) -> dict[str, Any]:
    return {key: value for key, value in {**ROTARY, **keys}.items() if value is not None}


def parquet(folder: Path, **columns: NDArray[Any]) -> Path:
    path = folder / "data.parquet"
    pq.write_table(pa.table({**COLUMNS, **columns}), path)
    return path


def bring(source: Path, mapping: dict[str, Any]) -> Run:
    done = import_run(source, parse_map(mapping, "map.yaml"), source.parent / "run.arrow", force=True)
    run = read_run(done.path)
    assert run.rows == done.rows
    assert [path.name for path in source.parent.glob(".*")] == []
    return run


def check_plain(run: Run) -> None:
    assert np.array_equal(run.columns["time_s"], TIME)
    assert np.array_equal(run.columns["encoder_counts"], COUNTS)
    assert np.array_equal(run.columns["current_command_A"], CURRENT)
    assert run.metadata["model"]["encoder"] == {"counts_per_rev": 8192.0}
    assert run.metadata["linear"] is False


def test_parquet(tmp_path: Path) -> None:
    check_plain(bring(parquet(tmp_path), ROTARY))


def test_csv(tmp_path: Path) -> None:
    path = tmp_path / "data.csv"
    lines = [f"{t!r},{q},{i!r}" for t, q, i in zip(TIME.tolist(), COUNTS.tolist(), CURRENT.tolist(), strict=True)]
    path.write_text("# made by a lab\nt, q,i\n" + "\n".join(lines) + "\n")
    check_plain(bring(path, ROTARY))


def test_csv_with_semicolons_decimal_commas_and_no_header(tmp_path: Path) -> None:
    path = tmp_path / "data.csv"
    lines = [f"{t!r};{q};{i!r}" for t, q, i in zip(TIME.tolist(), COUNTS.tolist(), CURRENT.tolist(), strict=True)]
    path.write_text("a title\n" + "\n".join(lines).replace(".", ",") + "\n")
    style = {"delimiter": ";", "decimal": ",", "header": False, "skip_lines": 1}
    position = {"column": 1, "unit": "count"}
    check_plain(bring(path, changed(csv=style, time={"column": 0}, position=position, current={"column": 2})))


@pytest.mark.parametrize("rows", [True, False])
def test_npy_either_way_round(tmp_path: Path, rows: bool) -> None:
    data = np.stack([TIME, COUNTS, CURRENT])
    np.save(tmp_path / "data.npy", data if rows else data.T)
    numbers = {"time": {"column": 0}, "position": {"column": 1, "unit": "count"}, "current": {"column": 2}}
    check_plain(bring(tmp_path / "data.npy", changed(**numbers)))


def test_npy_with_named_fields(tmp_path: Path) -> None:
    data = np.zeros(N, dtype=[("t", "f8"), ("q", "i8"), ("i", "f8")])
    for name, values in COLUMNS.items():
        data[name] = values
    np.save(tmp_path / "data.npy", data)
    check_plain(bring(tmp_path / "data.npy", ROTARY))


def test_mat_with_a_struct_in_a_struct(tmp_path: Path) -> None:
    savemat(tmp_path / "data.mat", {"log": {"motor": {"q": COUNTS[:, None], "i": CURRENT}, "t": TIME}, "note": "x"})
    columns = {"position": {"column": "motor.q", "unit": "count"}, "current": {"column": "motor.i"}}
    check_plain(bring(tmp_path / "data.mat", changed(variable="log", **columns)))


def test_mat_with_a_matrix(tmp_path: Path) -> None:
    savemat(tmp_path / "data.mat", {"log": np.stack([TIME, COUNTS, CURRENT], axis=1)})
    numbers = {"time": {"column": 0}, "position": {"column": 1, "unit": "count"}, "current": {"column": 2}}
    check_plain(bring(tmp_path / "data.mat", changed(variable="log", **numbers)))


def test_whole_nanoseconds_since_1970_lose_nothing(tmp_path: Path) -> None:
    steps = RNG.integers(900_000, 1_100_000, N)
    stamps = 1_790_000_000_123_456_789 + np.cumsum(steps)
    run = bring(parquet(tmp_path, t=stamps), changed(time={"column": "t", "unit": "ns"}))
    assert np.array_equal(np.rint(run.columns["time_s"] * 1e9).astype(np.int64), stamps - stamps[0])


def test_rate_in_place_of_stamps(tmp_path: Path) -> None:
    run = bring(parquet(tmp_path), changed(time={"rate_hz": 500}))
    assert np.array_equal(run.columns["time_s"], np.arange(N) / 500.0)


def test_angles_in_degrees_with_sign_factor_and_offset(tmp_path: Path) -> None:
    degrees = 10.0 - 0.5 * np.rad2deg(COUNTS * CELL)
    position = {"column": "q", "unit": "deg", "offset": -20.0, "factor": 2.0, "sign": -1}
    run = bring(parquet(tmp_path, q=degrees), changed(position=position))
    assert np.array_equal(run.columns["encoder_counts"], COUNTS)


def test_a_counter_that_overflows_is_unwrapped(tmp_path: Path) -> None:
    position = {"column": "q", "unit": "count", "wrap": 256}
    run = bring(parquet(tmp_path, q=(COUNTS % 256).astype(np.uint8)), changed(position=position))
    assert np.array_equal(run.columns["encoder_counts"] - COUNTS, np.full(N, COUNTS[0] % 256 - COUNTS[0]))


def test_positions_between_the_steps_are_floored(tmp_path: Path) -> None:
    run = bring(parquet(tmp_path, q=(COUNTS + 0.7) * CELL), changed(position={"column": "q"}))
    assert np.array_equal(run.columns["encoder_counts"], COUNTS)


def test_linear_axis_with_force_and_resolution(tmp_path: Path) -> None:
    metres, newtons = 5e-8 * COUNTS, 30.0 * CURRENT
    mapping = {
        "device": "linear",
        "time": {"column": "t"},
        "position": {"column": "q", "unit": "mm", "resolution": 5e-5},
        "force": {"column": "i", "unit": "kN"},
        "torque_constant": 35.0,
    }
    run = bring(parquet(tmp_path, q=1e3 * metres, i=1e-3 * newtons), mapping)
    assert np.array_equal(run.columns["encoder_counts"], COUNTS)
    assert np.allclose(run.columns["force_command"], newtons)
    assert np.allclose(run.columns["current_command_A"], newtons / 35.0)
    assert run.metadata["model"]["encoder"]["counts_per_metre"] == pytest.approx(2e7)
    assert run.metadata["linear"] is True
    assert run.metadata["imported"]["command"] == "force"
    assert run.units["force_command"] == "N"


def test_measured_current_in_milliamperes(tmp_path: Path) -> None:
    run = bring(parquet(tmp_path, m=1e3 * CURRENT), changed(current_measured={"column": "m", "unit": "mA"}))
    assert np.allclose(run.columns["current_measured_A"], CURRENT)


def test_a_part_of_the_file_thinned_out(tmp_path: Path) -> None:
    run = bring(parquet(tmp_path), changed(from_s=0.1, until_s=0.3, every=4))
    first = int(np.argmax(TIME - TIME[0] >= 0.1))
    kept = np.count_nonzero((TIME - TIME[0] >= 0.1) & (TIME - TIME[0] <= 0.3)) // 4
    assert run.rows == kept
    assert np.array_equal(run.columns["time_s"], TIME[first : first + 4 * kept : 4])
    assert run.columns["current_command_A"][0] == pytest.approx(CURRENT[first : first + 4].mean())


def test_a_model_makes_it_a_run_with_a_config(tmp_path: Path) -> None:
    run = bring(parquet(tmp_path), changed(model="re35", encoder={"counts_per_rev": 4096}))
    assert run.metadata["config"]["encoder"]["counts_per_rev"] == 4096.0
    assert run.metadata["config"]["plant"]["inertia"] == pytest.approx(6.28e-6)
    assert np.allclose(run.columns["force_command"], 0.0292 * CURRENT)


def test_a_clock_that_runs_backwards_is_said(tmp_path: Path) -> None:
    stamps = TIME.copy()
    stamps[50] = stamps[48]
    path = parquet(tmp_path, t=stamps)
    done = import_run(path, parse_map(ROTARY, "map.yaml"), tmp_path / "run.arrow")
    assert done.warnings == ("time_s does not rise at 1 place(s), first at row 50",)


def test_a_decimal_comma_in_a_column_is_named(tmp_path: Path) -> None:
    lines = [f"{t:.4f};{q};{i:.4f}".replace(".", ",") for t, q, i in zip(TIME, COUNTS, CURRENT, strict=True)]
    (tmp_path / "data.csv").write_text("t;q;i\n" + "\n".join(lines))
    with pytest.raises(RunFileError, match=r"text \('0,\d+' in row 0; csv.decimal: ',' in the map takes a comma"):
        bring(tmp_path / "data.csv", ROTARY)
    bring(tmp_path / "data.csv", changed(csv={"delimiter": ";", "decimal": ","}))


def test_a_missing_column_does_not_list_a_hundred_names(tmp_path: Path) -> None:
    savemat(tmp_path / "data.mat", {f"channel_{n:03}": TIME for n in range(100)})
    with pytest.raises(RunFileError, match=r"no such column; .* and 88 more") as refusal:
        bring(tmp_path / "data.mat", ROTARY)
    assert "channel_011" in str(refusal.value)
    assert "channel_012" not in str(refusal.value)


WRONG_FILES: dict[str, tuple[dict[str, Any], dict[str, NDArray[Any]], str]] = {
    "name": (changed(current={"column": "I_m"}), {"i_m": CURRENT}, "current.column = I_m: no such column; did you mean i_m"),
    "number": (changed(current={"column": 7}), {}, "current.column = 7: no such column; the file has columns 0 to 2"),
    "text": (changed(), {"i": np.array(["a"] * N)}, r"i: the column holds text \('a' in row 0\), not numbers"),
    "nan": (changed(), {"i": np.where(TIME[9] == TIME, np.nan, CURRENT)}, "missing or not finite, first in row 9"),
    "huge": (changed(), {"q": 1e300 * CURRENT}, "counts are more than a position can have"),
    "span": (changed(from_s=100.0), {}, "from_s and until_s leave fewer than 2 samples"),
    "resolution": (changed(position={"column": "q"}, encoder=None), {}, "position.resolution is missing"),
    "counts": (changed(encoder=None), {}, "position.unit = count needs encoder.counts_per_rev"),
    "kind": (changed(model="delta"), {}, "describes a linear one"),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG_FILES)
def test_wrong_file(name: str, tmp_path: Path) -> None:
    mapping, columns, statement = WRONG_FILES[name]
    with pytest.raises(RunFileError, match=statement) as caught:
        bring(parquet(tmp_path, **columns), mapping)
    assert str(caught.value).startswith(str(tmp_path))
    assert not (tmp_path / "run.arrow").exists()


def test_columns_of_different_lengths(tmp_path: Path) -> None:
    savemat(tmp_path / "data.mat", {"t": TIME, "q": COUNTS[:-1], "i": CURRENT})
    with pytest.raises(RunFileError, match="different lengths: time 400, position 399, current 400"):
        bring(tmp_path / "data.mat", ROTARY)


WRONG_CSV: dict[str, tuple[str, str]] = {
    "header only": ("t,q,i\n", "position.column = q: the column is empty"),
    "decimal comma": ("t;q;i\n0,1;1;0,5\n", r"text \('0,1' in row 0; csv.decimal: ',' in the map"),
    "names": ("t,q,i,j\n0,1,2\n1,2,3\n", r"4 names, but 3 columns of values \(csv.delimiter is ','"),
    "a word": ("t,q,i\n0,1,2\n1,2,off\n", r"the column holds text \('off' in row 1\)"),
    "one row": ("t,q,i\n0,1,2\n", r"has 1 sample\(s\); a run needs at least 2"),
}


@pytest.mark.parametrize("name", WRONG_CSV)
def test_wrong_csv(name: str, tmp_path: Path) -> None:
    content, statement = WRONG_CSV[name]
    (tmp_path / "data.csv").write_text(content)
    with pytest.raises(RunFileError, match=statement):
        bring(tmp_path / "data.csv", ROTARY)


def test_a_value_that_is_none_is_found_in_every_kind_of_file(tmp_path: Path) -> None:
    current = CURRENT.copy()
    current[9] = np.nan
    table = np.stack([TIME, COUNTS, current])
    np.save(tmp_path / "data.npy", table)
    savemat(tmp_path / "data.mat", {"t": TIME, "q": COUNTS, "i": current})
    np.savetxt(tmp_path / "data.csv", table.T, delimiter=",", header="t,q,i", comments="")
    parquet(tmp_path, i=current)
    by_number = changed(
        time={"column": 0}, position={"column": 1, "unit": "count"}, current={"column": 2}, csv={"header": True}
    )
    for form in ("csv", "npy", "mat", "parquet"):
        with pytest.raises(RunFileError, match=r"current: 1 value\(s\) are missing or not finite, first in row 9"):
            bring(tmp_path / f"data.{form}", by_number if form == "npy" else ROTARY)


def test_what_was_read_is_told_in_si_units(tmp_path: Path) -> None:
    done = import_run(parquet(tmp_path), parse_map(ROTARY, "map.yaml"), tmp_path / "run.arrow")
    assert done.rate_hz == pytest.approx(1.0 / np.median(np.diff(TIME)))
    assert done.command == (CURRENT.min(), CURRENT.max())
    assert done.position == pytest.approx((COUNTS.min() * done.resolution, COUNTS.max() * done.resolution))
    assert (done.is_linear, done.is_force) == (False, False)


@pytest.mark.parametrize("name", ["data.csv", "data.npy", "data.mat", "data.parquet"])
def test_rubbish(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(b"\x00\x01\x02rubbish\n1,2\n")
    with pytest.raises(RunFileError, match=name):
        bring(tmp_path / name, ROTARY)


def test_unknown_kinds_of_file(tmp_path: Path) -> None:
    with pytest.raises(RunFileError, match=r"cannot import \.xlsx; \.csv, \.txt, .* \.parquet can"):
        bring(tmp_path / "data.xlsx", ROTARY)
    with pytest.raises(RunFileError, match="no such file"):
        bring(tmp_path / "data.csv", ROTARY)


def test_nothing_is_overwritten_unasked(tmp_path: Path) -> None:
    (tmp_path / "run.arrow").write_text("mine")
    with pytest.raises(FileExistsError, match="--force to replace it"):
        import_run(parquet(tmp_path), parse_map(ROTARY, "map.yaml"), tmp_path / "run.arrow")
    assert (tmp_path / "run.arrow").read_text() == "mine"


def test_the_source_is_never_overwritten(tmp_path: Path) -> None:
    source = parquet(tmp_path)
    before = source.read_bytes()
    (tmp_path / "run.arrow").hardlink_to(source)
    for out in (source, tmp_path / "run.arrow"):
        for force in (False, True):
            with pytest.raises(FileExistsError, match=f"{out.name} is the file that is read; give another name"):
                import_run(source, parse_map(ROTARY, "map.yaml"), out, force=force)
    assert source.read_bytes() == before


def test_a_name_that_is_not_utf8_is_no_matter_where_columns_have_numbers(tmp_path: Path) -> None:
    lines = [f"{t!r},{q},{i!r}" for t, q, i in zip(TIME.tolist(), COUNTS.tolist(), CURRENT.tolist(), strict=True)]
    path = tmp_path / "data.csv"
    path.write_text("Zeit,Winkel (°),Strom\n" + "\n".join(lines), encoding="latin1")
    latin1 = r"data.csv is not UTF-8 \(Latin-1\?\); 'iconv -f latin1 -t utf-8 data.csv > utf8.csv' converts it"
    numbers = {"time": {"column": 0}, "position": {"column": 1, "unit": "count"}, "current": {"column": 2}}
    with pytest.raises(RunFileError, match=latin1):
        bring(path, ROTARY)
    check_plain(bring(path, changed(**numbers)))
    check_plain(bring(path, changed(csv={"header": False, "skip_lines": 1}, **numbers)))


@pytest.mark.parametrize("code", ["utf-16", "utf-16-le", "utf-16-be"])
def test_utf16_is_called_so(tmp_path: Path, code: str) -> None:
    (tmp_path / "data.csv").write_text("t,q,i\n0,1,2\n1,2,3\n", encoding=code)
    with pytest.raises(RunFileError, match=r"data.csv is not UTF-8 \(UTF-16\?\); 'iconv -f utf-16 -t utf-8 data.csv"):
        bring(tmp_path / "data.csv", ROTARY)


WRONG_MAPS: dict[str, tuple[dict[str, Any], str]] = {
    "unknown key": (changed(encodr={}), "map.yaml: encodr: unknown key; did you mean encoder?"),
    "inner key": (changed(time={"colum": "t"}), "map.yaml: time.colum: unknown key; did you mean time.column?"),
    "missing": (changed(position=None), "map.yaml: position: is missing"),
    "unit": (changed(time={"column": "t", "unit": "msec"}), "map.yaml: time.unit = msec: must be one of s, ms, us"),
    "both": (changed(force={"column": "f"}, torque_constant=1), "map.yaml: current: needs either current or force"),
    "no time": (changed(time={}), "map.yaml: time: needs either column (time stamps) or rate_hz"),
    "constant": (changed(current=None, force={"column": "i"}), "map.yaml: torque_constant: is missing"),
    "encoder": (changed(encoder={"counts_per_metre": 5}), "map.yaml: encoder.counts_per_metre = 5: a rotary device"),
    "sign": (changed(current={"column": "i", "sign": 2}), "map.yaml: current.sign = 2: must be 1 or -1"),
    "zero": (changed(every=0), "map.yaml: every = 0: must be at least 1"),
    "column": (
        changed(current={"column": 1.5}),
        "map.yaml: current.column = 1.5: must be a column's name or its number",
    ),
    "text": (changed(time="t"), "map.yaml: time = t: must be a mapping, such as {column: name}"),
}


@pytest.mark.parametrize("name", WRONG_MAPS)
def test_wrong_map(name: str) -> None:
    mapping, statement = WRONG_MAPS[name]
    with pytest.raises(ConfigError) as caught:
        parse_map(mapping, "map.yaml")
    assert statement in str(caught.value)


def test_a_map_file_with_a_key_given_twice(tmp_path: Path) -> None:
    (tmp_path / "map.yaml").write_text("device: rotary\ndevice: linear\n")
    with pytest.raises(ConfigError, match="given twice"):
        load_map(tmp_path / "map.yaml")


def test_every_key_is_documented() -> None:
    page = (Path(__file__).parents[2] / "docs/reference/import-map.md").read_text()
    assert [key for key in map_keys() if f"`{key}`" not in page] == []
