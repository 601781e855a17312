"""An experiment tried in simulation: does it move the shaft safely, and how well would it tell rivals apart?"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from hapticd.config import ConfigError, apply_settings
from hapticd.gap.data import Recording
from hapticd.gap.fit import fit
from hapticd.gap.prepare import prepare
from hapticd.gap.search import Data, Judged, judge
from hapticd.servo.excitation import ExcitationError, build
from hapticd.servo.simulate import simulate

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from hapticd.config import Config
    from hapticd.gap.rivals import Rival
    from hapticd.servo.experiment import Experiment

_ITERATIONS = 8
_PATIENCE = 1e-2
_MARGIN = 0.7
"""Share of a safety limit that a trial may use: what is missing in the model may make the device livelier."""
_FEWEST_COUNTS = 20
"""Raw counts that the shaft must travel at least."""


def separation(
    experiment: Experiment, pairs: Sequence[tuple[Rival, Rival]], noise: float, seed: int = 0
) -> float | None:
    """Standard errors by which an experiment would set the true one of each pair apart, in the worst case.

    The closed loop is simulated with the first of a pair as the device; both are fitted to what the encoder would show, and
    compared on held-out windows as after a real experiment.

    Args:
        experiment: what is played.
        pairs: (the true one, the claimed one).
        noise: standard deviation of a position sample beyond quantisation, rad or m.
        seed: of that noise.

    Returns:
        None where the limits do not admit the experiment, a safety trip would end it, or the shaft would not move.
    """
    recordings: dict[str, Recording] = {}
    worst = np.inf
    for true, claimed in pairs:
        if true.slug not in recordings:
            played = play(true.config, experiment, noise, seed)
            if played is None:
                return None
            recordings[true.slug] = played
        data = _data(recordings[true.slug], true, noise)
        worst = min(worst, _fitted(data, true).ahead_of(_fitted(data, claimed), data))
        if worst == 0.0:
            break
    return float(worst)


def play(config: Config, experiment: Experiment, noise: float, seed: int = 0) -> Recording | None:
    """What an experiment would record on a device; None where it may not or could not be done.

    Args:
        config: device, loop and limits; all trips are armed, at 70 % of the speed and excursion that the config allows.
        experiment: what is played.
        noise: standard deviation of a position sample beyond quantisation, rad or m.
        seed: of that noise.
    """
    blocks: list[NDArray[Any]] = []
    try:
        config = apply_settings(config, experiment.settings, source="next experiment")
        table = build(config, experiment.excitation, **experiment.plan())
    except (ConfigError, ExcitationError):
        return None
    config = _with_margin(config)
    # The shaft rests somewhere in a raw count; its middle is the best guess.
    result = simulate(
        config,
        table.shape[1] / config.servo.rate_hz,
        deflection=0.5 / config.encoder.decimation,
        safety=True,
        excitation=table,
        on_rows=lambda rows: blocks.append(rows.copy()),
    )
    rows = np.concatenate(blocks)
    if result.report["fault"] or np.ptp(rows["encoder_counts"]) < _FEWEST_COUNTS:
        return None
    resolution = config.raw_resolution
    position = (rows["encoder_counts"] + 0.5) * resolution
    position = position + noise * np.random.default_rng(seed).standard_normal(position.size)
    return Recording(
        name=experiment.excitation,
        time_s=rows["time_s"] - rows["time_s"][0],
        position=position,
        resolution=resolution,
        current=rows["current_command_A"].astype(np.float64),
        current_measured=None,
        period_s=config.period,
        lateness_s=None,
        is_linear=config.is_linear,
        config=config,
    )


def _with_margin(config: Config) -> Config:
    safety = config.safety
    limits = {
        name: _MARGIN * limit
        for name, limit in (("max_velocity", safety.max_velocity), ("max_excursion", safety.max_excursion))
        if limit
    }
    return config.model_copy(update={"safety": safety.model_copy(update=limits)})


def _data(recording: Recording, base: Rival, noise: float) -> Data:
    data = prepare([recording], base.hypothesis)
    segments = [
        replace(s, sigma=np.hypot(s.sigma, noise), extra_sigma=np.full_like(s.extra_sigma, noise))
        for s in data.segments
    ]
    return Data(segments, data.block)


def _fitted(data: Data, claimed: Rival) -> Judged:
    states = [segment.first_states() for segment in data.segments]
    return judge(data, fit(data.segments, claimed.hypothesis, claimed.u, states, _ITERATIONS, _PATIENCE))
