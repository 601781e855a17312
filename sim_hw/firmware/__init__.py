"""The reference firmware (``firmware/serial_dac``) as a running binary, with the exact plant at its encoder and DAC."""
