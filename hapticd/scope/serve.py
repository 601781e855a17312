"""Runs the scope: binds, says where the page is, and serves until Ctrl-C."""

from __future__ import annotations

import asyncio
import contextlib
import html
import ipaddress
import os
import socket
import tempfile
import webbrowser
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import uvicorn
from starlette.types import ASGIApp

from hapticd.control import descriptors
from hapticd.scope.access import Access, Names
from hapticd.scope.app import ScopeServer, create_app
from hapticd.scope.foxglove import FoxgloveServer, relay
from hapticd.scope.strangers import strangers

AT_ONCE = 128
"""Connections that asyncio accepts in a row before it looks at any of them: each takes a descriptor."""
QUEUE = 1024
"""Connections that the kernel keeps until then; where it keeps no more, who connects is a second late."""
MAX_MESSAGE_BYTES = 4096
"""What a page may say over a WebSocket: its token, no more."""


class ScopeError(Exception):
    """The scope cannot be served; the text says why."""


@dataclass(frozen=True)
class Addresses:
    """Where the page is, tokens included.

    Attributes:
        url: page with the controls; None with ``--view-only``. view_url: page that can only look.
    """

    url: str | None
    view_url: str


def is_loopback(host: str) -> bool:
    """Whether only programs of this machine can reach ``host``."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def serve(
    socket_path: Path,
    *,
    host: str,
    port: int,
    view_only: bool,
    origins: tuple[str, ...],
    announce: Callable[[Addresses], None],
    foxglove: FoxgloveServer | None = None,
) -> None:
    """Serve the page until SIGINT or SIGTERM.

    Args:
        socket_path: the daemon's socket; the daemon may come later, and go.
        host: address to listen on. port: 0 takes a free one.
        view_only: nobody can command from this process.
        origins: further origins under which the page may be reached.
        announce: called once with the URLs, when they can be used.
        foxglove: gets the rows, too.

    Raises:
        ScopeError: the address cannot be had.
        ValueError: an origin is none.
    """
    descriptors.prepare()
    with contextlib.closing(_bind(host, port)) as listening:
        port = listening.getsockname()[1]
        names = Names.of(host, port, origins)
        access = Access(control_token=None) if view_only else Access()
        shown = f"[{host}]" if ":" in host else "127.0.0.1" if host == "0.0.0.0" else host  # noqa: S104 - what is shown
        base = f"http://{shown}:{port}/#"
        control = None if access.control_token is None else f"{base}{access.control_token}"
        announce(Addresses(control, f"{base}{access.view_token}"))
        server = ScopeServer(socket_path, access)
        try:
            asyncio.run(_serve(PageServer(web_settings(create_app(server, names))), listening, socket_path, foxglove))
        finally:
            server.close()


async def _serve(
    page: PageServer, listening: socket.socket, socket_path: Path, foxglove: FoxgloveServer | None
) -> None:
    """The page, and beside it what others look at, until the page's server ends."""
    rows = None if foxglove is None else asyncio.create_task(relay(socket_path, foxglove))
    try:
        await page.serve(sockets=[listening])
    finally:
        if rows is not None:
            rows.cancel()


class PageServer(uvicorn.Server):
    """uvicorn, which knows one number for what is accepted in a row and what is kept waiting, with two."""

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Begin to listen."""
        await super().startup(sockets)
        for listening in sockets or ():
            listening.listen(QUEUE)


def web_settings(app: ASGIApp) -> uvicorn.Config:
    """How the page is served: no compression of what is noise, and nothing believed that a proxy might have said."""
    return uvicorn.Config(
        app,
        http=strangers(),
        ws="websockets-sansio",
        ws_per_message_deflate=False,
        ws_max_size=MAX_MESSAGE_BYTES,
        lifespan="off",
        loop="asyncio",
        backlog=AT_ONCE,
        log_config=None,
        log_level="warning",
        access_log=False,
        server_header=False,
        proxy_headers=False,
        timeout_graceful_shutdown=1,
    )


def _bind(host: str, port: int) -> socket.socket:
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        found = socket.socket(family, kind, protocol)
        try:
            found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            found.bind(address)
            found.listen(QUEUE)  # a page that is asked for at once waits for the answer
        except BaseException:
            found.close()
            raise
    except OSError as error:
        raise ScopeError(
            f"cannot serve on {host} port {port}: {error.strerror or error}; choose another --port"
        ) from error
    return found


def write_for_group(path: Path, text: str) -> None:
    """A file with secrets in it, in place of one that is there: its owner and group may read it, nobody else ever could.

    Raises:
        OSError: it cannot be written.
    """
    path.unlink(missing_ok=True)
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o640)
    with os.fdopen(descriptor, "w", encoding="utf-8") as file:
        file.write(f"{text}\n")


def open_in_browser(url: str) -> Path:
    """Open the page in the user's browser, without its token in any program's command line, which everybody could read.

    Returns:
        The file, for its owner only, that sends the browser on to the page; the caller removes it in the end.
    """
    descriptor, name = tempfile.mkstemp(prefix="hapticd-scope-", suffix=".html")
    with os.fdopen(descriptor, "w", encoding="utf-8") as file:
        target = html.escape(url, quote=True)
        file.write(f'<!doctype html><meta http-equiv="refresh" content="0;url={target}"><title>hapticd scope</title>\n')
    webbrowser.open(Path(name).as_uri())
    return Path(name)
