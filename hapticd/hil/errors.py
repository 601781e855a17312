"""What can go wrong around a run with simulated hardware."""


class HilError(Exception):
    """A process did not come up, did not end, or left nothing to read; the text has its last words."""
