"""A user's own simulator as the nominal model: ``torque(x, v, i, t)`` in Python or an FMU, to which effects are added.

It returns the total torque on the inertia, the motor's included, at a position, velocity, motor current and time. Its
difference to the config is computed along the recorded motion, and is a known torque in every fit.
"""

from __future__ import annotations

import importlib
import importlib.util
import math
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, cast

import numpy as np

from drivers import declared_latency
from hapticd.export.axis_numbers import axis_numbers
from hapticd.export.plain.axis import Axis
from hapticd.gap._own_fmu import FmuTorque
from hapticd.gap.balance import CUTOFF_HZ, MOVING
from hapticd.plant.effect_terms import torque_constant
from hapticd.plant.electrical import electrical
from hapticd.plant.layout import device_vector

if TYPE_CHECKING:
    from hapticd.config import Config
    from hapticd.gap.recording import Recording

Torque = Callable[[float, float, float, float], float]
"""Total torque or force at a position [rad or m], velocity, motor current [A] and time [s]."""

_BARELY = 1e-9
"""Speed near zero, as a share of the slowest visible motion: the mean over both directions cancels friction at rest."""


def find_torque(name: str) -> Torque:
    """The function of ``module:function``, ``file.py:function`` or ``file.fmu`` (`FmuTorque`); the module is imported.

    Raises:
        ValueError: there is no such module, function or FMU, or it cannot be imported.
    """
    if name.endswith(".fmu") or ".fmu:" in name:
        return FmuTorque(name)
    place, _, function = name.rpartition(":")
    if not place or not function.isidentifier():
        raise ValueError(f"{name!r} is not a function; write module:function, file.py:function or file.fmu")
    try:
        module = _of_file(Path(place)) if place.endswith(".py") else importlib.import_module(place)
    except Exception as error:
        raise ValueError(f"{place} cannot be imported: {type(error).__name__}: {error}") from error
    found = getattr(module, function, None)
    if not callable(found):
        raise ValueError(f"{place} has no function {function!r}")
    return cast("Torque", found)


def _of_file(path: Path) -> object:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    if spec is None or spec.loader is None or not path.exists():
        raise FileNotFoundError(f"no such file: {path}")
    module = importlib.util.module_from_spec(spec)
    sys.modules.setdefault(path.stem, module)  # dataclasses look it up there
    spec.loader.exec_module(module)
    return module


def with_simulator(recording: Recording, model: Config, torque: Torque) -> Recording:
    """A recording with the difference between a simulator and the model as a known torque.

    Position and velocity come from the recorded position with a zero-phase filter; the motor current is the model's for the
    recorded command. At rest, or if the motion is too slow to know its direction, the mean over both directions is used:
    stiction is the model's.

    Args:
        recording: of the device.
        model: the config, for inertia, amplifier, encoder, and the friction to subtract.
        torque: the simulator.

    Raises:
        ValueError: the function raises, or returns no finite number.
    """
    from scipy.signal import butter, sosfiltfilt

    time_s, T = recording.time_s, recording.period_s
    cutoff = min(CUTOFF_HZ, 0.1 / T)
    grid = np.arange(time_s[0], time_s[-1] + 0.5 * T, T)
    sos = butter(2, cutoff, fs=1.0 / T, output="sos")
    smooth = sosfiltfilt(sos, np.interp(grid, time_s, recording.position))
    middle = time_s + 0.5 * np.diff(time_s, append=time_s[-1] + T)
    x, v = np.interp(middle, grid, smooth), np.interp(middle, grid, np.gradient(smooth, T))
    p = device_vector(model, declared_latency(model)[0])
    current = np.empty((recording.rows, 1))
    electrical(p, time_s, recording.current.copy(), np.zeros(recording.rows, dtype=np.uint8), 1, current)
    slowest = MOVING * max(recording.resolution, 1e-12) * cutoff
    own = Axis(axis_numbers(model)).torque
    more = np.empty(recording.rows)
    for k, (at, speed, i, t) in enumerate(
        zip(x.tolist(), v.tolist(), current[:, 0].tolist(), middle.tolist(), strict=True)
    ):
        speeds = (speed,) if abs(speed) >= slowest else (_BARELY * slowest, -_BARELY * slowest)
        more[k] = sum(_asked(torque, at, each, i, t) - own(at, each, i, t) for each in speeds) / len(speeds)
    return replace(recording, added=more / float(torque_constant(p)))


def _asked(torque: Torque, x: float, v: float, i: float, t: float) -> float:
    where = f"torque({x:.6g}, {v:.6g}, {i:.6g}, {t:.6g})"
    try:
        value = float(torque(x, v, i, t))
    except Exception as error:
        raise ValueError(f"{where} raised {type(error).__name__}: {error}") from error
    if not math.isfinite(value):
        raise ValueError(f"{where} is {value}")
    return value
