"""What a driver is: two C functions, one state pointer and a declared latency.

The servo loop is compiled and never touches Python. It reaches hardware through two function pointers::

    int32_t read (void *state, hapticd_exchange *x);   /* sample: counts, measured current, status bits */
    int32_t write(void *state, hapticd_exchange *x);   /* command: current, DAC code, enable            */

called in this order within one tick, so that no hidden period of delay arises. ``hapticd_exchange`` is 16 words of eight
bytes (``docs/reference/driver-interface.md`` has the C declaration); the ``X_*`` constants below are its word numbers.
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
"""f64, out of read: measured current in A, NaN where the device has none."""
X_STATUS = 6
"""i64, out of read: STATUS_* bits."""
X_DEVICE_CODE = 7
"""i64, out of read or write: the device's own error code, shown in the fault's cause."""
X_CURRENT = 8
"""f64, in to write: commanded current in A, already clamped and on the DAC's grid."""
X_CODE = 9
"""i64, in to write: the same as a signed DAC code (0 where no DAC is configured)."""
X_ENABLE = 10
"""i64, in to write: 1 amplifier on, 0 amplifier off."""
X_TRUE_POSITION = 11
"""f64, out of read, simulated devices only: true position in rad or m (for ``simulate``; never shown to the renderer)."""
X_TRUE_VELOCITY = 12
"""f64, out of read, simulated devices only: true velocity in rad/s or m/s."""
X_INDEX_SEEN = 13
"""i64, out of read, drivers with ``reports_index``: index pulses passed since the device was opened."""
X_INDEX_COUNTS = 14
"""i64, out of read, likewise: encoder counts at the newest of them."""
X_DEADLINE_NS = 15
"""i64, in to wait: when to give up, ns of CLOCK_MONOTONIC. X_TIME_NS is when the device's clock is due; 0: not known."""

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
"""The same 16 words as a record, as the loop sees them."""

STATUS_ENABLED = 1
"""The amplifier reports that it is on and follows the command."""
STATUS_HELD = 2
"""A person holds the enable input. With ``safety.enable`` a sample without this bit is a release."""

OK = 0
MISSED = 1
"""No fresh sample, or no proof that the command arrived; counted; more than ``safety.missed_exchanges`` in a row fault."""
DEVICE_FAULT = 2
"""The device answers and reports a fault of its own (X_DEVICE_CODE)."""
ERROR = -1
"""The driver failed inside itself (an exception); its text is in :attr:`Driver.error`."""
LOST = -2
"""The device is gone (unplugged, port closed), or has restarted: it must be opened anew, so every later call says so too."""


PROCESSING_S = 40e-6
"""What host and device need to answer, beside the time on the wire: s from the encoder's sample to the current's change.

Measured with the simulated board and drive on an ordinary PC (``hapticd hil``); a driver's ``latency_s`` overrides it."""


_LONGEST_TEXT: Final = 4000


class DriverError(Exception):
    """A driver cannot be opened or used; the text says which device, what was found and how to repair it.

    What is quoted from a file or a device is made legible.
    """

    def __init__(self, text: object = "") -> None:
        super().__init__(legible(str(text), _LONGEST_TEXT))


class DriverConfigError(DriverError):
    """The config names a driver that is not there, or gives it an option that it does not have: nothing was opened."""


class Driver(abc.ABC):
    """Base of every driver. The servo loop keeps the object alive for as long as it uses its pointers.

    Subclasses set the three addresses in :meth:`open`. The constructor receives the whole config; a driver's own options
    stand beside ``driver.name`` and are checked by the driver, which raises :class:`DriverError`.
    """

    summary: ClassVar[str] = ""
    options: ClassVar[type[Section] | tuple[str, ...] | None] = None
    """The options beside ``driver.name``: a section with one line each (:func:`read_options`), or their names, checked
    further by the constructor; None: checked by the constructor alone, which `check` then calls too."""
    reports_index: ClassVar[bool] = False
    """Whether ``read`` fills X_INDEX_SEEN and X_INDEX_COUNTS."""
    enable_input: ClassVar[bool] = False
    """Whether the device can have an input that a person holds, and ``read`` sets STATUS_HELD for as long as that is closed.

    A driver that says so sees to it in :meth:`open` that the device has one, where the config asks for ``safety.enable``."""
    follows_clock: ClassVar[bool] = False
    """Whether a device can wake the loop (``servo.clock: sync``), by a third function ``wait`` that sleeps until it does.

    Like ``read`` in form, it returns OK, or MISSED at X_DEADLINE_NS; what else is wrong, ``read`` says."""
    latency_s: float = 0.0
    """Declared sample-to-current latency in s, added to T_D by ``check`` and ``simulate``."""
    calls_python: bool = False
    """True when the pointers lead back into Python: good for bring-up, late whenever the GIL is busy."""
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
            DriverError: the device is absent, refuses, or does not fit the config.
        """

    @abc.abstractmethod
    def close(self) -> None:
        """Release the device, leaving it at zero current and disabled. Safe to call twice and after a failed open."""

    @classmethod
    def declared_latency_s(cls, config: Config) -> float:
        """Sample-to-current latency in s that this driver declares for a config, without opening anything.

        Raises:
            DriverConfigError: the driver refuses its options.
        """
        return cls.latency_s

    @classmethod
    def declared_step(cls, config: Config) -> float:
        """Step in A of the command that the device takes, without opening anything; 0: none beside ``amplifier.dac_bits``.

        ``check`` counts half of it among the errors of the force.

        Raises:
            DriverConfigError: the driver refuses its options.
        """
        return 0.0

    @classmethod
    def max_rate_hz(cls, config: Config) -> float:
        """Highest servo rate in Hz that the link to the device carries, without opening anything; infinite if not known.

        ``check`` warns of a rate above it, and its advice stays below.

        Raises:
            DriverConfigError: the driver refuses its options.
        """
        return math.inf

    @classmethod
    def max_rate_reason(cls, config: Config) -> str:
        """Why it ends there, to follow "servo.rate_hz is 5000 Hz, but "; asked only where :meth:`max_rate_hz` is finite."""
        return f"driver {config.driver.name} ends near {math.floor(cls.max_rate_hz(config))} Hz"

    def check_rate(self, rate_hz: float) -> str | None:
        """Why the open device cannot follow a servo rate in Hz, in words for the user; None when it can.

        Asked before ``servo.rate_hz`` changes while the loop runs; the change is refused with the text.
        """
        return None

    def remarks(self) -> list[str]:
        """What the device's link has shown that stops nothing, in words with counts; also while the loop runs."""
        return []

    def describe(self) -> str:
        """One line for the banner of ``hapticd run``."""
        return self.summary


def new_exchange() -> NDArray[np.int64]:
    """A zeroed exchange block; ``block.view(float64)`` is its floating-point side. Shape (16,), int64."""
    return np.zeros(EXCHANGE_WORDS, dtype=np.int64)


def read_options(config: Config, kind: type[_Options]) -> _Options:
    """The driver's own options, by a declaration of one line each (``hapticd.config.fields``), as a setting of ours.

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
    """The driver's own options: what of ``driver`` is no key of hapticd's own."""
    return config.driver.options
