"""Ctrl-C while the daemon moves a shaft."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from hapticd.client.client import Client


@contextmanager
def stop_on_interrupt(client: Client, say: Callable[[str], None]) -> Iterator[None]:
    """Stop the daemon when interrupted: whoever presses Ctrl-C at a moving shaft wants it to stand still."""
    try:
        yield
    except KeyboardInterrupt:
        client.stop()
        say("the daemon was told to stop")
        raise
