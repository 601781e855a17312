"""The daemon's rows as a Foxglove WebSocket server, for Foxglove and PlotJuggler: read-only, on a port of its own.

The channel, the schema and the messages are those of an exported MCAP (`hapticd.record.mcap`), so that what is looked at
live and what is opened later look alike. Messages are logged with the Unix time of their tick. A slow client loses its own
oldest messages. The library, ``foxglove-sdk``, is in the extra ``foxglove``.
"""

from __future__ import annotations

import asyncio
import contextlib
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from hapticd.record.frames import Context, decode
from hapticd.record.mcap import MESSAGE, TOPIC, definition, messages_of
from hapticd.record.schema import COLUMNS, empty_rows
from hapticd.scope._upstream import StreamLost, frames

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from hapticd.record.schema import Rows

BACKLOG: Final = 65_536
"""Messages that wait for one client: three seconds at 20 kHz."""
_RETRY_S: Final = 0.5


class FoxgloveMissing(Exception):  # noqa: N818 - a state of affairs
    """The library is not installed, or the port cannot be had; the text says what to do."""


class FoxgloveServer:
    """Serves the rows from here on, until it is closed.

    Args:
        host: address to listen on. port: 0 takes a free one. linear: metres and newtons, for the schema's comments.

    Attributes:
        port: that it listens on.

    Raises:
        FoxgloveMissing: the library is not installed, or the port is taken.
    """

    def __init__(self, host: str, port: int, *, linear: bool = False) -> None:
        try:
            import foxglove
        except ImportError as error:
            raise FoxgloveMissing("--foxglove needs foxglove-sdk: pip install 'hapticd[foxglove]'") from error
        # of its own: nothing else of this process is served; kept, for its channels go with it
        self._context = context = foxglove.Context()
        units = {column.name: column.unit_for(linear=linear) for column in COLUMNS}
        text = definition(_columns(empty_rows()), units)
        schema = foxglove.Schema(name=MESSAGE, encoding="ros2msg", data=text.encode())
        self._channel = foxglove.Channel(TOPIC, schema=schema, message_encoding="cdr", context=context)
        try:
            self._server: Any = foxglove.start_server(
                name="hapticd", host=host, port=port, capabilities=[], context=context, message_backlog_size=BACKLOG
            )
        except (RuntimeError, OSError) as error:
            raise FoxgloveMissing(f"cannot serve on {host} port {port}: {error}; choose another --foxglove") from error
        self.port = int(self._server.port)

    def log(self, rows: Rows, context: Context) -> None:
        """Hand rows to all who look."""
        if not len(rows):
            return
        when_s = context.unix_s + rows["time_s"] - rows["time_s"][-1]
        stamps = np.rint(when_s * 1e9).astype(np.int64).tolist()
        for stamp, message in zip(stamps, messages_of(_columns(rows)), strict=True):
            self._channel.log(message.tobytes(), log_time=stamp)

    def close(self) -> None:
        """Let everybody go."""
        self._server.stop()


def _columns(rows: Rows) -> dict[str, NDArray[Any]]:
    """What a frame of the daemon's stream carries."""
    return {column.name: rows[column.name] for column in COLUMNS if column.name != "exec_ns"}


async def relay(socket_path: Path, server: FoxgloveServer) -> None:
    """From the daemon's stream to the server, for ever; the daemon may come and go."""
    while True:
        with contextlib.suppress(StreamLost):
            async for frame in frames(socket_path):
                server.log(*decode(frame))
        await asyncio.sleep(_RETRY_S)
