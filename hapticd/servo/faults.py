"""The faults: one code, one cause in words, one page each (``docs/faults/<code>.md``).

The loop raises a number with the value that tripped it and the limit; everything readable is made here.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

NONE: Final = 0
OVER_CURRENT: Final = 1
OVER_SPEED: Final = 2
EXCURSION: Final = 3
ENCODER_JUMP: Final = 4
MISSED_EXCHANGES: Final = 5
OVERRUN: Final = 6
NON_FINITE: Final = 7
DRIVER_LOST: Final = 8
DRIVER_ERROR: Final = 9
DEVICE_FAULT: Final = 10
HEARTBEAT_LOST: Final = 11
ESTOP: Final = 12
ENABLE_TIMEOUT: Final = 13
AMPLIFIER_DROPPED: Final = 14
RELOAD_FAILED: Final = 15


@dataclass(frozen=True)
class FaultKind:
    """One kind of fault: ``code`` is its public name, ``text`` a sentence with the numbers that tripped it."""

    code: str
    text: str


KINDS: Final[dict[int, FaultKind]] = {
    OVER_CURRENT: FaultKind(
        "over_current",
        "the current asked for stayed above the continuous rating too long: its excess reached {value:.4g} A² s, "
        "the limit (peak² - continuous²) x peak time is {limit:.4g} A² s",
    ),
    OVER_SPEED: FaultKind(
        "over_speed", "speed {value:.4g} {speed_unit} is above safety.max_velocity = {limit:.4g} {speed_unit}"
    ),
    EXCURSION: FaultKind(
        "excursion", "{value:.4g} {unit} from the spring's origin is beyond safety.max_excursion = {limit:.4g} {unit}"
    ),
    ENCODER_JUMP: FaultKind(
        "encoder_jump",
        "the encoder moved {value:.0f} counts in one period, more than safety.encoder_jump = {limit:.0f} counts",
    ),
    MISSED_EXCHANGES: FaultKind(
        "missed_exchanges",
        "{value:.0f} exchanges with the device failed in a row, safety.missed_exchanges = {limit:.0f}",
    ),
    OVERRUN: FaultKind(
        "overrun", "{value:.0f} ticks in a row came a period or more too late, servo.overrun allows {limit:.0f}"
    ),
    NON_FINITE: FaultKind("non_finite", "the command became {value} A, not a finite number"),
    DRIVER_LOST: FaultKind("driver_lost", "the device is gone (driver returned {value:.0f})"),
    DRIVER_ERROR: FaultKind("driver_error", "the driver failed (returned {value:.0f})"),
    DEVICE_FAULT: FaultKind(
        "device_fault", "the device reports a fault of its own, code {value:.0f} (0x{value_int:x})"
    ),
    HEARTBEAT_LOST: FaultKind(
        "heartbeat_lost",
        "the supervisor gave no sign of life for {value:.0f} ms, safety.heartbeat_timeout_s = {limit:.0f} ms",
    ),
    ESTOP: FaultKind("estop", "software stop asked for by a user or a program"),
    ENABLE_TIMEOUT: FaultKind(
        "enable_timeout", "the amplifier did not report 'enabled' within {limit:.3g} s (safety.enable_timeout_s)"
    ),
    AMPLIFIER_DROPPED: FaultKind(
        "amplifier_dropped", "the amplifier switched itself off while the spring was rendered"
    ),
    RELOAD_FAILED: FaultKind("reload_failed", "the new configuration could not be put into force"),
}

NUMBERS: Final[dict[str, int]] = {kind.code: number for number, kind in KINDS.items()}


def describe(number: int, value: float, limit: float, *, is_linear: bool, detail: str | None = None) -> dict[str, Any]:
    """The public form of a fault: ``code``, ``cause`` (with the numbers) and ``help`` (its page).

    Args:
        number: the loop's fault number.
        value: what tripped it, in the unit of its text.
        limit: the limit that it crossed.
        is_linear: m instead of rad.
        detail: more words, such as the text of a driver's exception.
    """
    kind = KINDS[number]
    unit = "m" if is_linear else "rad"
    value_int = int(value) if abs(value) < 2**62 else 0
    cause = kind.text.format(value=value, limit=limit, unit=unit, speed_unit=f"{unit}/s", value_int=value_int)
    if detail:
        cause = f"{cause}: {detail}"
    return {"code": kind.code, "cause": cause, "help": f"docs/faults/{kind.code}.md"}
