"""The sections of a configuration that describe the loop and the device, with units, defaults and limits.

Units are SI: rad, N m for a rotary device, m, N for a linear one. The defaults are the paper's RE35/Copley testbed
(Sec. V).
"""

from __future__ import annotations

from collections.abc import Mapping
from math import pi
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, model_validator

from hapticd.config.effects import Effect, checked_effects, effect_findings
from hapticd.config.fields import (
    Flag,
    Ideal,
    Limit,
    Number,
    Off,
    Section,
    Whole,
    WholeIdeal,
    WholeLimit,
    findings_error,
    quantity,
)
from hapticd.config.problems import NO_VALUE, Finding

INT64_MAX = 2**63 - 1
MOST_VELOCITY_PERIODS = 1000
_ROUNDED = 1e-3
"""Correlations are written with few digits."""


class Overrun(Section):
    """Policy for a tick that is not finished before the next one is due."""

    policy: Literal["skip", "hold", "fault"] = quantity(
        "skip",
        "skip: missed periods are skipped on the time grid; hold: likewise, and the late tick keeps the last command; "
        "fault: the first missed period is a fault",
    )
    fault_after: WholeLimit = quantity(
        50,
        "Missed periods that are a fault while running; each tick in time subtracts one. 50 at 1 kHz are 0.05 s with an "
        "unchanged current. A desktop without real-time scheduling is rarely so late; a process that was frozen for 0.1 s "
        "exceeds it, and so does a loop that misses more than half of its periods",
        "periods",
        zero="never",
        ge=0,
        le=1_000_000,
    )


class Servo(Section):
    """The servo thread: its rate and its place on the machine."""

    rate_hz: Number = quantity(1000.0, "Servo rate 1/T", "Hz", ge=1, le=20_000)
    clock: Literal["grid", "sync"] = quantity(
        "grid",
        "Clock of the loop: grid: the machine's clock; sync: the SYNC of a producer on the CAN bus, with the period of "
        "rate_hz",
    )
    priority: Whole = quantity(80, "SCHED_FIFO priority of the servo thread", ge=1, le=99)
    cpu: Whole | None = quantity(None, "Processor the servo thread is bound to; null: any", ge=0, le=4095)
    require_realtime: Flag = quantity(False, "Refuse to start where the machine does not grant real-time scheduling")
    overrun: Overrun = quantity(Overrun, "Overruns")


class Spring(Section):
    """The rendered virtual spring (eq. 2)."""

    stiffness: Number = quantity(0.012, "Stiffness K", "N m/rad", linear="N/m", ge=0)
    damping: Number = quantity(0.0, "Virtual damping B, in parallel with the spring", "N m s/rad", linear="N s/m", ge=0)
    velocity_estimate: Literal["difference", "low_pass"] = quantity(
        "difference",
        "Velocity estimate for the damping: difference: of the coarse positions over velocity_periods; low_pass: of the "
        "last two, through a first-order low-pass of velocity_cutoff_hz",
    )
    velocity_periods: Whole = quantity(
        1, "Servo periods over which the difference is taken", "periods", ge=1, le=MOST_VELOCITY_PERIODS
    )
    velocity_cutoff_hz: Number = quantity(
        100.0, "Cut-off of the low-pass; below half the servo rate", "Hz", gt=0, le=10_000
    )
    origin: Number = quantity(
        0.0, "Position of the spring's origin, snapped to a raw encoder count", "rad", linear="m", ge=-1e6, le=1e6
    )
    half_tick_bias: Flag = quantity(
        True, "Add half a coarse tick to the quantised position, which centres the staircase"
    )
    side: Literal["both", "positive", "negative"] = quantity(
        "both", "both: a bidirectional spring; positive or negative: a wall that pushes only on that side of the origin"
    )


class Encoder(Section):
    """The encoder; counts_per_metre instead of counts_per_rev makes the device linear."""

    counts_per_rev: Number | None = quantity(
        8192.0, "Counts per revolution of a rotary device", "counts/rev", ge=1, le=1e9
    )
    counts_per_metre: Number | None = quantity(None, "Counts per metre of a linear device", "counts/m", ge=1, le=1e12)
    decimation: Whole = quantity(
        1, "Raw counts per coarse tick, N: the loop sees floor(raw / N)", "counts", ge=1, le=2**31 - 1
    )
    invert: Flag = quantity(False, "Count in the opposite direction")

    @model_validator(mode="before")
    @classmethod
    def _linear_has_no_revolutions(cls, data: Any) -> Any:
        if isinstance(data, Mapping) and data.get("counts_per_metre") is not None:
            return {"counts_per_rev": None, **data}
        return data

    @model_validator(mode="after")
    def _rotary_or_linear(self) -> Encoder:
        if self.counts_per_rev is not None and self.counts_per_metre is not None:
            message = "counts_per_rev and counts_per_metre are both given; give one, or set the other to null"
            raise findings_error([Finding("", NO_VALUE, message)])
        if self.counts_per_rev is None and self.counts_per_metre is None:
            message = "needs counts_per_rev (rotary device) or counts_per_metre (linear device)"
            raise findings_error([Finding("", NO_VALUE, message)])
        return self

    @property
    def raw_resolution(self) -> float:
        """One raw count, in rad (2π/counts_per_rev) or m (1/counts_per_metre)."""
        if self.counts_per_metre is not None:
            return 1.0 / self.counts_per_metre
        return 2.0 * pi / (self.counts_per_rev or 1.0)


