"""Requests to Linux for real time: what was granted, what was refused, and how to permit it.

Only the servo thread gets SCHED_FIFO and its CPU; memory is locked for the whole process, and deep idle states of the CPU
are disabled. A refusal is reported once; it is an error only if ``servo.require_realtime`` is set.
"""

from __future__ import annotations

import ctypes
import os
import resource
import signal
import struct
from dataclasses import dataclass
from pathlib import Path

_MCL_CURRENT = 1
_MCL_FUTURE = 2
_MCL_ONFAULT = 4
_PR_SET_NAME = 15
_PR_SET_TIMERSLACK = 29
_DMA_LATENCY = Path("/dev/cpu_dma_latency")

_libc = ctypes.CDLL(None, use_errno=True)


@dataclass(frozen=True)
class Grant:
    """One request to the kernel."""

    name: str
    granted: bool
    detail: str
    fix: str = ""


class RealtimeError(Exception):
    """``servo.require_realtime`` is set and a request was refused; the message names each refusal and its remedy."""


def lock_memory() -> Grant:
    """``mlockall``, only if the limit allows all of it: with a partial lock later mallocs fail.

    Pages are locked at their first access: those of the loop in its warm-up. Libraries that reserve gigabytes of address
    space (Arrow's allocator) then cost neither memory nor time.
    """
    soft, _ = resource.getrlimit(resource.RLIMIT_MEMLOCK)
    fix = (
        "raise the memlock limit: 'LimitMEMLOCK=infinity' in the unit, "
        "or '@haptics - memlock unlimited' in /etc/security/limits.d"
    )
    if os.geteuid() != 0 and soft != resource.RLIM_INFINITY:
        return Grant("memory lock", False, f"memlock limit is {soft // 1024} KiB", fix)
    if _libc.mlockall(_MCL_CURRENT | _MCL_FUTURE | _MCL_ONFAULT) != 0:
        return Grant("memory lock", False, os.strerror(ctypes.get_errno()), fix)
    return Grant("memory lock", True, "mlockall, every page from its first use")


def unlock_memory() -> None:
    """Undo :func:`lock_memory`."""
    _libc.munlockall()


def set_scheduler(priority: int) -> Grant:
    """SCHED_FIFO for the calling thread only."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except OSError as error:
        fix = (
            f"raise the rtprio limit to {priority}: 'LimitRTPRIO={priority}' in the unit, "
            f"or '@haptics - rtprio {priority}' in /etc/security/limits.d"
        )
        return Grant("scheduler", False, f"SCHED_FIFO {priority}: {error.strerror}; running as an ordinary thread", fix)
    return Grant("scheduler", True, f"SCHED_FIFO {priority}")


def set_affinity(cpu: int | None) -> Grant | None:
    """Bind the calling thread to one CPU, if one is configured."""
    if cpu is None:
        return None
    try:
        os.sched_setaffinity(0, {cpu})
    except OSError as error:
        available = ",".join(str(number) for number in sorted(os.sched_getaffinity(0)))
        return Grant("affinity", False, f"CPU {cpu}: {error.strerror}", f"set servo.cpu to one of {available}, or null")
    return Grant("affinity", True, f"CPU {cpu}")


def name_thread(name: str) -> None:
    """Name the calling thread, for ``top -H``, and set the smallest timer slack for ordinary threads."""
    _libc.prctl(_PR_SET_NAME, ctypes.c_char_p(name.encode()[:15]), 0, 0, 0)
    _libc.prctl(_PR_SET_TIMERSLACK, ctypes.c_ulong(1), 0, 0, 0)


def block_signals() -> None:
    """Block all signals in the calling thread except those of its own errors, which end the process."""
    own = {signal.SIGSEGV, signal.SIGBUS, signal.SIGFPE, signal.SIGILL}
    signal.pthread_sigmask(signal.SIG_BLOCK, signal.valid_signals() - own)


class CpuLatencyRequest:
    """Holds ``/dev/cpu_dma_latency`` at 0 µs while it is open."""

    def __init__(self) -> None:
        self._descriptor: int | None = None

    def acquire(self) -> Grant:
        """Open and hold the request."""
        try:
            self._descriptor = os.open(_DMA_LATENCY, os.O_WRONLY | os.O_CLOEXEC)
            os.write(self._descriptor, struct.pack("=i", 0))
        except FileNotFoundError:
            detail = f"this machine has no {_DMA_LATENCY} (a container, or a kernel without CONFIG_PM)"
            return Grant("idle states", False, detail, "run on the machine itself, or boot with processor.max_cstate=1")
        except OSError as error:
            self.release()
            fix = f"give the daemon's group write access to {_DMA_LATENCY} (the udev rule systemd/60-hapticd.rules)"
            return Grant("idle states", False, f"{_DMA_LATENCY}: {error.strerror}", fix)
        return Grant("idle states", True, f"{_DMA_LATENCY} held at 0 µs")

    def release(self) -> None:
        """Allow deep idle states again."""
        if self._descriptor is not None:
            os.close(self._descriptor)
            self._descriptor = None
