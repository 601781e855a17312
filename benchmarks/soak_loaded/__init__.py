"""``python -m benchmarks.soak_loaded``: three daemons for hours under every kind of load."""
