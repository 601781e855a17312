"""An FMU of FMI 3.0, compiled here, as the nominal model."""

from __future__ import annotations

import re
import shutil
import subprocess
import zipfile
from pathlib import Path

import pytest

from hapticd.gap.own_simulator import find_torque

DESCRIPTION = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="lab" instantiationToken="{{lab}}">
  {interface}
  <ModelVariables>
    <Float64 name="time" valueReference="4" causality="independent" variability="continuous"/>
    <{given} name="x" valueReference="0" causality="input" start="0"/>
    <{given} name="v" valueReference="1" causality="input" start="0"/>
    <{given} name="i" valueReference="2" causality="input" start="0"/>
    <{told} name="torque" valueReference="3" causality="output"{more}
  </ModelVariables>
  <ModelStructure><Output valueReference="3"/></ModelStructure>
</fmiModelDescription>
"""
CO_SIMULATION = '<CoSimulation modelIdentifier="lab" canHandleVariableCommunicationStepSize="true"/>'
ASKED = [(0.1, 2.0, 0.3, 0.0), (0.1, -2.0, 0.3, 0.0), (3.0, 9.0, -1.0, 2.0), (0.0, 1.0, 0.0, 0.1)]


def _fmu(
    folder: Path,
    given: str = "Float64",
    told: str = "Float64",
    more: str = "/>",
    interface: str = CO_SIMULATION,
) -> Path:
    """An FMU whose inputs and output have these types; its functions for others refuse."""
    fmpy = pytest.importorskip("fmpy")
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None:
        pytest.skip("no C compiler")
    library = folder / "lab.so"
    kinds = [f"-DKIND_OF_INPUT=kind{given}", f"-DKIND_OF_TORQUE=kind{told}"]
    headers = Path(fmpy.__file__).parent / "c-code"
    source, rest = Path(__file__).with_name("fmi3.c"), folder / "rest.c"
    names = set(re.findall(r"fmi3\w+(?=;)", (headers / "fmi3Functions.h").read_text()))
    rest.write_text("".join(f"__attribute__((weak)) int {name}(void) {{ return 3; }}\n" for name in sorted(names)))
    done = subprocess.run(
        [compiler, "-shared", "-fPIC", *kinds, f"-I{headers}", str(source), str(rest), "-o", str(library)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    path = folder / "lab.fmu"
    with zipfile.ZipFile(path, "w") as file:
        text = DESCRIPTION.format(interface=interface, given=given, told=told, more=more)
        file.writestr("modelDescription.xml", text)
        file.write(library, "binaries/x86_64-linux/lab.so")
    return path


@pytest.mark.parametrize(("given", "told"), [("Float64", "Float64"), ("Float32", "Float64"), ("Float64", "Float32")])
def test_an_fmu_of_fmi_3_is_taken(tmp_path: Path, given: str, told: str) -> None:
    torque = find_torque(str(_fmu(tmp_path, given, told)))
    right = [0.0292 * i - 9e-6 * v - 1e-4 * x + 1e-3 * t for x, v, i, t in ASKED]
    assert [torque(*each) for each in ASKED] == pytest.approx(right, rel=1e-5, abs=1e-9)


def test_an_array_is_no_torque(tmp_path: Path) -> None:
    path = _fmu(tmp_path, more='><Dimension start="2"/></Float64>')
    with pytest.raises(ValueError, match=r"has no variable 'torque'; its inputs: x, v, i; its outputs: none"):
        find_torque(str(path))


def test_model_exchange_is_refused_with_its_version(tmp_path: Path) -> None:
    path = _fmu(tmp_path, interface='<ModelExchange modelIdentifier="lab"/>')
    with pytest.raises(ValueError, match=r"lab\.fmu is of FMI 3\.0 and not for co-simulation; one of FMI 2\.0 or 3\.0"):
        find_torque(str(path))
