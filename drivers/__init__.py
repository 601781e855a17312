"""Drivers: one interface, one file per driver, found through entry points (group ``hapticd.drivers``)."""

from drivers._python_driver import PythonDriver
from drivers.interface import (
    DEVICE_FAULT,
    ERROR,
    LOST,
    MISSED,
    OK,
    STATUS_ENABLED,
    Driver,
    DriverConfigError,
    DriverError,
    driver_options,
    new_exchange,
    read_options,
)
from drivers.registry import DriverInfo, check_option_names, create, declared_latency, declared_step, discover, max_rate

__all__ = [
    "DEVICE_FAULT",
    "ERROR",
    "LOST",
    "MISSED",
    "OK",
    "STATUS_ENABLED",
    "Driver",
    "DriverConfigError",
    "DriverError",
    "DriverInfo",
    "PythonDriver",
    "check_option_names",
    "create",
    "declared_latency",
    "declared_step",
    "discover",
    "driver_options",
    "max_rate",
    "new_exchange",
    "read_options",
]
