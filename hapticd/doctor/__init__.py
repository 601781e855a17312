"""Is this machine fit to run the servo loop? ``hapticd doctor`` looks at the kernel, its limits, the CPUs and the device.

Every check reads a file or asks one question, says what it found, whether that matters at the configured rate, and the
command that repairs it.
"""

from hapticd.doctor.examine import Examination, examine
from hapticd.doctor.finding import Finding, Level, Machine

__all__ = ["Examination", "Finding", "Level", "Machine", "examine"]
