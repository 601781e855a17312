"""The servo loop and the plant in virtual time, as a run."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hapticd.config import config_digest
from hapticd.config.loading import ConfigSource, config_of
from hapticd.config.units import deflection_ticks, seconds, velocity_ticks
from hapticd.record import Run, run_metadata
from hapticd.record.schema import COLUMNS, ROW

if TYPE_CHECKING:
    from numpy.typing import NDArray


def simulate(
    config: ConfigSource = None,
    duration: float | str = 1.0,
    *,
    deflection: float | str | None = None,
    velocity: float | str | None = None,
    settings: Mapping[str, Any] | None = None,
    safety: bool = False,
    seed: int | None = None,
    excitation: str | NDArray[np.float64] | None = None,
) -> Run:
    """Simulate the loop on the config's device, with the machine code of the daemon; the motion is exact between ticks.

    Args:
        config: a `Config`, nested mappings, a file, a preset's name; None for the simulated RE35 testbed.
        duration: virtual time, s; or text with a unit, ``"500ms"``.
        deflection: initial deflection from the spring's origin, in coarse ticks; or ``"30deg"``, ``"2mm"``; 0 if None.
        velocity: initial velocity, in coarse ticks per period; or ``"2rad/s"``, ``"60rpm"``; 0 if None.
        settings: dotted key to value, applied to the config.
        safety: apply the config's safety trips, as the daemon does.
        seed: of all random numbers; ``dither.seed`` by default.
        excitation: an identification experiment of this duration, by its name in ``hapticd excite --list``; or its table,
            shape (2, rows), from `hapticd.servo.excitation.build`.

    Returns:
            Every tick with the columns of a recording, and ``true_position`` (rad or m from the encoder's zero) and
            ``true_velocity`` of the simulated device. ``metadata["simulation"]`` has the outcome (monotone, decaying,
            persistent, growing), the final state, and the fault if there was one.

    Raises:
            ConfigError: the config is invalid.
            UnitError: a unit of another quantity.
            ValueError: a duration shorter than one period.
            ExcitationError: an unknown experiment, or one beyond a limit of the config.
    """
    resolved = config_of(config, settings)
    from hapticd.servo.simulate import simulate as run

    if isinstance(excitation, str):
        from hapticd.servo.excitation import build

        excitation = build(resolved, excitation, duration_s=seconds(duration))
    blocks: list[NDArray[Any]] = []
    truths: list[NDArray[np.float64]] = []
    report = run(
        resolved,
        seconds(duration),
        deflection=None if deflection is None else deflection_ticks(deflection, resolved),
        velocity=None if velocity is None else velocity_ticks(velocity, resolved),
        safety=safety,
        seed=seed,
        excitation=excitation,
        on_rows=blocks.append,
        on_truth=truths.append,
    )
    rows, truth = np.concatenate(blocks), np.concatenate(truths)
    columns = {name: np.ascontiguousarray(rows[name]) for name in ROW.names or ()}
    columns |= {"true_position": truth[:, 0].copy(), "true_velocity": truth[:, 1].copy()}
    unit = "m" if resolved.is_linear else "rad"
    units = {column.name: column.unit_for(linear=resolved.is_linear) for column in COLUMNS}
    metadata = run_metadata(
        resolved.model_dump(mode="json"),
        linear=resolved.is_linear,
        config_digest=config_digest(resolved),
        source="simulate",
        origin_counts=resolved.origin_counts,
        seed=seed,
        simulation=report,
    )
    return Run(
        path=Path("simulation"),
        columns=columns,
        metadata=metadata,
        units={**units, "true_position": unit, "true_velocity": f"{unit}/s"},
        warnings=tuple(report["warnings"]),
    )
