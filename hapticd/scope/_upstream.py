"""The daemon's stream of frames."""

from __future__ import annotations

import asyncio
import os
from collections.abc import AsyncIterator
from pathlib import Path

from hapticd.record.frames import LONGEST_FRAME, PREFIX

_REQUEST = b"GET /stream HTTP/1.0\r\nHost: hapticd\r\n\r\n"
CONNECT_TIMEOUT_S = 5.0
SILENCE_S = 3.0
"""The daemon gives a sign of life every half second."""


class StreamLost(Exception):  # noqa: N818 - a state of affairs
    """The daemon's stream cannot be had, or has ended."""


async def frames(socket_path: Path) -> AsyncIterator[bytes]:
    """The daemon's frames, as they are, until it goes away.

    Raises:
        StreamLost: always, in the end; the text says why.
    """
    try:
        async with asyncio.timeout(CONNECT_TIMEOUT_S):
            # HTTP/1.0: no chunks, the body ends with the connection.
            reader, writer = await asyncio.open_unix_connection(os.fspath(socket_path), limit=LONGEST_FRAME)
    except (OSError, TimeoutError) as error:
        raise StreamLost(f"no daemon answers on {socket_path}") from error
    try:
        writer.write(_REQUEST)
        async with asyncio.timeout(CONNECT_TIMEOUT_S):
            status = await reader.readline()
            while await reader.readline() not in (b"\r\n", b""):
                pass
        if status.split(b" ")[1:2] != [b"200"]:
            raise StreamLost(f"the daemon refuses its stream: {(await reader.read(500)).decode(errors='replace')}")
        while True:
            async with asyncio.timeout(SILENCE_S):
                size = PREFIX.unpack(await reader.readexactly(PREFIX.size))[0]
                if size > LONGEST_FRAME:
                    raise StreamLost(f"a frame of {size} bytes is not the daemon's")
                frame = await reader.readexactly(size)
            yield frame
    except (OSError, EOFError, TimeoutError) as error:
        raise StreamLost("the daemon's stream ended") from error
    finally:
        writer.close()
