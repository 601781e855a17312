"""Frequency responses of a recorded excitation: the device and the rendered impedance, compared with the model.

The excitation e(t), a torque or force, is the command without the part of the rendered spring. It is known exactly and does
not depend on the loop, so as a reference it gives estimates without bias in closed loop (T. Söderström and P. Stoica,
"System Identification", 1989, ch. 10). S are cross spectra by Welch's method, X is the encoder's motion, U the whole
command, and h the zero-order hold of the converter with the loop's delay:

    device   X/(h U)    = S_ex / (h S_eu),     of a free device 1/(m s² + b s)
    felt     Z = h E/(s X) = h S_ee / (s S_ex),  `hapticd.stability.linear_loop.impedance` without ticks and friction

The model's responses come from a simulation of the same excitation with the run's config, quantisation and friction
included, by the same estimate. The linear theory is shown for comparison.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from scipy.signal import coherence, csd

from hapticd.config import Config, parse_config
from hapticd.record import RunFileError
from hapticd.record.schema import FLAG_EXCITATION
from hapticd.servo.simulate import simulate
from hapticd.stability.damping import velocity_filter
from hapticd.stability.linear_loop import impedance
from hapticd.stability.numbers import loop_from_config

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from hapticd.record import Run
    from hapticd.stability.numbers import Loop

    FloatArray = NDArray[np.float64]
    ComplexArray = NDArray[np.complex128]

FEWEST_ROWS: Final = 1024
_SEGMENTS: Final = 8
"""Number of half-overlapping segments: enough for a meaningful coherence, few enough for low frequencies."""
_LONGEST: Final = 1 << 14
_EXCITED: Final = 1e-3
"""Least spectral density of the excitation at a frequency, as a share of the largest."""
_HIGHEST: Final = 0.4
"""Highest frequency, as a share of the servo rate: above it the zero-order hold distorts a sine too much."""
SEEN: Final = 0.8
"""Least coherence at which measurement and model are compared."""


@dataclass(frozen=True)
class Response:
    """Responses at m frequencies; in rad/(N m) and N m s/rad, or m/N and N s/m.

    Attributes:
        hz: (m,). device, felt: (m,) complex. device_coherence: (m,) of the whole command with the motion.
        felt_coherence: (m,) of the excitation with the motion.
    """

    hz: FloatArray
    device: ComplexArray
    felt: ComplexArray
    device_coherence: FloatArray
    felt_coherence: FloatArray


@dataclass(frozen=True)
class Curve:
    """One response, m frequencies.

    Attributes:
        title: name of the response. unit: of its magnitude.
        measured, theory: (m,) complex. coherence: (m,) of the measurement.
        simulated: (m,) of the model by the same estimate; None if its simulation ended in a fault.
    """

    title: str
    unit: str
    measured: ComplexArray
    coherence: FloatArray
    simulated: ComplexArray | None
    theory: ComplexArray

    @property
    def document(self) -> dict[str, Any]:
        """In numbers."""
        model = {} if self.simulated is None else {"model": _polar(self.simulated)}
        against = self.theory if self.simulated is None else self.simulated
        return {
            "unit": self.unit,
            **_polar(self.measured),
            "coherence": self.coherence,
            **model,
            "theory": _polar(self.theory),
            "difference": difference(self.measured, against, self.coherence),
        }


@dataclass(frozen=True)
class Bode:
    """The responses of a run and of its model.

    Attributes:
        name: of the run's file. hz: (m,) frequencies. device: response of the device. impedance: rendered impedance.
        filled: number of ticks without a row in the run.
    """

    name: str
    hz: FloatArray
    device: Curve
    impedance: Curve
    filled: int

    @property
    def document(self) -> dict[str, Any]:
        """The document of ``hapticd plot --bode --json``."""
        parts = {"device": self.device.document, "impedance": self.impedance.document}
        return {"hz": self.hz, "filled": self.filled, **parts}


def bode(run: Run, model: Config | None = None) -> Bode:
    """The frequency responses of a run with an excitation.

    Args:
        run: from `hapticd.record.read_run`. model: instead of the run's config.

    Raises:
        RunFileError: it has no excitation, a too short one, or no encoder counts and currents.
        ConfigError: its config is invalid.
    """
    needed = ("tick", "encoder_counts", "current_command_A", "force_command", "flags")
    if missing := [name for name in needed if name not in run.columns]:
        raise RunFileError(f"{run.path} has no column {missing[0]}: a frequency response needs a recording of hapticd")
    played = np.flatnonzero(run.columns["flags"] & FLAG_EXCITATION)
    if played.size < FEWEST_ROWS:
        raise RunFileError(
            f"{run.path} has {played.size} rows with an excitation, and a frequency response needs {FEWEST_ROWS}: "
            "'hapticd excite chirp' records one"
        )
    stored = run.metadata.get("config")
    if not stored and model is None:
        raise RunFileError(f"{run.path} carries no config: name the device's with --config")
    own = parse_config(stored, f"config of {run.path.name}") if stored else model
    assert own is not None
    latency_s = run.metadata.get("latency_s")
    loop = loop_from_config(model or own, float(latency_s) if isinstance(latency_s, int | float) else 0.0)
    part = slice(int(played[0]), int(played[-1]) + 1)
    columns = {name: np.asarray(run.columns[name][part], dtype=np.float64) for name in needed}
    ticks = columns["tick"]
    grid = np.arange(ticks[0], ticks[-1] + 1)
    held = np.searchsorted(ticks, grid, side="right") - 1
    gain = own.amplifier.torque_constant
    commanded = gain * columns["current_command_A"][held]
    added = commanded - columns["force_command"][held]
    position = np.interp(grid, ticks, columns["encoder_counts"]) * own.raw_resolution
    measured = _estimate(added, commanded, position, loop)
    simulated = _simulated(model or own, added, measured.hz, loop)
    s = 2j * np.pi * measured.hz
    free = 1.0 / (loop.inertia * s * s + loop.viscous * s)
    felt = impedance(loop, velocity_filter((model or own).spring, loop.period), measured.hz)
    units = ("m/N", "N s/m") if own.is_linear else ("rad/(N m)", "N m s/rad")
    return Bode(
        name=run.path.name,
        hz=measured.hz,
        device=Curve(
            "Device",
            units[0],
            measured.device,
            measured.device_coherence,
            None if simulated is None else simulated.device,
            free,
        ),
        impedance=Curve(
            "Rendered impedance, as it is felt",
            units[1],
            measured.felt,
            measured.felt_coherence,
            None if simulated is None else simulated.felt,
            felt,
        ),
        filled=int(grid.size - ticks.size),
    )


def _simulated(config: Config, added: FloatArray, hz: FloatArray, loop: Loop) -> Response | None:
    """The responses of the model to the same excitation, at the same frequencies."""
    blocks: list[NDArray[Any]] = []
    gain = config.amplifier.torque_constant
    report = simulate(
        config,
        added.size * config.period,
        deflection=0.5 / config.encoder.decimation,
        energies=False,
        excitation=np.vstack([added / gain, np.zeros(added.size)]),
        on_rows=lambda rows: blocks.append(rows.copy()),
    )
    if report["fault"] or report["ticks"] < added.size:
        return None
    rows = np.concatenate(blocks)
    commanded = gain * rows["current_command_A"]
    return _estimate(
        commanded - rows["force_command"], commanded, rows["encoder_counts"] * config.raw_resolution, loop, hz
    )


def _estimate(
    added: FloatArray, commanded: FloatArray, position: FloatArray, loop: Loop, only: FloatArray | None = None
) -> Response:
    """Device response and rendered impedance from signals at every tick, (n,), at the excited or at given frequencies."""
    rate = 1.0 / loop.period
    segment = int(min(_LONGEST, max(FEWEST_ROWS // 4, 2 * added.size // (_SEGMENTS + 1))))
    how: dict[str, Any] = {"fs": rate, "nperseg": segment, "detrend": "linear"}
    hz, power = csd(added, added, **how)
    excited = np.real(power)
    if only is None:
        kept = (hz > 0.0) & (hz <= _HIGHEST * rate) & (excited > _EXCITED * excited.max(initial=0.0))
    else:
        kept = np.isin(hz, only)
    motion, effort = csd(added, position, **how)[1][kept], csd(added, commanded, **how)[1][kept]
    s = 2j * np.pi * hz[kept]
    hold = (1.0 - np.exp(-s * loop.period)) / (s * loop.period) * np.exp(-s * loop.delay)
    with np.errstate(divide="ignore", invalid="ignore"):
        return Response(
            hz=hz[kept],
            device=motion / (hold * effort),
            felt=hold * excited[kept] / (s * motion),
            device_coherence=coherence(commanded, position, **how)[1][kept],
            felt_coherence=coherence(added, position, **how)[1][kept],
        )


def _polar(values: ComplexArray) -> dict[str, FloatArray]:
    return {"magnitude": np.abs(values), "phase_deg": np.degrees(np.angle(values))}


def difference(found: ComplexArray, model: ComplexArray, agreement: FloatArray) -> dict[str, float | int | None]:
    """RMS difference of two responses in dB and degrees, where the coherence is at least `SEEN`; and their number."""
    seen = (agreement >= SEEN) & np.isfinite(found) & np.isfinite(model) & (found != 0) & (model != 0)
    if not seen.any():
        return {"magnitude_db": None, "phase_deg": None, "frequencies": 0}
    ratio = found[seen] / model[seen]
    return {
        "magnitude_db": float(np.sqrt(np.mean((20.0 * np.log10(np.abs(ratio))) ** 2))),
        "phase_deg": float(np.sqrt(np.mean(np.degrees(np.angle(ratio)) ** 2))),
        "frequencies": int(seen.sum()),
    }
