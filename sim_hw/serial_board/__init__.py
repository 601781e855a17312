"""The serial DAC board of ``docs/protocols/serial-dac.md``, written only from that document."""
