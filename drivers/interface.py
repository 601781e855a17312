"""The driver interface: two C functions, one state pointer and a declared latency.

The servo loop is compiled and runs no Python. It calls the hardware through two function pointers::

    int32_t read (void *state, hapticd_exchange *x);   /* sample: counts, measured current, status bits */
    int32_t write(void *state, hapticd_exchange *x);   /* command: current, DAC code, enable            */

called in this order within one tick, so that there is no hidden delay of a period. ``hapticd_exchange`` is 16 words of eight
bytes (C declaration: ``docs/reference/driver-interface.md``); the ``X_*`` constants below are its word numbers.
"""

from __future__ import annotations

import abc
import math
from typing import TYPE_CHECKING, Any, ClassVar, Final, TypeVar

import numpy as np
from pydantic import ValidationError

from hapticd.config.text import legible, shown

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from hapticd.config import Config
    from hapticd.config.fields import Section

_Options = TypeVar("_Options", bound="Section")

EXCHANGE_WORDS = 16

X_TICK = 0
"""i64, in: number of the tick on the servo's time grid."""
X_TIME_NS = 1
"""i64, in: time of this call, ns of CLOCK_MONOTONIC (real time) or of virtual time."""
X_TIME_FRAC = 2
"""f64, in: fraction of a nanosecond to add to X_TIME_NS, in [0, 1); zero in real time."""
X_PERIOD_NS = 3
"""f64, in: servo period in ns."""
X_COUNTS = 4
"""i64, out of read: encoder counts, wrap already removed."""
X_CURRENT_MEASURED = 5
"""f64, out of read: measured current in A, NaN if the device has none."""
X_STATUS = 6
"""i64, out of read: STATUS_* bits."""
X_DEVICE_CODE = 7
"""i64, out of read or write: the device's own error code, shown in the fault's cause."""
X_CURRENT = 8
"""f64, in to write: commanded current in A, already clamped and on the DAC's grid."""
X_CODE = 9
"""i64, in to write: the same as a signed DAC code (0 if no DAC is configured)."""
X_ENABLE = 10
"""i64, in to write: 1 amplifier on, 0 amplifier off."""
X_TRUE_POSITION = 11
"""f64, out of read, simulated devices only: true position in rad or m (for ``simulate``; not used for rendering)."""
X_TRUE_VELOCITY = 12
"""f64, out of read, simulated devices only: true velocity in rad/s or m/s."""
X_INDEX_SEEN = 13
"""i64, out of read, drivers with ``reports_index``: index pulses passed since the device was opened."""
X_INDEX_COUNTS = 14
"""i64, out of read, likewise: encoder counts at the last one."""
X_DEADLINE_NS = 15
"""i64, in to wait: deadline, ns of CLOCK_MONOTONIC. X_TIME_NS is the expected time of the device's SYNC; 0: not known."""

EXCHANGE = np.dtype(
    [
        ("tick", "i8"),
        ("time_ns", "i8"),
        ("time_frac", "f8"),
        ("period_ns", "f8"),
        ("counts", "i8"),
        ("current_measured", "f8"),
        ("status", "i8"),
        ("device_code", "i8"),
        ("current", "f8"),
        ("code", "i8"),
        ("enable", "i8"),
        ("true_position", "f8"),
        ("true_velocity", "f8"),
        ("index_seen", "i8"),
        ("index_counts", "i8"),
        ("deadline_ns", "i8"),
    ],
    align=True,
)
"""The same 16 words as a record of the loop."""

STATUS_ENABLED = 1
"""The amplifier reports that it is on and follows the command."""
STATUS_HELD = 2
"""The enable input is held. With ``safety.enable`` a sample without this bit is a release."""

OK = 0
MISSED = 1
"""No new sample, or no proof that the command arrived; counted; a fault after ``safety.missed_exchanges`` in a row."""
DEVICE_FAULT = 2
"""The device reports a fault (X_DEVICE_CODE)."""
ERROR = -1
"""The driver raised an exception; its text is in :attr:`Driver.error`."""
LOST = -2
"""The device is lost (unplugged, port closed) or has restarted: later calls return this until it is opened again."""


PROCESSING_S = 40e-6
"""Processing time of host and device without transmission: s from the encoder's sample to the change of the current.

Measured with the simulated board and drive on an ordinary PC (``hapticd hil``); a driver's ``latency_s`` overrides it."""


_LONGEST_TEXT: Final = 4000


class DriverError(Exception):
    """A driver cannot be opened or used; the message has device, cause and remedy.

    Unprintable characters from a file or a device are replaced, and the text is shortened.
    """

    def __init__(self, text: object = "") -> None:
        super().__init__(legible(str(text), _LONGEST_TEXT))


class DriverConfigError(DriverError):
    """The config names an unknown driver or has a wrong option: nothing was opened."""


