"""The reference firmware (``firmware/serial_dac``) as a running binary, connected to the exact plant by encoder and DAC."""
