"""``hapticd scope``: the live view in the browser."""

from __future__ import annotations

import contextlib
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hapticd.cli import exits, output
from hapticd.cli.command import command
from hapticd.cli.exits import UsageError
from hapticd.cli.options import SocketOption, connect

if TYPE_CHECKING:
    from hapticd.client import Client
    from hapticd.scope.foxglove import FoxgloveServer
    from hapticd.scope.serve import Addresses


@command(
    "hapticd scope --open",
    "hapticd scope --view-only --port 8766",
    "hapticd scope --foxglove 8767",
    "ssh -L 8765:127.0.0.1:8765 lab-pc hapticd scope",
    codes=(exits.INTERRUPTED,),
)
def scope(
    port: Annotated[int, typer.Option(min=0, max=65535)] = 8765,
    host: str = "127.0.0.1",
    view_only: bool = False,
    open_page: bool = False,
    origin: list[str] | None = None,
    foxglove: Annotated[int, typer.Option(min=0, max=65535)] | None = None,
    url_file: Path | None = None,
    socket: SocketOption = None,
) -> None:
    """Serve a live view of the daemon in the browser, until Ctrl-C: the trace beside the stability plane.

    Prints two URLs, one with the controls and one that can only look; each carries a random token after the '#', valid
    until this command ends. The page is served on this machine only; for another one use an SSH tunnel. The daemon may
    come later, and be restarted.

    Args:
        port: TCP port of the page; 0 takes a free one.
        host (ADDRESS): Address to listen on. Beyond loopback nothing is encrypted.
        view_only: Nobody can command from this page, only look.
        open_page (--open): Open the page in the browser of this desktop.
        origin (URL): Further origin under which the page is reached, e.g. http://localhost:9000 for a tunnel.
            Repeatable.
        foxglove (--foxglove PORT): Serve the rows to Foxglove and PlotJuggler as well, over Foxglove's WebSocket protocol on
            this port of the same address; 0 takes a free one. Read-only, and without a token: whoever reaches the port may
            look. Needs the extra 'foxglove'.
        url_file (PATH): Write the URLs as JSON to this file, for its owner and group only, instead of printing them.
    """
    from hapticd.scope.serve import ScopeError, is_loopback, open_in_browser, serve, write_for_group

    client = connect(socket)
    opened: list[Path] = []
    rows = None if foxglove is None else _foxglove(client, host, foxglove)

    def announce(addresses: Addresses) -> None:
        if not is_loopback(host):
            output.warn(
                f"warning: whoever reaches {host} and has the URL can {'look' if view_only else 'command the motor'}, and "
                "nothing is encrypted; an SSH tunnel is safer"
            )
        document = {"url": addresses.url, "view_url": addresses.view_url, "pid": os.getpid()}
        document |= {} if rows is None else {"foxglove": f"ws://{host}:{rows.port}"}
        lines = [f"look only  {addresses.view_url}"]
        if addresses.url is not None:
            lines.insert(0, f"control    {addresses.url}")
        if rows is not None:
            lines.append(f"Foxglove   {document['foxglove']}")
        if url_file is not None:
            write_for_group(url_file, output.to_json(document))
            opened.append(url_file)
        else:
            output.emit(document, "\n".join([*lines, "Ctrl-C ends"]))
            sys.stdout.flush()
        if open_page:
            opened.append(open_in_browser(addresses.url or addresses.view_url))

    try:
        serve(
            client.socket_path,
            host=host,
            port=port,
            view_only=view_only,
            origins=tuple(origin or ()),
            announce=announce,
            foxglove=rows,
        )
    except (ScopeError, ValueError) as error:
        raise UsageError(str(error)) from error
    finally:
        if rows is not None:
            rows.close()
        for path in opened:
            with contextlib.suppress(OSError):
                path.unlink()


def _foxglove(client: Client, host: str, port: int) -> FoxgloveServer:
    from hapticd.client import DaemonUnreachable
    from hapticd.scope.foxglove import FoxgloveMissing, FoxgloveServer

    linear = False
    with contextlib.suppress(DaemonUnreachable):  # it may come later: the schema's comments have a rotary one's units
        linear = bool(client.config()["encoder"]["counts_per_metre"])
    try:
        return FoxgloveServer(host, port, linear=linear)
    except FoxgloveMissing as error:
        raise UsageError(str(error)) from error
