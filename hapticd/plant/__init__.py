"""The device: exact propagation, friction, amplifier, encoder."""
