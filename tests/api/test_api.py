"""The public Python API: what it returns, against the command line's own answers and against the motion it describes."""

from __future__ import annotations

import inspect
import os
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

import hapticd
from hapticd.config.units import UnitError
from hapticd.gap.errors import RecordingError
from hapticd.record import RunFileError
from tests.cli.conftest import Run as CommandLine
from tests.cli.conftest import hapticd as command_line

__all__ = ["command_line"]

ROOT = Path(__file__).parents[2]
COARSE = {"encoder.decimation": 217}


@pytest.fixture(scope="module")
def run() -> hapticd.Run:
    return hapticd.simulate("re35", "400ms", deflection=20.3, settings=COARSE)


def test_importing_hapticd_loads_nothing_heavy() -> None:
    program = (
        "import sys, hapticd\n"
        "heavy = {'numpy', 'numba', 'pydantic', 'pyarrow', 'pandas', 'scipy', 'matplotlib'} & set(sys.modules)\n"
        "assert not heavy, heavy\n"
        "assert set(hapticd.__all__) <= set(dir(hapticd))\n"
        "assert hapticd.Client().socket_path.name.endswith('.sock')\n"
        "assert not {'numpy', 'numba', 'pyarrow'} & set(sys.modules)\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_a_strange_package_named_drivers_is_named(tmp_path: Path) -> None:
    (tmp_path / "drivers").mkdir()
    (tmp_path / "drivers/__init__.py").write_text("raise SystemExit('nothing of it may run')")
    program = "import hapticd; hapticd.check"
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=tmp_path, env=environment, capture_output=True, text=True
    )
    assert done.returncode == 1
    assert f"another package named 'drivers' in {tmp_path} stands before hapticd's own" in done.stderr


def test_every_public_name_is_there_and_documented() -> None:
    for name in hapticd.__all__:
        assert inspect.getdoc(getattr(hapticd, name)), name
    with pytest.raises(AttributeError, match="no attribute 'gaps'"):
        hapticd.gaps  # noqa: B018


def test_the_reference_page_has_every_public_name() -> None:
    page = (ROOT / "docs/reference/api.md").read_text()
    shown = {line.removeprefix("::: hapticd.").split(".")[0] for line in page.splitlines() if line.startswith(":::")}
    assert shown == set(hapticd.__all__)


def test_a_simulation_is_what_the_command_line_writes(
    run: hapticd.Run, command_line: CommandLine, tmp_path: Path
) -> None:
    path = tmp_path / "run.arrow"
    words = ("--duration", "0.4", "--deflection", "20.3", "--set", "encoder.decimation=217", "-o", str(path))
    assert command_line("simulate", *words).code == 0
    written = hapticd.load(path)
    assert written.rows == run.rows == 400
    for name, values in written.columns.items():
        np.testing.assert_array_equal(run.columns[name], values)
    assert written.units.items() <= run.units.items()


def test_the_trajectory_is_the_true_motion_behind_the_counts(run: hapticd.Run) -> None:
    raw = 2 * np.pi / 8192
    position, velocity = run.columns["true_position"], run.columns["true_velocity"]
    np.testing.assert_array_equal(np.floor(position / raw + 1e-9), run.columns["encoder_counts"])
    assert position[0] == pytest.approx(20.3 * 217 * raw, rel=1e-12)
    assert velocity[0] == 0.0
    # trapezoids of the velocity are the position, to the third power of the period
    moved = np.cumsum(0.5 * (velocity[1:] + velocity[:-1]) * 1e-3)
    assert np.max(np.abs(position[1:] - position[0] - moved)) < 2e-3 * np.ptp(position)
    assert run.units["true_velocity"] == "rad/s"
    assert run.metadata["simulation"]["outcome"] in ("monotone", "decaying")


def test_units_and_settings(run: hapticd.Run) -> None:
    angle = 20.3 * 217 * 2 * np.pi / 8192
    same = hapticd.simulate({"encoder": {"decimation": 217}}, 0.4, deflection=f"{angle!r}rad")
    np.testing.assert_allclose(same.columns["true_position"], run.columns["true_position"], atol=1e-9)
    with pytest.raises(UnitError, match="the device is rotary"):
        hapticd.simulate(deflection="2mm")
    both = hapticd.simulate(
        {"encoder": {"decimation": 217}}, 0.1, deflection=1, velocity=0.5
    )  # as `check` shows a start
    tick = 217 * 2 * np.pi / 8192
    assert both.columns["true_position"][0] == pytest.approx(tick)
    assert both.columns["true_velocity"][0] == pytest.approx(500 * tick)
    with pytest.raises(hapticd.ConfigError, match=r"spring\.stiffness"):
        hapticd.simulate(settings={"spring.stifness": 1})


