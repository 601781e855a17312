"""The board's port: a raw pseudo-terminal with a symbolic link, which can be unplugged and plugged in again."""

from __future__ import annotations

import os
import tty
from pathlib import Path


class Port:
    """A pseudo-terminal with a symbolic link to the host's end.

    The board's end is not blocking. The host's end is not held open here, so that a host may lock it for
    itself, and the board detects that the host has closed it.

    Args:
        link: the symbolic link; an existing link at that path is replaced, a file is not.

    Raises:
        OSError: no pseudo-terminal, or ``link`` cannot be created.
    """

    def __init__(self, link: Path) -> None:
        self.link = link
        self.master = -1
        self.path = ""
        self.plug_in()

    def plug_in(self) -> None:
        """Create the pseudo-terminal and the link to it.

        Raises:
            OSError: as for the class.
        """
        if self.link.exists() and not self.link.is_symlink():
            raise FileExistsError(f"{self.link} exists, and is not a link that may be replaced")
        self.master, slave = os.openpty()
        try:
            # The settings survive the host's close: they belong to the pair, and the board keeps its end open.
            tty.setraw(slave)
            os.set_blocking(self.master, False)
            self.path = os.ttyname(slave)
            # Renamed, so that the link changes atomically.
            draft = self.link.with_name(f".{self.link.name}.{os.getpid()}")
            draft.symlink_to(self.path)
            draft.replace(self.link)
        except OSError:
            os.close(self.master)
            self.master = -1
            raise
        finally:
            os.close(slave)

    def unplug(self) -> None:
        """Remove the link, unless it has been replaced, then close the terminal, so that the host finds no link."""
        if self.master < 0:
            return
        if self.link.is_symlink() and str(self.link.readlink()) == self.path:
            self.link.unlink()
        os.close(self.master)
        self.master = -1
