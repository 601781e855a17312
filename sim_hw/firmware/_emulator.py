"""Board processes: the kinds of boards, their start, and the line to them."""

from __future__ import annotations

import os
import shutil
import signal
import socket
import subprocess
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from numpy.typing import NDArray

from sim_hw.firmware import _page

FIRMWARE: Final = Path(__file__).resolve().parents[2] / "firmware" / "serial_dac"
"""The firmware's source, in a checkout of the project; a wheel has none."""
_BOOT_S: Final = 20.0


@dataclass(frozen=True)
class Board:
    """A board that can be run here.

    Attributes:
        image: path of its binary below ``build`` of the firmware's source.
        command: program and arguments for an image, a socket and a page.
        program: emulator that must be installed.
        package: its Debian package.
        dac_bits: of its converter. full_scale_A: of its output stage.
        sleeps: it uses the processor only at events, so that it may have a real-time priority.
    """

    image: str
    command: Callable[[Path, Path, Path], Sequence[str]]
    program: str | None = None
    package: str | None = None
    dac_bits: int = 14
    full_scale_A: float = 6.0
    sleeps: bool = True


def _host(image: Path, line: Path, memory: Path) -> Sequence[str]:
    return [str(image), str(line), str(memory)]


def _qemu(image: Path, line: Path, memory: Path) -> Sequence[str]:
    return (
        *("qemu-system-arm", "-M", "mps2-an385,memory-backend=memory", "-display", "none", "-monitor", "none"),
        *("-object", f"memory-backend-file,id=memory,size={_page.MEMORY_BYTES},mem-path={memory},share=on"),
        *("-chardev", f"socket,id=line,path={line}", "-serial", "chardev:line", "-kernel", str(image)),
    )


def _simavr(image: Path, line: Path, memory: Path) -> Sequence[str]:
    return [str(FIRMWARE / "build" / "avr-uno" / "runner"), str(image), str(line), str(memory)]


BOARDS: Final = {
    "host": Board("host/board", _host),
    "mps2-an385": Board("mps2-an385/board.elf", _qemu, "qemu-system-arm", "qemu-system-arm"),
    "avr-uno": Board("avr-uno/board.elf", _simavr, dac_bits=12, sleeps=False),
}


class EmulatorError(OSError):
    """A board cannot be run; the message says what is missing."""


class Emulator:
    """A board as a process. A reset ends it and starts it again, with the same page.

    Args:
        name: of :data:`BOARDS`. folder: takes socket and page. image: another binary than the board's own.

    Raises:
        EmulatorError: the image or the emulator is missing. OSError: the page or the socket cannot be created.
    """

    def __init__(self, name: str, folder: Path, image: Path | None = None) -> None:
        board = BOARDS[name]
        found = image or FIRMWARE / "build" / board.image
        if not found.exists():
            raise EmulatorError(f"{found} is missing: 'make firmware' in the project's source makes it")
        if board.program and not shutil.which(board.program):
            raise EmulatorError(f"board {name} needs {board.program}: apt-get install {board.package}")
        self.board = board
        memory, line = folder / "memory", folder / "line"
        self.page: NDArray[Any] = _page.new_page(memory)
        self._server = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._server.bind(str(line))
        self._server.listen(1)
        self._server.settimeout(_BOOT_S)
        self._command = [*_tied(board.sleeps), *board.command(found, line, memory)]
        self._process: subprocess.Popen[bytes] | None = None
        self._line: socket.socket | None = None

    @property
    def descriptor(self) -> int:
        """Of the line to the board; −1 while it is off."""
        return -1 if self._line is None else self._line.fileno()

    def power_on(self) -> None:
        """Start the board and wait until it has set its output.

        Raises:
            EmulatorError: it ended, or did not set its output.
        """
        before = int(self.page[_page.WRITTEN])
        # A separate session: Ctrl-C in the terminal is for the bench only, which switches the board off at its end.
        self._process = subprocess.Popen(self._command, stdin=subprocess.DEVNULL, start_new_session=True)
        try:
            self._line, _ = self._server.accept()
        except TimeoutError as error:
            raise EmulatorError(f"the board has not started within {_BOOT_S:g} s: {self._command}") from error
        self._line.setblocking(False)
        end = time.monotonic() + _BOOT_S
        while int(self.page[_page.WRITTEN]) == before:
            if self._process.poll() is not None or time.monotonic() > end:
                raise EmulatorError(f"the board does not set its output: {self._command}")
            time.sleep(0.001)

    def power_off(self) -> None:
        """End the board at once, like a power cut."""
        if self._line is not None:
            self._line.close()
            self._line = None
        if self._process is not None:
            self._process.send_signal(signal.SIGKILL)
            self._process.wait()
            self._process = None

    def close(self) -> None:
        """End the board and close its files."""
        self.power_off()
        self._server.close()


def _tied(first: bool) -> list[str]:
    """Command that ends the board together with this process; ``first``: under SCHED_FIFO if that is allowed."""
    command = ["setpriv", "--pdeathsig", "KILL"] if shutil.which("setpriv") else []
    if first and os.geteuid() == 0 and shutil.which("chrt"):
        command += ["chrt", "--fifo", "60"]
    return command
