"""Experiments for an unknown device: find the current that moves it, then play chirps within its limits.

The rendered spring is off: with a wrong sign of the encoder, or a wrong plant in the config, it might be unstable. The shaft
stays in range because a chirp has zero mean, and because all safety trips are armed.
"""

from __future__ import annotations

from math import pi, sqrt
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from hapticd.gap.balance import Balance, balance
from hapticd.gap.live import LiveError, play
from hapticd.identify.workflow import load_any
from hapticd.record import read_run
from hapticd.servo.experiment import Experiment

if TYPE_CHECKING:
    from collections.abc import Callable

    from hapticd.client import Client
    from hapticd.config import Config
    from hapticd.gap.live import Bar
    from hapticd.gap.recording import Recording

_FIRST_SHARE, _LARGEST_SHARE = 0.005, 0.8
"""First and last amplitude of the search for motion, as shares of the continuous current."""
_STRONGER = 1.6
_LOOK_S, _CHIRP_S = 2.0, 12.0
_LOOK_HZ = (2.0, 10.0)
_MOVED_COUNTS = 40
"""Travel that counts as motion [raw counts]."""
_EFFORTS: Final = (2.0, 4.0)
"""Amplitudes of the chirps, as multiples of the current that overcomes friction."""
_TRAVEL_SHARE, _SPEED_SHARE = 0.2, 0.3
"""Largest travel and speed of a chirp, as shares of the safety limits."""
_UNLIMITED_TRAVEL, _UNLIMITED_SPEED = 1.0, 100.0
"""The same if there is no limit, rad and rad/s."""
_SPAN = 10.0
"""Highest over lowest frequency of a chirp."""
_SETTINGS: Final = {"spring.stiffness": 0.0}


def record_live(
    client: Client, config: Config, say: Callable[[str], None], bar: Bar, *, keep_spring: bool = False
) -> list[Recording]:
    """Run the experiments on a running daemon and return their recordings.

    Args:
        client: of the daemon. On an interrupt it sends a stop.
        config: the daemon's config, for its limits. say: called with a text for each step. bar: progress bar with a label.
        keep_spring: keep the rendered spring on, for a device that would fall without it.

    Raises:
        LiveError: an experiment ended on a fault, or the shaft does not move within the limits.
        RequestRefused: the daemon refuses an experiment.
        RecordingError: a recording is unusable.
    """
    settings = {} if keep_spring else _SETTINGS
    if not keep_spring:
        say("the rendered spring is off during the experiments")
    found = [_look(client, config, settings, say, bar)]
    first = balance(found, config.amplifier.torque_constant)
    plans = [chirp(config, first, effort, settings) for effort in _EFFORTS]
    return [*found, *(load_any(play(client, config, plan, say, bar), config) for plan in plans)]


def chirp(config: Config, first: Balance, effort: float, settings: dict[str, Any] | None = None) -> Experiment:
    """A chirp with an amplitude of `effort` times the friction, at the lowest frequencies within the limits.

    A sinusoidal torque of amplitude (e − 1) c beyond friction, at the frequency f, moves an inertia J with the amplitude
    (e − 1) c / (J (2πf)²) and the speed (e − 1) c / (J 2πf).
    """
    amplifier, safety = config.amplifier, config.safety
    current = effort * first.coulomb / amplifier.torque_constant
    if amplifier.continuous_current:
        current = min(current, _LARGEST_SHARE * amplifier.continuous_current)
    torque = max(current * amplifier.torque_constant - first.coulomb, 0.3 * first.coulomb)
    acceleration = torque / first.inertia
    travel = _TRAVEL_SHARE * safety.max_excursion if safety.max_excursion else _UNLIMITED_TRAVEL
    speed = _SPEED_SHARE * safety.max_velocity if safety.max_velocity else _UNLIMITED_SPEED
    slowest = max(sqrt(acceleration / travel), acceleration / speed) / (2.0 * pi)
    highest = config.servo.rate_hz / 10.0
    low = min(max(slowest, 0.5), highest / 2.0)
    return Experiment(
        "chirp",
        amplitude=_rounded(current),
        duration_s=_CHIRP_S,
        low_hz=_rounded(low),
        high_hz=_rounded(min(_SPAN * low, highest)),
        settings=settings or {},
    )


def _look(client: Client, config: Config, settings: dict[str, Any], say: Callable[[str], None], bar: Bar) -> Recording:
    """The first recording in which the shaft moves, with an increasing current."""
    limit = config.amplifier.continuous_current or config.amplifier.peak_current or 1.0
    current = _FIRST_SHARE * limit
    high = min(_LOOK_HZ[1], config.servo.rate_hz / 10.0)
    while current <= _LARGEST_SHARE * limit:
        plan = Experiment("chirp", _rounded(current), _LOOK_S, min(_LOOK_HZ[0], high / 2.0), high, settings=settings)
        path = play(client, config, plan, say, bar)
        if np.ptp(read_run(path).columns["encoder_counts"]) >= _MOVED_COUNTS:
            # It just moved: a little more current, so that the record shows sliding and not only break-away.
            stronger = min(_STRONGER * current, _LARGEST_SHARE * limit)
            plan = Experiment("chirp", _rounded(stronger), _LOOK_S, plan.low_hz, high, settings=settings)
            return load_any(play(client, config, plan, say, bar), config)
        current *= _STRONGER
    raise LiveError(
        f"the shaft moves less than {_MOVED_COUNTS} counts up to {_LARGEST_SHARE * limit:.3g} A "
        f"({100 * _LARGEST_SHARE:.0f} % of the amplifier's current): is the motor connected, is the brake off, does the "
        "encoder count?"
    )


def _rounded(value: float) -> float:
    return float(f"{value:.3g}")
