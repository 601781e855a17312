"""A parameter sweep: one row per combination of settings, with results of the theory and, on request, of a simulation."""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from hapticd.config import Config, apply_settings
from hapticd.config.loading import ConfigSource, config_of
from hapticd.config.units import deflection_ticks, seconds, velocity_ticks

if TYPE_CHECKING:
    import pandas as pd

    Evaluate = Callable[[Config], Mapping[str, Any]]

MOTION = ("deflection", "velocity")
"""What can be swept in addition to settings of the config."""
_THEORY = ("mu", "beta", "sigma", "tau_d", "region", "verdict", "proven", "xi_dot_max", "velocity_limit")
_UNITS = {
    "sigma": "coarse tick",
    "tau_d": "period",
    "xi_dot_max": "coarse tick/period",
    "velocity_limit": "coarse tick/period",
    "final_position_ticks": "coarse tick",
    "final_velocity_ticks_per_period": "coarse tick/period",
    "peak_current_A": "A",
}


_Point = tuple[Config, float | None, float | None, float | None, "Evaluate | None"]
"""One combination: the arguments of `compute`."""


def sweep(
    config: ConfigSource = None,
    values: Mapping[str, Iterable[Any]] | None = None,
    *,
    deflection: float | str | None = None,
    velocity: float | str | None = None,
    duration: float | str | None = None,
    function: Evaluate | None = None,
    settings: Mapping[str, Any] | None = None,
    client: Any = None,
    jobs: int | None = None,
    progress: Callable[[float], None] | None = None,
) -> pd.DataFrame:
    """Compute every combination of some settings, in parallel on this machine or on a Dask cluster.

    Args:
        config: to which the settings are applied; as for `hapticd.check`.
        values: dotted key to its values, e.g. ``{"spring.stiffness": [0.01, 0.02], "servo.rate_hz": [500, 1000]}``;
            also ``deflection`` and ``velocity``. The last key varies fastest.
        deflection: release at rest from this deflection, in coarse ticks or with a unit, in every combination.
        velocity: pass the origin with this velocity, in coarse ticks per period or with a unit.
        duration: simulated time, s or with a unit; None for the theory only.
        function: for further columns: takes a config, returns name to value. A cluster's workers must be able to import or
            unpickle it.
        settings: dotted key to value, the same in every combination.
        client: a ``distributed.Client``, whose workers compute; they need hapticd. None for this machine.
        jobs: processes on this machine; by default one per core; 1 for no further process.
        progress: called with the fraction done.

    Returns:
        One row per combination, in order: the swept values; ``mu beta sigma tau_d region verdict proven xi_dot_max
        velocity_limit`` of `hapticd.check`; with a duration ``outcome final_position_ticks
        final_velocity_ticks_per_period at_rest peak_current_A fault`` of `hapticd.simulate`; the columns of ``function``.
        Units are in ``.attrs["units"]``.

    Raises:
        ConfigError: an unknown key or an invalid value, before anything is computed.
        UnitError: a unit of another quantity.
        ValueError: nothing to sweep, a key without values, or both a deflection and a velocity.
    """
    import pandas as pd

    base = config_of(config, settings)
    axes = {key: list(given) for key, given in (values or {}).items()}
    if not axes or not all(axes.values()):
        empty = next((key for key, given in axes.items() if not given), None)
        raise ValueError(f"{empty} has no values to take" if empty else "nothing to sweep: give {key: values}")
    combinations = [dict(zip(axes, chosen, strict=True)) for chosen in itertools.product(*axes.values())]
    length = None if duration is None else seconds(duration)
    given = {"deflection": deflection, "velocity": velocity}
    points = [_point(base, chosen, given, length, function) for chosen in combinations]
    rows: list[dict[str, Any]] = []
    for found in _computed(points, client, jobs):
        rows.append({**combinations[len(rows)], **found})
        if progress is not None:
            progress(len(rows) / len(points))
    frame = pd.DataFrame(rows)
    frame.attrs["units"] = {**{key: _unit(key, base) for key in axes}, **_UNITS}
    return frame


def _unit(key: str, config: Config) -> str:
    from hapticd.config import unit_of

    if key in MOTION:
        return "coarse tick" if key == "deflection" else "coarse tick/period"
    return unit_of(key, linear=config.is_linear)


def _point(
    base: Config,
    chosen: Mapping[str, Any],
    given: Mapping[str, float | str | None],
    duration: float | None,
    function: Evaluate | None,
) -> _Point:
    motion = {**given, **{key: chosen[key] for key in MOTION if key in chosen}}
    if motion["deflection"] is not None and motion["velocity"] is not None:
        raise ValueError("a motion begins with a deflection or with a velocity, not with both")
    changed = {key: value for key, value in chosen.items() if key not in MOTION}
    config = apply_settings(base, changed, source="sweep") if changed else base
    deflection, velocity = motion["deflection"], motion["velocity"]
    ticks = None if deflection is None else float(deflection_ticks(deflection, config))
    speed = None if velocity is None else float(velocity_ticks(velocity, config))
    return config, ticks, speed, duration, function


def _computed(points: Sequence[_Point], client: Any, jobs: int | None) -> Iterator[dict[str, Any]]:
    """Results in the order of the points."""
    jobs = jobs or len(os.sched_getaffinity(0))
    if client is not None:
        # pure=False: the same points may be computed again with another version of the code
        futures = client.map(compute, *zip(*points, strict=True), pure=False)
        try:
            for future in futures:
                yield future.result()
        finally:
            client.cancel(futures)
    elif jobs == 1 or len(points) == 1:
        yield from itertools.starmap(compute, points)
    else:
        from joblib import Parallel, delayed

        yield from Parallel(n_jobs=jobs, return_as="generator")(delayed(compute)(*point) for point in points)


def compute(
    config: Config, deflection: float | None, velocity: float | None, duration: float | None, function: Evaluate | None
) -> dict[str, Any]:
    """One row of a sweep, without the swept values."""
    from drivers import declared_latency
    from hapticd.stability.assessment import assess
    from hapticd.stability.explore import GUARD

    latency = declared_latency(config)[0]
    theory = assess(config, deflection=deflection, velocity=velocity, latency_s=latency, effort=GUARD).document
    row = {key: theory[key] for key in _THEORY}
    if duration is not None:
        from hapticd.servo.simulate import simulate

        found = simulate(config, duration, deflection=deflection, velocity=velocity)
        row |= {
            "outcome": found["outcome"],
            "final_position_ticks": found["final"]["position_ticks"],
            "final_velocity_ticks_per_period": found["final"]["velocity_ticks_per_period"],
            "at_rest": found["at_rest"],
            "peak_current_A": found["peak_current_A"],
            "fault": found["fault"] and found["fault"]["code"],
        }
    return row | dict(function(config)) if function is not None else row