class Dither(Section):
    """A small periodic or random signal added to the measured position or to the current."""

    target: Literal["none", "position", "current"] = quantity(
        "none", "none: off; position: added before quantisation, in coarse ticks; current: added to the command, in A"
    )
    waveform: Literal["sine", "triangle", "square", "uniform"] = quantity(
        "sine", "Waveform; uniform is white noise between ± amplitude"
    )
    amplitude: Number = quantity(0.0, "Peak amplitude", "ticks or A", ge=0)
    frequency_hz: Number = quantity(
        0.0, "Frequency of a sine, triangle or square; below half the servo rate", "Hz", ge=0
    )
    seed: Whole = quantity(0, "Seed of the uniform waveform", ge=0, le=INT64_MAX)


class Delay(Section):
    """Delay added to the loop on purpose."""

    computation_s: Number = quantity(
        0.0, "Computation delay T_V from sample to command: any fraction or multiple of a period", "s", ge=0, le=1
    )


class Amplifier(Section):
    """The current amplifier and the motor winding; the torque constant and the limits are on the motor's data sheet."""

    torque_constant: Number = quantity(0.0292, "Torque (force) per current", "N m/A", linear="N/A", gt=0)
    continuous_current: Limit = quantity(2.0, "Continuous current (I²t)", "A", zero="no limit", ge=0)
    peak_current: Limit = quantity(6.0, "Largest current; requests beyond it are clamped", "A", zero="no limit", ge=0)
    peak_time_s: Number = quantity(1.0, "Time for which the peak current may flow (I²t)", "s", gt=0, le=3600)
    bandwidth_hz: Ideal = quantity(
        3000.0,
        "Bandwidth ω_A/2π of the current loop; regions and the criterion use the delay T_A = 2 δ_A/ω_A (eq. 5)",
        "Hz",
        zero="no lag",
        ge=0,
        le=1e9,
    )
    damping_ratio: Number = quantity(0.7, "Damping ratio δ_A of the current loop", gt=0, le=10)
    dac_bits: WholeIdeal = quantity(
        14, "Resolution of the command over ± full scale", "bits", zero="no quantisation", ge=0, le=24
    )
    dac_full_scale: Ideal = quantity(6.0, "Current at full scale of the command", "A", zero="no saturation", ge=0)

    @property
    def delay(self) -> float:
        """The amplifier's lag as a delay T_A = 2 δ_A / ω_A, in s (eq. 5); 0 for an ideal amplifier."""
        return self.damping_ratio / (pi * self.bandwidth_hz) if self.bandwidth_hz else 0.0


def _least_eigenvalue(matrix: tuple[tuple[float, ...], ...]) -> float:
    from numpy.linalg import eigvalsh  # here: most configs are read by commands that need no NumPy

    return float(eigvalsh(matrix)[0])


def _checked_effects(value: Any) -> Any:
    findings = list(effect_findings(value))
    if findings:
        raise findings_error(findings)
    return checked_effects(value)


class Correlation(Section):
    """Correlations of the uncertain values."""

    inertia_viscous: Number = quantity(0.0, "Inertia and viscous friction", ge=-1, le=1)
    inertia_coulomb: Number = quantity(0.0, "Inertia and Coulomb friction", ge=-1, le=1)
    inertia_delay: Number = quantity(0.0, "Inertia and delay", ge=-1, le=1)
    viscous_coulomb: Number = quantity(0.0, "Viscous and Coulomb friction", ge=-1, le=1)
    viscous_delay: Number = quantity(0.0, "Viscous friction and delay", ge=-1, le=1)
    coulomb_delay: Number = quantity(0.0, "Coulomb friction and delay", ge=-1, le=1)


