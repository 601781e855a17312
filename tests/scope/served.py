"""The scope's server in a thread, in front of a stand-in for the daemon or a real one."""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx

from hapticd.scope.access import Access, Names
from hapticd.scope.app import ScopeServer, create_app
from hapticd.scope.serve import PageServer, web_settings

CLIENT = "a-page-of-the-tests"


@dataclass(frozen=True)
class Served:
    """A scope that runs.

    Attributes:
        port: on 127.0.0.1. access: its tokens. server: itself.
    """

    port: int
    access: Access
    server: ScopeServer

    @property
    def origin(self) -> str:
        """Where its page comes from."""
        return f"http://127.0.0.1:{self.port}"

    def url(self, *, view: bool = False) -> str:
        """The page's URL."""
        return f"{self.origin}/#{self.access.view_token if view else self.access.control_token}"

    def post(self, name: str, body: Any = None, **changes: str | None) -> httpx.Response:
        """POST as the page does, with some headers changed or, with None, left out."""
        headers: dict[str, str | None] = {
            "Authorization": f"Bearer {self.access.control_token}",
            "Content-Type": "application/json",
            "Origin": self.origin,
            "X-Client": CLIENT,
        }
        headers |= {key.replace("_", "-"): value for key, value in changes.items()}
        content = httpx.Request("POST", "http://x", json={} if body is None else body).content
        given = {key: value for key, value in headers.items() if value is not None}
        return httpx.post(f"{self.origin}/api/{name}", content=content, headers=given, timeout=60)


@contextlib.contextmanager
def serve(socket_path: Path, port: int = 0, access: Access | None = None) -> Iterator[Served]:
    """Serve the scope of the daemon on ``socket_path``."""
    access = access or Access()
    listening = socket.create_server(("127.0.0.1", port))
    port = listening.getsockname()[1]
    server = ScopeServer(socket_path, access)
    runner = PageServer(web_settings(create_app(server, Names.of("127.0.0.1", port))))
    thread = threading.Thread(target=runner.run, kwargs={"sockets": [listening]}, daemon=True)
    thread.start()
    while not runner.started:
        assert thread.is_alive()
        time.sleep(0.01)
    try:
        yield Served(port, access, server)
    finally:
        runner.should_exit = True
        thread.join(10)
        server.close()
        listening.close()
