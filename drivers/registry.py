"""Installed drivers: entry points of the group ``hapticd.drivers``, of hapticd and of other packages."""

from __future__ import annotations

import difflib
import math
from dataclasses import dataclass
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import TYPE_CHECKING

from drivers.interface import Driver, DriverConfigError, DriverError, driver_options, read_options

if TYPE_CHECKING:
    from hapticd.config import Config

GROUP = "hapticd.drivers"


@dataclass(frozen=True)
class DriverInfo:
    """One installed driver, for ``hapticd drivers``."""

    name: str
    origin: str
    """The entry point's target, ``module:class``, and its package."""
    summary: str
    latency_s: float
    """Declared sample-to-current latency, s (an open driver may change it)."""
    error: str | None = None
    """Why it cannot be loaded; None if it can."""
    driver: type[Driver] | None = None
    """The class; None if it cannot be loaded."""


@cache  # searches every installed package, and every `check` of a config calls it
def installed_drivers() -> dict[str, EntryPoint]:
    """Entry points of the group, by the driver's name."""
    return {entry.name: entry for entry in entry_points(group=GROUP)}


def _load(entry: EntryPoint) -> type[Driver]:
    loaded = entry.load()
    if not (isinstance(loaded, type) and issubclass(loaded, Driver)):
        raise DriverError(f"driver {entry.name!r}: {entry.value} is not a subclass of drivers.Driver")
    return loaded


def discover() -> list[DriverInfo]:
    """Every installed driver, sorted by name; one that fails to load is listed with its error."""
    found = []
    for name, entry in sorted(installed_drivers().items()):
        origin = f"{entry.value} ({entry.dist.name if entry.dist else 'unknown package'})"
        try:
            driver = _load(entry)
        except Exception as exception:
            found.append(DriverInfo(name, origin, "", 0.0, f"{type(exception).__name__}: {exception}"))
        else:
            found.append(DriverInfo(name, origin, driver.summary, driver.latency_s, driver=driver))
    return found


def check_option_names(config: Config) -> None:
    """Refuse an option or an input that the config's driver does not have, without opening or creating anything.

    Raises:
        DriverConfigError: with the nearest option, or the message of a driver that declares none. Not for a driver that
            is not installed.
    """
    try:
        driver = _class_of(config.driver.name)
    except Exception:  # `declared_latency` says what is wrong with it
        return
    if driver is None:
        return
    if config.safety.enable and not driver.enable_input:
        raise _lacks(config, "safety.enable = true", "has no enable input", "enable_input")
    if config.servo.clock == "sync" and not driver.follows_clock:
        raise _lacks(config, "servo.clock = sync", "has no SYNC for the loop", "follows_clock")
    if driver.options is None:
        if driver_options(config):
            _made(driver, config)
        return
    names = driver.options if isinstance(driver.options, tuple) else tuple(driver.options.model_fields)
    for key in driver_options(config):
        if key not in names:
            nearest = difflib.get_close_matches(key, names, n=1)
            has = f"it has: {', '.join(names)}" if names else "it has none"
            hint = f"did you mean driver.{nearest[0]}?" if nearest else has
            raise DriverConfigError(f"driver.{key}: driver {config.driver.name} has no such option; {hint}")
    if not isinstance(driver.options, tuple):
        read_options(config, driver.options)


def _lacks(config: Config, setting: str, what: str, capability: str) -> DriverConfigError:
    having = ", ".join(each.name for each in discover() if each.driver is not None and getattr(each.driver, capability))
    return DriverConfigError(
        f"{setting}: driver {config.driver.name} {what}; of the installed drivers these have one: {having}"
    )


def declared_latency(config: Config) -> tuple[float, str | None]:
    """Declared sample-to-current latency of the config's driver in s, and a warning if it is not known (then 0)."""
    name = config.driver.name
    try:
        driver = _class_of(name)
        if driver is None:
            return 0.0, f"driver {name!r} is not installed: its latency is not known and is taken as 0"
        check_option_names(config)
        return driver.declared_latency_s(config), None
    except DriverConfigError as error:
        return 0.0, f"{error}: the latency of driver {name!r} is not known and is taken as 0"
    except Exception as error:
        text = f"{type(error).__name__}: {error}"
        return 0.0, f"driver {name!r} cannot be loaded ({text}): its latency is not known and is taken as 0"


def declared_step(config: Config) -> float:
    """Step in A of the command of the config's driver; 0 if there is none, or it is not known."""
    try:
        driver = _class_of(config.driver.name)
        return 0.0 if driver is None else driver.declared_step(config)
    except Exception:  # `declared_latency` says what is wrong with it
        return 0.0


def max_rate(config: Config) -> tuple[float, str]:
    """Highest servo rate in Hz of the config's driver, and its reason; infinite if not known."""
    try:
        driver = _class_of(config.driver.name)
        limit = math.inf if driver is None else driver.max_rate_hz(config)
        return limit, driver.max_rate_reason(config) if driver and math.isfinite(limit) else ""
    except Exception:  # `declared_latency` says what is wrong with it
        return math.inf, ""


def _class_of(name: str) -> type[Driver] | None:
    """The loaded driver class; None if it is not installed."""
    entry = installed_drivers().get(name)
    return None if entry is None else _load(entry)


def create(config: Config) -> Driver:
    """The config's driver, not yet open.

    Raises:
        DriverError: no such driver (with the nearest name), it fails to load, or it refuses its options.
    """
    name = config.driver.name
    entries = installed_drivers()
    if name not in entries:
        nearest = difflib.get_close_matches(name, entries, n=1)
        hint = f"; did you mean {nearest[0]!r}?" if nearest else ""
        raise DriverConfigError(
            f"driver.name = {name!r}: no such driver{hint} (installed: {', '.join(sorted(entries))})"
        )
    try:
        driver = _load(entries[name])
    except DriverError:
        raise
    except Exception as exception:
        raise DriverError(f"driver {name!r} cannot be loaded: {type(exception).__name__}: {exception}") from exception
    check_option_names(config)
    return _made(driver, config)


def _made(driver: type[Driver], config: Config) -> Driver:
    try:
        return driver(config)
    except DriverConfigError:
        raise
    except DriverError as error:  # nothing was opened yet
        raise DriverConfigError(error) from error
    except Exception as exception:
        raise DriverConfigError(
            f"driver {config.driver.name!r} refused its config: {type(exception).__name__}: {exception}"
        ) from exception