class Uncertainty(Section):
    """Standard deviations of the plant's parameters and the loop's delay, from hapticd identify; 0: exactly known."""

    inertia: Number = quantity(0.0, "Standard deviation of the inertia", "kg m²", linear="kg", ge=0)
    viscous: Number = quantity(0.0, "Standard deviation of the viscous friction", "N m s/rad", linear="N s/m", ge=0)
    coulomb: Number = quantity(0.0, "Standard deviation of the Coulomb friction", "N m", linear="N", ge=0)
    delay_s: Number = quantity(0.0, "Standard deviation of the delay from sample to current", "s", ge=0, le=1)
    correlation: Correlation = quantity(Correlation, "Their correlations")

    @model_validator(mode="after")
    def _possible(self) -> Uncertainty:
        correlated = any(self.correlation.model_dump().values())
        if correlated and (least := _least_eigenvalue(self.matrix)) < -_ROUNDED:
            message = f"this is no correlation matrix: it has the eigenvalue {least:.3g}; must be at least 0"
            raise findings_error([Finding("correlation", NO_VALUE, message, 0.0)])
        return self

    @property
    def matrix(self) -> tuple[tuple[float, ...], ...]:
        """Correlations in the order inertia, viscous, coulomb, delay."""
        names = ("inertia", "viscous", "coulomb", "delay")
        c = self.correlation
        return tuple(
            tuple(
                1.0 if i == j else float(getattr(c, f"{names[min(i, j)]}_{names[max(i, j)]}"))
                for j in range(len(names))
            )
            for i in range(len(names))
        )

    @property
    def is_known(self) -> bool:
        """Whether any uncertainty is given."""
        return any((self.inertia, self.viscous, self.coulomb, self.delay_s))


class Plant(Section):
    """The device: m ẍ + b ẋ + c sgn(ẋ) = force (eq. 1), with stiction, and the effects added to it."""

    inertia: Number = quantity(6.28e-6, "Inertia m", "kg m²", linear="kg", gt=0)
    viscous: Number = quantity(9.0e-6, "Viscous friction b", "N m s/rad", linear="N s/m", ge=0)
    coulomb: Number = quantity(2.0e-3, "Coulomb friction c, also the largest stiction", "N m", linear="N", ge=0)
    effects: Annotated[tuple[Effect, ...], BeforeValidator(_checked_effects)] = quantity(
        (), "Effects beyond the base model: a list of {name: slug, parameters}"
    )
    uncertainty: Uncertainty = quantity(Uncertainty, "Uncertainty of these values")


class Hand(Section):
    """An operator's grip in parallel with the device (Sec. III-B), for check and simulate."""

    inertia: Number = quantity(0.0, "Inertia of the hand", "kg m²", linear="kg", ge=0)
    damping: Number = quantity(0.0, "Damping of the hand", "N m s/rad", linear="N s/m", ge=0)
    stiffness: Number = quantity(0.0, "Stiffness of the hand", "N m/rad", linear="N/m", ge=0)


class Safety(Section):
    """Limits that trip the loop into a latched fault with zero current."""

    max_velocity: Limit = quantity(
        400.0, "Largest speed", "rad/s", linear="m/s", linear_default=2.0, zero="no limit", ge=0
    )
    max_excursion: Limit = quantity(
        10.0, "Largest distance from the spring's origin", "rad", linear="m", linear_default=0.2, zero="no limit", ge=0
    )
    encoder_jump: WholeLimit = quantity(
        8192, "Largest change of the raw encoder between two ticks", "counts", zero="no limit", ge=0, le=2**31 - 1
    )
    missed_exchanges: WholeLimit = quantity(
        2,
        "Consecutive failed exchanges with the driver that are tolerated; one more is a fault",
        "exchanges",
        zero="never",
        ge=0,
        le=1_000_000,
    )
    enable_timeout_s: Number = quantity(
        2.0, "Time the amplifier may take to report that it is enabled", "s", gt=0, le=60
    )
    enable: Flag = quantity(
        False,
        "Whether the motor may move only while a person holds the driver's enable input; its release is a latched fault. "
        "Not live",
    )
    heartbeat_timeout_s: Number = quantity(
        0.5, "Time without a heartbeat of the supervisor after which the loop faults", "s", ge=0.2, le=10
    )
    current_mismatch: Limit = quantity(
        0.3,
        "Largest difference between the measured current, if the device has one, and the commanded current after the "
        "amplifier's model; 10 % of that current are added",
        "A",
        zero="not compared",
        ge=0,
    )
    current_mismatch_s: Number = quantity(
        0.1,
        "Time in which every sample must exceed it to be a fault; at least three samples",
        "s",
        gt=0,
        le=10,
    )
    soft_start_s: Number = quantity(
        0.25,
        "Time over which the force fades in at the start, and follows a change of the rendered spring; 0: at once. A "
        "release and an excitation start at once",
        "s",
        ge=0,
        le=10,
    )
    guard: Annotated[Literal["refuse", "warn", "off"], Off] = quantity(
        "refuse",
        "For a spring whose motion does not die out in theory: refuse: rendered only if forced; warn: rendered with a "
        "warning; off: no check",
    )
    passivity: Annotated[Literal["off", "observe", "control"], Off] = quantity(
        "off",
        "Time-domain passivity: off; observe: the loop computes the energy that the rendered spring generates; control: it "
        "also adds the damping that dissipates this energy",
    )
