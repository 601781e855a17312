"""The board's port: a raw pseudo-terminal behind a symbolic link, which can be unplugged and put back."""

from __future__ import annotations

import os
import tty
from pathlib import Path


class Port:
    """A pseudo-terminal whose near end is where ``link`` points.

    The far end stays with the board and does not block. The near end is not held open here, so that a host may lock it for
    itself, and the board learns when the host is gone.

    Args:
        link: the symbolic link; an older link at that path is replaced, a file is not.

    Raises:
        OSError: no pseudo-terminal, or ``link`` cannot be made.
    """

    def __init__(self, link: Path) -> None:
        self.link = link
        self.master = -1
        self.path = ""
        self.plug_in()

    def plug_in(self) -> None:
        """Make the pseudo-terminal and the link to it.

        Raises:
            OSError: as for the class.
        """
        if self.link.exists() and not self.link.is_symlink():
            raise FileExistsError(f"{self.link} is there already, and is not a link that may be replaced")
        self.master, slave = os.openpty()
        try:
            # The settings outlive the last close: they belong to the pair, and the board keeps its end open.
            tty.setraw(slave)
            os.set_blocking(self.master, False)
            self.path = os.ttyname(slave)
            # Renamed into place, so that a host never finds half a link.
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
        """Take the link away, unless it is another's by now, then hang up: a host that is hung up on finds no link."""
        if self.master < 0:
            return
        if self.link.is_symlink() and str(self.link.readlink()) == self.path:
            self.link.unlink()
        os.close(self.master)
        self.master = -1
