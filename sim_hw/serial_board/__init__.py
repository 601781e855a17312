"""The serial DAC board of ``docs/protocols/serial-dac.md``, written from that document alone."""
