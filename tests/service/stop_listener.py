"""A stop channel of a test's own: a datagram socket that answers what the test says."""

from __future__ import annotations

import contextlib
import socket
import threading
from collections.abc import Iterator
from pathlib import Path

from tests.polling import PATIENCE_S


@contextlib.contextmanager
def stop_channel(socket_path: Path, answer: bytes | None) -> Iterator[list[bytes]]:
    """Answer on the channel of the daemon with this socket; yields the words as they come.

    Args:
        socket_path: of the control API.
        answer: what each word is answered with; None: nothing is answered.
    """
    heard: list[bytes] = []
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as channel:
        channel.bind(f"{socket_path}.stop")
        channel.settimeout(PATIENCE_S)

        def listen() -> None:
            while True:
                word, sender = channel.recvfrom(64)
                if word == b"":
                    return
                heard.append(word)
                if answer is not None:
                    channel.sendto(answer, sender)

        thread = threading.Thread(target=listen)
        thread.start()
        try:
            yield heard
        finally:
            with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as last:
                last.sendto(b"", f"{socket_path}.stop")
            thread.join()


@contextlib.contextmanager
def mute_api(socket_path: Path, backlog: int = 16) -> Iterator[None]:
    """A control socket that accepts nothing: an API that is frozen."""
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind(str(socket_path))
        listening.listen(backlog)
        yield