class Driver(abc.ABC):
    """Base of every driver. The servo loop holds a reference to the object while it uses its pointers.

    Subclasses set the three addresses in :meth:`open`. The constructor receives the whole config; a driver's options
    are the other keys of ``driver``, and the driver checks them and raises :class:`DriverError`.
    """

    summary: ClassVar[str] = ""
    options: ClassVar[type[Section] | tuple[str, ...] | None] = None
    """The driver's options: a section with one line each (:func:`read_options`), or their names, checked
    further by the constructor; None: checked by the constructor only, which `check` then also calls."""
    reports_index: ClassVar[bool] = False
    """Whether ``read`` fills X_INDEX_SEEN and X_INDEX_COUNTS."""
    enable_input: ClassVar[bool] = False
    """Whether the device can have an enable input that a person holds, and ``read`` sets STATUS_HELD while it is closed.

    Such a driver checks in :meth:`open` that the device has one, if the config sets ``safety.enable``."""
    follows_clock: ClassVar[bool] = False
    """Whether a device can wake the loop (``servo.clock: sync``), by a third function ``wait`` that sleeps until its SYNC.

    It has the signature of ``read`` and returns OK, or MISSED at X_DEADLINE_NS; ``read`` reports other errors."""
    latency_s: float = 0.0
    """Declared sample-to-current latency in s, added to T_D by ``check`` and ``simulate``."""
    calls_python: bool = False
    """Whether the pointers call Python: suitable for bring-up, late when the GIL is busy."""
    error: str | None = None
    """Text of the last exception inside the driver, quoted in the fault's cause."""

    def __init__(self, config: Config) -> None:
        self.config = config
        self.read_address = 0
        self.write_address = 0
        self.wait_address = 0
        self.state_address = 0

    @abc.abstractmethod
    def open(self) -> None:
        """Connect, check, and set the addresses. The device must be at zero current and disabled afterwards.

        Raises:
            DriverError: the device is missing, refuses, or does not fit the config.
        """

    @abc.abstractmethod
    def close(self) -> None:
        """Close the device at zero current and disabled. Safe to call twice and after a failed open."""

    @classmethod
    def declared_latency_s(cls, config: Config) -> float:
        """Sample-to-current latency in s that this driver declares for a config, without opening anything.

        Raises:
            DriverConfigError: the driver refuses its options.
        """
        return cls.latency_s

    @classmethod
    def declared_step(cls, config: Config) -> float:
        """Step in A of the device's command, without opening anything; 0: only that of ``amplifier.dac_bits``.

        ``check`` counts half of it among the errors of the force.

        Raises:
            DriverConfigError: the driver refuses its options.
        """
        return 0.0

    @classmethod
    def max_rate_hz(cls, config: Config) -> float:
        """Highest servo rate in Hz of the link to the device, without opening anything; infinite if not known.

        ``check`` warns of a higher rate, and its advice stays below.

        Raises:
            DriverConfigError: the driver refuses its options.
        """
        return math.inf

    @classmethod
    def max_rate_reason(cls, config: Config) -> str:
        """Reason for this limit, after "servo.rate_hz is 5000 Hz, but "; used only if :meth:`max_rate_hz` is finite."""
        return f"driver {config.driver.name} allows {math.floor(cls.max_rate_hz(config))} Hz"

    def check_rate(self, rate_hz: float) -> str | None:
        """Why the open device cannot run at a servo rate in Hz, in words for the user; None if it can.

        Called before ``servo.rate_hz`` changes while the loop runs; the change is refused with the text.
        """
        return None

    def remarks(self) -> list[str]:
        """Observations on the device's link that stop nothing, in words with counts; also while the loop runs."""
        return []

    def describe(self) -> str:
        """One line for the banner of ``hapticd run``."""
        return self.summary


def new_exchange() -> NDArray[np.int64]:
    """A zeroed exchange block; ``block.view(float64)`` is its floating-point view. Shape (16,), int64."""
    return np.zeros(EXCHANGE_WORDS, dtype=np.int64)


def read_options(config: Config, kind: type[_Options]) -> _Options:
    """The driver's options, declared with one line each like hapticd's settings (``hapticd.config.fields``).

    Raises:
        DriverConfigError: one has a wrong value; with key, value, what is allowed and the unit.
    """
    try:
        return kind.model_validate(driver_options(config))
    except ValidationError as error:
        wrong = error.errors(include_url=False)[0]
        key = str(wrong["loc"][0])
        extra = kind.model_fields[key].json_schema_extra if key in kind.model_fields else None
        unit = f" ({extra['unit']})" if isinstance(extra, dict) and "unit" in extra else ""
        raise DriverConfigError(f"driver.{key} = {shown(wrong['input'])}: {wrong['msg']}{unit}") from error


def driver_options(config: Config) -> dict[str, Any]:
    """The driver's options: the keys of ``driver`` that are not hapticd's."""
    return config.driver.options
