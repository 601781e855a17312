"""A user's FMU as the nominal model: run by fmpy (extra ``export``), with inputs x, v and i and an output torque."""

from __future__ import annotations

import re
import shutil
import tempfile
import weakref
from importlib import import_module
from pathlib import Path
from typing import Any, Final

_INPUTS: Final = ("x", "v", "i")
_NAMES: Final = (*_INPUTS, "torque")
_PAIR: Final = re.compile(r"(x|v|i|torque)=(.+?)(?:,(?=(?:x|v|i|torque)=)|$)")
_NUMBERS: Final = ("Real", "Float64", "Float32")
_AGAIN_S: Final = 1e-9
"""Time step between two evaluations at one instant (both directions at rest) [s]."""


class FmuTorque:
    """The torque of an FMU for co-simulation (FMI 2.0 or 3.0), which steps from each instant to the next and has a state."""

    def __init__(self, name: str) -> None:
        """Read its description; it starts with the first evaluation.

        Args:
            name: ``file.fmu``, or ``file.fmu:x=shaft.phi,v=shaft.w,i=motor.i,torque=tau`` if its variables have other names
                than x, v, i and torque.

        Raises:
            ValueError: fmpy is not installed; the file is not an FMU for co-simulation, or lacks a variable.
        """
        file, _, given = name.partition(".fmu:")
        self._path = Path(file if file.endswith(".fmu") else f"{file}.fmu")
        pairs = _PAIR.findall(given)
        if ",".join(f"{ours}={theirs}" for ours, theirs in pairs) != given:
            raise ValueError(f"{given!r} is not a list of variables; write x=NAME,v=NAME,i=NAME,torque=NAME")
        try:
            self._fmpy: Any = import_module("fmpy")
        except ImportError as error:
            raise ValueError(
                f"an FMU is run by fmpy, which is not installed: pip install 'hapticd[export]' ({error})"
            ) from error
        if not self._path.is_file():
            raise ValueError(f"no such file: {self._path}")
        try:
            self._about = self._fmpy.read_model_description(str(self._path), validate=False)
        except Exception as error:  # fmpy raises various errors on a bad file
            raise ValueError(f"{self._path} is not a readable FMU: {type(error).__name__}: {error}") from error
        if self._about.coSimulation is None or self._about.fmiVersion == "1.0":
            what = "" if self._about.coSimulation is not None else " and not for co-simulation"
            raise ValueError(
                f"{self._path} is of FMI {self._about.fmiVersion}{what}; one of FMI 2.0 or 3.0 for co-simulation is needed"
            )
        self._is_2 = self._about.fmiVersion == "2.0"
        self._references = self._find(dict(pairs))
        self._folder = ""
        self._fmu: Any = None
        self._now = 0.0
        self._said = ""

    def _find(self, named: dict[str, str]) -> list[tuple[str, int]]:
        found = {
            each.name: each for each in self._about.modelVariables if each.type in _NUMBERS and not each.dimensions
        }
        inputs = [each.name for each in found.values() if each.causality == "input"]
        outputs = [each.name for each in found.values() if each.causality == "output"]
        for ours in _NAMES:
            theirs, known = named.get(ours, ours), inputs if ours in _INPUTS else list(found)
            if theirs not in known:
                raise ValueError(
                    f"{self._path} has no {'input' if ours in _INPUTS else 'variable'} {theirs!r}; its inputs: "
                    f"{', '.join(inputs) or 'none'}; its outputs: {', '.join(outputs) or 'none'}; name those meant: "
                    f"{self._path.name}:x=NAME,v=NAME,i=NAME,torque=NAME"
                )
        meant = [found[named.get(ours, ours)] for ours in _NAMES]
        return [(each.type, each.valueReference) for each in meant]

    def __call__(self, x: float, v: float, i: float, t: float) -> float:
        """Torque at a position, velocity, motor current [A] and time [s]; if time decreases, the FMU restarts."""
        if self._fmu is None or t < self._now - 2.0 * _AGAIN_S:
            self._start(t)
        step = max(t - self._now, _AGAIN_S)
        *inputs, (kind, output) = self._references
        try:
            for (its, reference), given in zip(inputs, (x, v, i), strict=True):
                getattr(self._fmu, f"set{its}")([reference], [given])
            self._fmu.doStep(self._now, step)
            value = float(getattr(self._fmu, f"get{kind}")([output])[0])
        except Exception as error:
            raise ValueError(f"{self._path.name}: {error} {self._said}".rstrip()) from error
        self._now += step
        return value

    def _start(self, t: float) -> None:
        self.close()
        if not self._folder:
            self._folder = tempfile.mkdtemp(prefix="hapticd-fmu-")
            weakref.finalize(self, shutil.rmtree, self._folder, ignore_errors=True)
            self._fmpy.extract(str(self._path), self._folder)
        try:
            self._fmu = import_module("fmpy.simulation").instantiate_fmu(
                self._folder, self._about, "CoSimulation", logger=self._log
            )
            if self._is_2:
                self._fmu.setupExperiment(startTime=t)
                self._fmu.enterInitializationMode()
            else:
                self._fmu.enterInitializationMode(startTime=t)
            self._fmu.exitInitializationMode()
        except Exception as error:
            raise ValueError(f"{self._path.name} does not start: {error} {self._said}".rstrip()) from error
        self._now = t

    def _log(self, *words: Any) -> None:
        """Keep its last message for the error text; it must not write to standard output."""
        said = words[-1]
        self._said = said.decode(errors="replace") if isinstance(said, bytes) else str(said)

    def close(self) -> None:
        """Stop the FMU; the next evaluation restarts it."""
        if self._fmu is not None:
            self._fmu.terminate()
            self._fmu.freeInstance()
            self._fmu = None
