"""Is this machine fit for the servo loop? ``hapticd doctor`` checks the kernel, its limits, the CPUs and the device.

Each check reports what it found, whether that matters at the configured rate, and the command that repairs it.
"""

from hapticd.doctor.examine import Examination, examine
from hapticd.doctor.finding import Finding, Level, Machine

__all__ = ["Examination", "Finding", "Level", "Machine", "examine"]
