"""The faults: each with a code, a cause in words, a remedy and a page (``docs/faults/<code>.md``, ``hapticd help <code>``).

The loop raises a number, with the value that tripped it and the limit; this module makes the text.
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
CURRENT_MISMATCH: Final = 16
UNSTABLE: Final = 17
ENABLE_RELEASED: Final = 18
SYNC_LOST: Final = 19

CLEAR: Final = "when the rig is safe, 'hapticd clear'"
REPLUG: Final = (
    "plug it in, switch it on and restart the daemon, then 'hapticd clear'; with driver.reconnect: true it is opened again "
    "automatically"
)
REOPENS: Final = "plug it in and switch it on; it is opened again automatically, then 'hapticd clear'"
REOPENED: Final = "the device answers again: check the rig, then 'hapticd clear'"


@dataclass(frozen=True)
class FaultKind:
    """One kind of fault.

    Attributes:
        code: its public name. text: a sentence with value and limit. remedy: what the user does.
    """

    code: str
    text: str
    remedy: str = CLEAR


KINDS: Final[dict[int, FaultKind]] = {
    OVER_CURRENT: FaultKind(
        "over_current",
        "the requested current stayed above the continuous rating too long: its excess reached {value:.4g} A² s, "
        "the limit (peak² - continuous²) x peak time is {limit:.4g} A² s",
        "let the winding cool, then 'hapticd clear'",
    ),
    OVER_SPEED: FaultKind(
        "over_speed",
        "speed of at least {value:.4g} {speed_unit} is above safety.max_velocity = {limit:.4g} {speed_unit}",
        "hold the handle until the shaft is still, then 'hapticd clear'",
    ),
    EXCURSION: FaultKind(
        "excursion",
        "at least {value:.4g} {unit} from the spring's origin is beyond safety.max_excursion = {limit:.4g} {unit}",
        "bring the shaft back within the limit, then 'hapticd clear'",
    ),
    ENCODER_JUMP: FaultKind(
        "encoder_jump",
        "the encoder moved {value:.0f} counts in one period, more than safety.encoder_jump = {limit:.0f} counts",
        "check the encoder and its cable, turn the shaft to its reference, then 'hapticd clear'",
    ),
    MISSED_EXCHANGES: FaultKind(
        "missed_exchanges",
        "{value:.0f} exchanges with the device failed in a row, safety.missed_exchanges = {limit:.0f}",
        "make exchanges succeed (cable, supply, other load on the link), then 'hapticd clear'",
    ),
    OVERRUN: FaultKind(
        "overrun",
        "{value:.0f} periods were missed, minus the punctual ticks since then; servo.overrun allows {limit:.0f}",
        "'hapticd latency' says which rate this machine holds; 'hapticd clear' at any time",
    ),
    NON_FINITE: FaultKind(
        "non_finite",
        "the command became {value} A, not a finite number",
        "correct the settings, then 'hapticd clear'",
    ),
    DRIVER_LOST: FaultKind(
        "driver_lost",
        "the device is lost (driver returned {value:.0f})",
        REPLUG,
    ),
    DRIVER_ERROR: FaultKind(
        "driver_error",
        "the driver failed (returned {value:.0f})",
        "'hapticd clear' tries the driver again; after a change of its source restart the daemon",
    ),
    DEVICE_FAULT: FaultKind(
        "device_fault",
        "the device reports a fault, code {value:.0f} (0x{value_int:x})",
        "clear the fault in the device itself, then 'hapticd clear'",
    ),
    HEARTBEAT_LOST: FaultKind(
        "heartbeat_lost",
        "the supervisor sent no heartbeat for {value:.0f} ms, safety.heartbeat_timeout_s = {limit:.0f} ms",
        "'hapticd clear'; its page lists what stops the supervisor",
    ),
    ESTOP: FaultKind(
        "estop",
        "software stop requested by a user or a program",
        "when nobody can be hurt, 'hapticd clear'",
    ),
    ENABLE_TIMEOUT: FaultKind(
        "enable_timeout",
        "the amplifier did not report 'enabled' within {limit:.3g} s (safety.enable_timeout_s)",
        "switch on the amplifier's supply, close its enable chain, then 'hapticd clear'",
    ),
    AMPLIFIER_DROPPED: FaultKind(
        "amplifier_dropped",
        "the amplifier switched itself off while the spring was rendered",
        "find what opened the amplifier's enable chain, then 'hapticd clear'",
    ),
    RELOAD_FAILED: FaultKind(
        "reload_failed",
        "the new configuration could not be applied",
        "'hapticd clear' keeps the old configuration; or correct the new one, then 'hapticd reload' again",
    ),
    CURRENT_MISMATCH: FaultKind(
        "current_mismatch",
        "the device measures {value:.4g} A, beyond the {limit:.4g} A that the commanded current, the amplifier's model and "
        "safety.current_mismatch explain",
        "find the wrong one of the two (the drive's scale, the motor's leads, its supply), then 'hapticd clear'",
    ),
    UNSTABLE: FaultKind(
        "unstable",
        "the theory has found a start from which this spring does not come to rest: {value:.4g} ticks from the origin, at "
        "{limit:.4g} ticks per period; the force was faded out",
        "make one of the changes that 'hapticd check' proposes, then 'hapticd clear'",
    ),
    ENABLE_RELEASED: FaultKind(
        "enable_released",
        "the enable input that a person holds was released while the motor was on (safety.enable)",
        "'hapticd clear'; then hold the enable, and 'hapticd start'",
    ),
    SYNC_LOST: FaultKind(
        "sync_lost",
        "no SYNC was received for {value:.3g} periods (servo.clock: sync), safety.missed_exchanges = {limit:.0f}",
        "make the producer send SYNC again, then 'hapticd clear'",
    ),
}

NUMBERS: Final[dict[str, int]] = {kind.code: number for number, kind in KINDS.items()}


def describe(number: int, value: float, limit: float, *, is_linear: bool, detail: str | None = None) -> dict[str, Any]:
    """The public form of a fault: ``code``, ``cause`` (with the numbers) and ``help`` (the command that shows its page).

    Args:
        number: the loop's fault number.
        value: what tripped it, in the unit of its text.
        limit: the limit that was exceeded.
        is_linear: whether units are in m instead of rad.
        detail: further text, such as that of a driver's exception.
    """
    kind = KINDS[number]
    unit = "m" if is_linear else "rad"
    value_int = int(value) if abs(value) < 2**62 else 0
    cause = kind.text.format(value=value, limit=limit, unit=unit, speed_unit=f"{unit}/s", value_int=value_int)
    if detail:
        cause = f"{cause}: {detail}"
    return {"code": kind.code, "cause": cause, "help": help_of(kind.code)}


def help_of(code: str) -> str:
    """The command that shows the page of a fault."""
    return f"hapticd help {code}"
