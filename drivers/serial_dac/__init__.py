"""Serial DAC board: ``driver: {name: serial_dac, port: /dev/ttyUSB0}``. Protocol: docs/protocols/serial-dac.md."""

from drivers.serial_dac._driver import SerialDacDriver

__all__ = ["SerialDacDriver"]