def test_a_frame_has_units(run: hapticd.Run) -> None:
    frame = run.to_pandas()
    assert frame.index.name == "time_s"
    assert frame.attrs["units"]["current_command_A"] == "A"
    assert len(frame) == run.rows
    np.testing.assert_array_equal(frame["ticks"].to_numpy(), run.columns["ticks"])


def test_a_dataset_has_units_and_can_be_written_as_netcdf(run: hapticd.Run) -> None:
    dataset = run.to_xarray()
    assert dataset["current_command_A"].attrs["units"] == "A"
    assert "commanded" in dataset["current_command_A"].attrs["long_name"]
    assert dataset["time_s"].attrs["units"] == "s"
    assert float(dataset["true_position"].sel(time_s=0.0)) == run.columns["true_position"][0]
    assert all(isinstance(value, str) for value in dataset.attrs.values())


def test_check_says_what_the_command_line_says(command_line: CommandLine) -> None:
    found = hapticd.check(settings={**COARSE, "servo.rate_hz": 100}, deflection=10.3)
    words = ("--set", "servo.rate_hz=100", "--set", "encoder.decimation=217", "--deflection", "10.3")
    said = command_line("check", *words, "--json")
    assert said.code == 1
    assert found.verdict == said.document["verdict"] == "unstable"
    assert found.region == "D"
    document = said.document
    for key in ("mu", "beta", "sigma", "velocity_limit", "changes", "guard", "warnings"):
        assert found.document[key] == document[key], key
    assert "One of these changes" in str(found)


def test_load_takes_names_and_says_what_is_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    with pytest.raises(RunFileError, match="0 recording"):
        hapticd.load("@last")
    with pytest.raises(RunFileError, match="cannot read"):
        hapticd.load(tmp_path / "x.arrow")


def test_plot_draws(run: hapticd.Run) -> None:
    assert len(hapticd.plot(run, run, only=["trace", "difference"]).axes) == 4


def test_a_public_name_is_there_whatever_was_imported_before() -> None:
    import hapticd.gap.constants

    assert "refit_base" in inspect.signature(hapticd.find_gap).parameters
    assert hapticd.gap.constants is sys.modules["hapticd.gap.constants"]
    assert not [name for name in hapticd.__all__ if f"hapticd.{name}" in sys.modules]
    with pytest.raises(ValueError, match="no recording"):
        hapticd.find_gap([])


def test_gap_of_a_run_that_moves_in_one_place_only_has_an_answer() -> None:
    measured = hapticd.simulate("re35", 1.5, deflection=300.3, settings={"plant.viscous": 2.5e-5})
    assert hapticd.find_gap(measured, "re35", effects=["viscous_friction"]).verdict


def test_identify_measures_a_device_into_a_config(tmp_path: Path) -> None:
    measured = hapticd.simulate("re35", "6s", excitation="chirp", settings={"spring.stiffness": 0.002})
    found = hapticd.identify_plant(measured, settings={"plant.inertia": 1e-4}, out=tmp_path / "rig.yaml")
    assert found.inertia.value == pytest.approx(6.28e-6, rel=0.02)
    sure = hapticd.check(tmp_path / "rig.yaml").confidence
    assert sure is not None
    assert 0.0 < sure.stable <= 1.0
    assert hapticd.check("re35").confidence is None
    with pytest.raises(ValueError, match="no recording"):
        hapticd.identify_plant([])


def test_gap_finds_a_wrong_friction() -> None:
    real = {"plant.viscous": 2.5e-5, "spring.stiffness": 0.002}
    measured = hapticd.simulate("re35", "4s", excitation="steps", settings=real)
    other = hapticd.simulate("re35", "2s", excitation="chirp", settings=real)
    found = hapticd.find_gap(measured, "re35", effects=["viscous_friction"], validate=other)
    assert [step.effect for step in found.steps] == ["viscous_friction"]
    assert found.validation is not None
    assert found.validation.verdict == "better"
    errors = found.validation.errors["free_run"]
    assert errors["after"] < 0.1 * errors["before"]
    with pytest.raises(RecordingError, match="a fitted recording is no test of the model"):
        hapticd.find_gap(measured, "re35", effects=["viscous_friction"], validate=measured)


