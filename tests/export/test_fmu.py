"""The FMU is sound by fmpy's own check, and moves as hapticd's plant does."""

from __future__ import annotations

import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

from hapticd.export import ExportError, write_model
from tests.export.cases import PERIOD_S, POSITION, VELOCITY, commands, config_of, off_by, reference

SAMPLE = ("nothing", "several", "backlash", "encoder_eccentricity")
"""The motion of all others is that of the Python module, which is in the FMU."""


@pytest.mark.parametrize("case", SAMPLE)
def test_it_moves_as_the_plant_does(case: str, tmp_path: Path) -> None:
    pytest.importorskip("pythonfmu")
    fmpy = pytest.importorskip("fmpy")
    from fmpy.validation import validate_fmu

    config = config_of(case)
    (path,) = write_model(config, "fmu", tmp_path / "rig.fmu")
    assert validate_fmu(str(path)) == []
    current = commands()
    given = np.zeros(len(current), dtype=[("time", float), ("command", float)])
    given["time"], given["command"] = np.arange(len(current)) * PERIOD_S, current
    result = fmpy.simulate_fmu(
        str(path),
        stop_time=len(current) * PERIOD_S,
        step_size=PERIOD_S,
        output_interval=PERIOD_S,
        input=given,
        start_values={"initial_position": POSITION, "initial_velocity": VELOCITY},
        output=["position", "measured"],
    )
    right = reference(config)
    assert result["position"][0] == POSITION
    assert off_by(result["position"][1 : len(right) + 1], right) < 1e-3
    if case == "encoder_eccentricity":
        assert result["measured"][0] == pytest.approx(POSITION + 0.9 * np.sin(POSITION + 0.3))


def test_nothing_of_hapticd_is_in_it(tmp_path: Path) -> None:
    pytest.importorskip("pythonfmu")
    (path,) = write_model(config_of("stribeck"), "fmu", tmp_path / "rig.fmu")
    with zipfile.ZipFile(path) as archive:
        source = archive.read("resources/hapticd_axis.py").decode()
        about = archive.read("modelDescription.xml").decode()
    assert "import hapticd" not in source
    assert "from hapticd" not in source
    assert 'needsExecutionTool="true"' in about
    assert "Python 3.9" in about


def test_the_extra_is_named_where_it_is_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pythonfmu", None)
    with pytest.raises(ExportError, match=r"pip install 'hapticd\[export\]'"):
        write_model(config_of("nothing"), "fmu", tmp_path / "rig.fmu")
    assert not list(tmp_path.iterdir())
