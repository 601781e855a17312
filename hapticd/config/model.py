"""The whole configuration, with derived numbers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydantic import model_validator

from hapticd.config._checks import cross_findings
from hapticd.config._host import Api, Driver, Record
from hapticd.config.fields import Section, findings_error, quantity
from hapticd.config.sections import Amplifier, Delay, Dither, Encoder, Hand, Plant, Safety, Servo, Spring


class Config(Section):
    """A validated hapticd configuration; every key has a default, which is the simulated RE35 testbed."""

    servo: Servo = quantity(Servo, "Servo thread")
    spring: Spring = quantity(Spring, "Virtual spring")
    encoder: Encoder = quantity(Encoder, "Encoder")
    dither: Dither = quantity(Dither, "Dither")
    delay: Delay = quantity(Delay, "Computation delay")
    amplifier: Amplifier = quantity(Amplifier, "Amplifier")
    plant: Plant = quantity(Plant, "Device")
    hand: Hand = quantity(Hand, "Operator's grip")
    driver: Driver = quantity(Driver, "Driver")
    safety: Safety = quantity(Safety, "Safety limits")
    record: Record = quantity(Record, "Recording")
    api: Api = quantity(Api, "Control API")

    @model_validator(mode="before")
    @classmethod
    def _linear_defaults(cls, data: Any) -> Any:
        """A linear device has its own default limits: 400 m/s and 10 m would be far too large."""
        if not isinstance(data, Mapping):
            return data
        safety = data.get("safety") or {}
        if not (gives_linear_encoder(data) and isinstance(safety, Mapping)):
            return data
        return {**data, "safety": {**_linear_safety(), **safety}}

    @model_validator(mode="after")
    def _cross_checks(self) -> Config:
        findings = list(cross_findings(self.servo, self.spring, self.encoder, self.dither, self.amplifier, self.safety))
        if findings:
            raise findings_error(findings)
        return self

    @property
    def period(self) -> float:
        """Servo period T = 1/rate, in s."""
        return 1.0 / self.servo.rate_hz

    @property
    def raw_resolution(self) -> float:
        """One raw encoder count, in rad or m."""
        return self.encoder.raw_resolution

    @property
    def resolution(self) -> float:
        """One coarse tick Δ = decimation · raw resolution, in rad or m."""
        return self.encoder.decimation * self.encoder.raw_resolution

    @property
    def count_speed(self) -> float:
        """One raw count per period, in rad/s or m/s: the resolution of a speed from two successive samples."""
        return self.encoder.raw_resolution * self.servo.rate_hz

    @property
    def is_linear(self) -> bool:
        """Whether the device is linear (m, N) or rotary (rad, N m)."""
        return self.encoder.counts_per_metre is not None

    @property
    def origin_counts(self) -> int:
        """The spring's origin in raw encoder counts."""
        return round(self.spring.origin / self.encoder.raw_resolution)


def gives_linear_encoder(data: Mapping[Any, Any]) -> bool:
    """Whether unvalidated configuration data describes a linear device."""
    encoder = data.get("encoder")
    if isinstance(encoder, Mapping):
        return encoder.get("counts_per_metre") is not None
    return isinstance(encoder, Encoder) and encoder.counts_per_metre is not None


def _linear_safety() -> dict[str, Any]:
    extras = {name: field.json_schema_extra for name, field in Safety.model_fields.items()}
    return {
        name: extra["default_linear"]
        for name, extra in extras.items()
        if isinstance(extra, dict) and "default_linear" in extra
    }