class TestSweep:
    """Sweeps: rows in order, the same wherever they are computed."""

    VALUES: ClassVar[dict[str, list[float]]] = {
        "spring.stiffness": [0.006, 0.012],
        "encoder.decimation": [1, 217],
        "deflection": [3.3],
    }

    def test_rows_are_the_combinations_with_theory_and_simulation(self) -> None:
        frame = hapticd.sweep("re35", self.VALUES, duration="200ms", jobs=1)
        assert list(frame["spring.stiffness"]) == [0.006, 0.006, 0.012, 0.012]
        assert list(frame["encoder.decimation"]) == [1, 217, 1, 217]
        for _, row in frame.iterrows():
            settings = {key: row[key] for key in ("spring.stiffness", "encoder.decimation")}
            one = hapticd.check("re35", settings=settings, deflection=3.3)
            assert row["mu"] == one.document["mu"]
            run = hapticd.simulate("re35", 0.2, deflection=3.3, settings=settings)
            assert row["outcome"] == run.metadata["simulation"]["outcome"]
        assert frame.attrs["units"]["spring.stiffness"] == "N m/rad"

    def test_both_cores_give_the_same(self) -> None:
        alone = hapticd.sweep("re35", self.VALUES, duration=0.1, jobs=1)
        told: list[float] = []
        both = hapticd.sweep("re35", self.VALUES, duration=0.1, jobs=2, progress=told.append)
        assert alone.equals(both)
        assert told == [0.25, 0.5, 0.75, 1.0]

    def test_a_dask_client_gives_the_same(self) -> None:
        distributed = pytest.importorskip("distributed")
        with distributed.Client(processes=False, n_workers=1, threads_per_worker=2, dashboard_address=None) as client:
            there = hapticd.sweep("re35", self.VALUES, duration=0.1, client=client)
        assert there.equals(hapticd.sweep("re35", self.VALUES, duration=0.1, jobs=1))

    def test_a_function_adds_columns(self) -> None:
        def resolution(config: hapticd.Config) -> dict[str, float]:
            return {"resolution": config.resolution}

        frame = hapticd.sweep(None, {"encoder.decimation": [1, 2]}, function=resolution, jobs=1)
        assert frame["resolution"][1] == 2 * frame["resolution"][0]

    @pytest.mark.parametrize(
        ("values", "said"),
        [
            ({}, "nothing to sweep"),
            ({"spring.stiffness": []}, "spring.stiffness has no values"),
            ({"spring.stifness": [1]}, "spring.stiffness"),
            ({"spring.stiffness": [0.01, -1]}, "-1"),
            ({"deflection": [1], "velocity": [1]}, "not with both"),
        ],
    )
    def test_what_is_wrong_is_said_before_anything_is_computed(self, values: dict[str, list[float]], said: str) -> None:
        with pytest.raises((ValueError, hapticd.ConfigError)) as error:
            hapticd.sweep("re35", values)
        assert said in str(error.value)


def test_results_are_shown_in_a_line(run: hapticd.Run) -> None:
    assert repr(run).startswith("Run('simulation': 400 rows")
    found = hapticd.check("re35")
    assert repr(found) == f"Check(stable, region {found.region}, 0 changes, {len(found.warnings)} warnings)"
    assert str(found)[:20] in found._repr_html_()


def test_the_version_and_python_dash_m() -> None:
    assert hapticd.__version__ == version("hapticd")
    done = subprocess.run([sys.executable, "-m", "hapticd", "--version"], capture_output=True, text=True, check=True)
    assert done.stdout == f"hapticd {hapticd.__version__}\n"


def test_effect_pages_name_a_folder_that_cannot_be_made(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    program = [sys.executable, "-m", "hapticd.effects.pages"]
    done = subprocess.run([*program, str(tmp_path / "file/x"), "stribeck"], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    assert f"{tmp_path}/file/x: Not a directory" in done.stderr
    subprocess.run([*program, str(tmp_path / "new/x"), "stribeck"], check=True)
    assert (tmp_path / "new/x/stribeck.md").exists()
