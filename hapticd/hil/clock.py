"""A wall clock that jumps, for one process, as a wrong NTP server or a person at `date` makes it jump.

A few lines of C stand before the C library's `clock_gettime`, `gettimeofday` and `time`, and add what a file says to the
wall clock. CLOCK_MONOTONIC is left alone, as the kernel leaves it alone.
"""

from __future__ import annotations

import shutil
import struct
import subprocess
from pathlib import Path
from typing import Final

from hapticd.hil.errors import HilError

_SOURCE: Final = r"""
#define _GNU_SOURCE
#include <fcntl.h>
#include <stdint.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>
static volatile int64_t *offset_s;
__attribute__((constructor)) static void begin(void) {
    int descriptor = open(getenv("CLOCK_OFFSET_FILE"), O_RDONLY);
    void *page = mmap(0, 8, PROT_READ, MAP_SHARED, descriptor, 0);
    if (page != MAP_FAILED) offset_s = page;
}
int clock_gettime(clockid_t clock, struct timespec *t) {
    int result = (int)syscall(SYS_clock_gettime, clock, t);
    if (result == 0 && clock == CLOCK_REALTIME && offset_s) t->tv_sec += *offset_s;
    return result;
}
int gettimeofday(struct timeval *t, void *zone) {
    struct timespec now;
    int result = clock_gettime(CLOCK_REALTIME, &now);
    t->tv_sec = now.tv_sec;
    t->tv_usec = now.tv_nsec / 1000;
    return result;
}
time_t time(time_t *t) {
    struct timespec now;
    clock_gettime(CLOCK_REALTIME, &now);
    if (t) *t = now.tv_sec;
    return now.tv_sec;
}
"""


def _complaint(text: str) -> str:
    """The first error in a compiler's output."""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return next((line for line in lines if "error" in line), lines[-1] if lines else "nothing")


class JumpingClock:
    """The wall clock of a process that is started with `environment`.

    Args:
        folder: takes the library and the file that says how far the clock is off.

    Raises:
        HilError: there is no C compiler, or it cannot make the library.
    """

    def __init__(self, folder: Path) -> None:
        compiler = shutil.which("cc") or shutil.which("gcc")
        if compiler is None:
            raise HilError("clock_jump needs a C compiler: apt-get install gcc libc6-dev")
        library, self._file = folder / "clock.so", folder / "clock-offset"
        command = [compiler, "-shared", "-fPIC", "-O2", "-x", "c", "-o", str(library), "-"]
        made = subprocess.run(command, input=_SOURCE, text=True, capture_output=True, check=False)
        if made.returncode != 0:
            raise HilError(
                f"clock_jump: {compiler} cannot make the library of the jumping clock (exit code {made.returncode}); "
                f"are the C library's headers there (apt-get install libc6-dev)? It says: {_complaint(made.stderr)}"
            )
        self.jump(0)
        self.environment = {"LD_PRELOAD": str(library), "CLOCK_OFFSET_FILE": str(self._file)}

    def jump(self, offset_s: int) -> None:
        """Put the clock so far from the true time, at once."""
        with self._file.open("r+b" if self._file.exists() else "wb") as file:
            file.write(struct.pack("=q", offset_s))
