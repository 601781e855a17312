"""Case (b) of Fig. 8 with dither: whether the shaft comes to rest, and the largest oscillation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from hapticd.config import apply_settings
from hapticd.reproduce.items import Cell, Table
from hapticd.reproduce.release import CASES, config_of
from hapticd.stability.explore import Effort, explore
from hapticd.stability.explored import Explored

#: Raw counts per coarse tick: of case (b), and a third of it, for σ = 0.3 instead of 0.1.
_DECIMATIONS: Final = (2172, 724)
_AMPLITUDES: Final = (0.1, 0.5, 1.0)
#: Target, waveform and frequency of the dither in Hz: below and above the limit cycles of case (b).
_KINDS: Final = (
    ("position", "sine", 20.0), ("position", "sine", 250.0), ("position", "square", 250.0), ("position", "uniform", 0.0),
    ("current", "sine", 20.0), ("current", "sine", 250.0), ("current", "uniform", 0.0),
)  # fmt: skip
_EFFORT: Final = Effort(starts=256, periods=1_500_000, horizon=10_000)


def dithered(decimation: int, kind: tuple[str, str, float] | None, amplitude: float = 0.0) -> Explored:
    """Explore case (b) from all initial states within its limits.

    Args:
        decimation: raw counts per coarse tick. kind: of the dither, see above; None for none.
        amplitude: in ticks of position, or in the force of one tick.
    """
    config = config_of(replace(CASES[1], decimation=decimation))
    if kind is not None:
        target, waveform, frequency = kind
        if target == "current":
            amplitude *= config.spring.stiffness * config.resolution / config.amplifier.torque_constant
        settings = {"dither.target": target, "dither.waveform": waveform, "dither.amplitude": amplitude}
        config = apply_settings(config, settings | ({"dither.frequency_hz": frequency} if frequency else {}))
    return explore(config, effort=_EFFORT, jobs=None)


def dither_table(amplitudes: Sequence[float] = _AMPLITUDES) -> Table:
    """Share of starts that come to rest, and the largest final oscillation, for each kind of dither and amplitude."""
    rows: list[tuple[Cell, ...]] = []
    for decimation in _DECIMATIONS:
        alone = dithered(decimation, None)
        sigma = f"σ = {217.0 / decimation:.1f}"
        rows.append((sigma, "none", f"{alone.at_rest} of {alone.starts}", *[alone.largest_cycle] * len(amplitudes)))
        for kind in _KINDS:
            found = [dithered(decimation, kind, amplitude) for amplitude in amplitudes]
            target, waveform, frequency = kind
            name = f"{target}, {waveform}" + (f" at {frequency:g} Hz" if frequency else "")
            rest = f"{sum(each.at_rest for each in found)} of {sum(each.starts for each in found)}"
            rows.append((sigma, name, rest, *(each.largest_cycle for each in found)))
    header = ("case (b) with", "dither", "starts at rest", *(f"largest at ±{a:g} ticks" for a in amplitudes))
    return Table(header, rows, "Dither in region B, explored: the largest oscillation in which a start ends, ticks.")
