"""The scope's server: the page, and what it may ask of the daemon.

A request is answered on small pools of threads of its own kind, as in the daemon, so that nothing slow is ever in front
of a stop.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any, Final

from starlette.applications import Starlette
from starlette.requests import ClientDisconnect, Request
from starlette.responses import FileResponse, PlainTextResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp

from hapticd.client import Client, DaemonUnreachable, RequestRefused, StoppedUnanswered
from hapticd.config import Config, ConfigError, parse_config
from hapticd.config.text import number_or_text
from hapticd.config.units import UnitError
from hapticd.control.json_reply import JsonReply, error_reply
from hapticd.fault_pages import fault_page
from hapticd.record import RunFileError
from hapticd.scope import runs, theory
from hapticd.scope._quantities import read_plan, read_quantities, read_settings
from hapticd.scope.access import Access, Guard, Names, Role
from hapticd.scope.choices import choice_for_page, in_asked_unit, in_sequence
from hapticd.scope.forms import BadRequest, body_of, client_of, fields_of
from hapticd.scope.hub import Hub
from hapticd.scope.lease import Lease
from hapticd.scope.runs import RunError
from hapticd.scope.sockets import Sockets
from hapticd.scope.strangers import has_token
from hapticd.servo.sequence import read_sequence

FOLDER = Path(__file__).parent
STATIC = FOLDER / "static"
"""Of the source tree, else of the installation."""

MAX_FILE_BYTES = 256 * 1024 * 1024
FRAMES_TYPE = "application/vnd.hapticd.frames"
RUN_TYPE = "application/vnd.apache.arrow.stream"
"""No form and no page of another origin can send these, or JSON, without asking the server first (CORS), which says no."""


class ScopeServer:
    """What the routes share.

    Args:
        socket_path: the daemon's socket.
        access: tokens.
    """

    def __init__(self, socket_path: Path, access: Access) -> None:
        self.access = access
        self.hub = Hub(socket_path)
        self.lease = Lease()
        self.client = Client(socket_path)
        self.connections = 0
        self._pools = {
            name: ThreadPoolExecutor(workers, thread_name_prefix=f"scope-{name}")
            for name, workers in (
                ("stop", 2),
                ("command", 1),
                ("note", 1),
                ("theory", 1),
                ("explore", 1),
                ("zwidth", 1),
                ("file", 1),
            )
        }

    def close(self) -> None:
        """Let the threads go."""
        self.hub.close()
        for pool in self._pools.values():
            pool.shutdown(wait=False, cancel_futures=True)

    async def on(self, pool: str, method: Callable[..., Any], *arguments: Any) -> Any:
        """Call ``method`` on one of the pools."""
        return await asyncio.get_running_loop().run_in_executor(self._pools[pool], method, *arguments)

    # what the page may ask; each takes the request's JSON body

    async def stop(self, request: Request) -> Any:
        """Zero current, then amplifier off. Needs no lease, and its body is not read."""
        return await self.on("stop", self.client.stop)

    async def estop(self, request: Request) -> Any:
        """The same at once, and a latched fault. Needs no lease, and its body is not read."""
        return await self.on("stop", self.client.estop)

    def command(self, method: Callable[..., Any], **kinds: type) -> Callable[[Request], Awaitable[Any]]:
        """What asks the daemon for a method of its client, with exactly these fields."""

        async def asked(request: Request) -> Any:
            return await self.on("command", partial(method, **await fields_of(request, **kinds)))

        return asked

    async def set(self, request: Request) -> Any:
        """Live settings, those that were typed read first."""
        body = await fields_of(request, settings=dict, force=bool)
        settings = read_settings(body["settings"], self._parsed())
        return await self.on("command", self.client.set, settings, body["force"])

    async def release(self, request: Request) -> Any:
        """A release; deflection and duration as they were typed."""
        body = await fields_of(request, deflection=dict, duration_s=dict, force=bool)
        force, config = body.pop("force"), self._parsed()
        numbers = read_quantities(body, {"deflection": "ticks", "duration_s": "s"}, config)
        try:
            return await self.on("command", self.client.release, numbers["deflection"], numbers["duration_s"], force)
        except RequestRefused as refused:
            refused.choice = in_asked_unit(refused.choice, body["deflection"], config)
            raise

    async def excite(self, request: Request) -> Any:
        """An excitation; the numbers of its form as they were typed."""
        body = await fields_of(request, name=str, plan=dict, force=bool)
        numbers: dict[str, Any] = read_plan(body["name"], body["plan"], self._parsed())
        return await self.on("command", partial(self.client.excite, body["name"], force=body["force"], **numbers))

    async def sequence(self, request: Request) -> Any:
        """Releases under a list of settings, as a file of `hapticd sequence` says them."""
        body = await fields_of(request, text=str, force=bool)
        sequence, config = read_sequence(body["text"], "the sequence"), self._parsed()
        asked = partial(self.client.sequence, **sequence.request(config), force=body["force"])
        try:
            return await self.on("command", asked)
        except RequestRefused as refused:
            refused.choice = refused.choice and in_sequence(refused.choice, body["text"], sequence, config)
            raise

    async def quantities(self, request: Request) -> Any:
        """What was typed, as numbers of the units beside the fields."""
        fields = (await fields_of(request, fields=dict))["fields"]
        units = {name: str(said.get("unit", "")) for name, said in fields.items() if isinstance(said, dict)}
        if units.keys() != fields.keys():
            raise BadRequest(422, "request", "each field is an object of a text and a unit")
        return read_quantities(fields, units, self._parsed())

    async def record(self, request: Request) -> Any:
        """Start or stop recording."""
        body = await fields_of(request, on=bool)
        return await self.on("command", self.client.record_start if body["on"] else self.client.record_stop)

    async def note(self, request: Request) -> Any:
        """A note in the recording. It sets nothing in motion: no lease is needed."""
        return await self.on("note", partial(self.client.note, **await fields_of(request, text=str)))

    async def marker(self, request: Request) -> Any:
        """A marker in the recording; a value that reads as a number is one."""
        body = await fields_of(request, name=str, value=str)
        value = number_or_text(body["value"]) if body["value"] else None
        return await self.on("note", self.client.marker, body["name"], value)

    async def take(self, request: Request) -> Any:
        """The controls: take them over, or give them back."""
        body = await fields_of(request, take=bool)
        client = client_of(request)
        if body["take"]:
            self.lease.claim(client, take_over=True)
        else:
            self.lease.release(client)
        return self.lease.report(client)

    async def preview(self, request: Request) -> Any:
        """Where settings not yet sent would put the operating point."""
        body = await fields_of(request, settings=dict, deflection=dict)
        config, latency_s = self._parsed(), self._known()["latency_s"]
        settings = read_settings(body["settings"], config)
        deflection = read_quantities({"deflection": body["deflection"]}, {"deflection": "ticks"}, config)["deflection"]
        return await self.on("theory", theory.preview, self._config(), settings, deflection, latency_s)

    async def ends(self, request: Request) -> Any:
        """In what starts end, by exploration: on a thread of its own, so that a setting that is dragged waits for none."""
        await fields_of(request)
        return await self.on("explore", theory.ends, self._config(), self._known()["latency_s"])

    async def zwidth(self, request: Request) -> Any:
        """Which stiffness and damping can be rendered: some seconds, on a thread of its own."""
        await fields_of(request)
        return await self.on("zwidth", theory.z_map, self._config(), self._known()["latency_s"])

    async def simulate(self, request: Request) -> Response:
        """The exact simulation of a release."""
        body = await fields_of(request, deflection=float, duration_s=float)
        stream = await self.on("file", runs.simulate_release, self._config(), body["deflection"], body["duration_s"])
        return Response(stream, media_type=FRAMES_TYPE)

    async def replay(self, request: Request) -> Response:
        """The same with the ticks as they were recorded."""
        content = await body_of(request, FRAMES_TYPE, MAX_FILE_BYTES)
        return Response(await self.on("file", runs.replay_release, content), media_type=FRAMES_TYPE)

    async def open(self, request: Request) -> Response:
        """A run file dropped onto the page, as frames."""
        content = await body_of(request, RUN_TYPE, MAX_FILE_BYTES)
        name = request.headers.get("x-file-name", "run.arrow")
        return Response(await self.on("file", runs.open_run, content, name), media_type=FRAMES_TYPE)

    async def save(self, request: Request) -> Response:
        """What the page sees, as a run file of its format."""
        content = await body_of(request, FRAMES_TYPE, MAX_FILE_BYTES)
        saved = await self.on("file", runs.save_run, content, "scope")
        return Response(saved, media_type=RUN_TYPE)

    def _known(self) -> dict[str, Any]:
        if self.hub.config is None:
            raise BadRequest(409, "unreachable", "the daemon's configuration is not known: no daemon has answered yet")
        return self.hub.config

    def _config(self) -> dict[str, Any]:
        document: dict[str, Any] = self._known()["config"]
        return document

    def _parsed(self) -> Config:
        return parse_config(self._config(), "the daemon's config")


def create_app(server: ScopeServer, names: Names) -> ASGIApp:
    """The whole application, guarded."""
    client, sockets = server.client, Sockets(server)
    posts: dict[str, tuple[Callable[[Request], Awaitable[Any]], Role, bool]] = {
        "stop": (server.stop, "command", False),
        "estop": (server.estop, "command", False),
        "start": (server.command(client.start, force=bool), "command", True),
        "origin": (server.command(client.origin, force=bool), "command", True),
        "clear": (server.command(client.clear), "command", True),
        "set": (server.set, "command", True),
        "release": (server.release, "command", True),
        "sequence": (server.sequence, "command", True),
        "excite": (server.excite, "command", True),
        "record": (server.record, "command", True),
        "note": (server.note, "command", False),
        "marker": (server.marker, "command", False),
        "lease": (server.take, "command", False),
        "quantities": (server.quantities, "look", False),
        "preview": (server.preview, "look", False),
        "ends": (server.ends, "look", False),
        "zwidth": (server.zwidth, "look", False),
        "simulate": (server.simulate, "look", False),
        "replay": (server.replay, "look", False),
        "open": (server.open, "look", False),
        "save": (server.save, "look", False),
    }
    """What a page may ask for, the role that it takes, and whether it takes the lease, too."""
    routes = [
        Route("/", _page),
        *(Route(f"/api/{name}", _endpoint(server, *what), methods=["POST"]) for name, what in posts.items()),
        Route("/faults/{code}", _fault_page),
        WebSocketRoute("/ws/rows", sockets.rows),
        WebSocketRoute("/ws/state", sockets.state),
        Mount("/static", StaticFiles(directory=STATIC)),
    ]
    return Guard(Starlette(routes=routes), names)


async def _page(request: Request) -> Response:
    return FileResponse(STATIC / "index.html")


async def _fault_page(request: Request) -> Response:
    text = fault_page(request.path_params["code"])
    return error_reply(404, "not_found", "no page about such a fault") if text is None else PlainTextResponse(text)


def _turned_away(server: ScopeServer, request: Request, role: Role, lease: bool) -> Response | None:
    """Why this page may not ask this: no token, one that may only look, or no lease."""
    found = server.access.bearer(request.headers)
    if found is None:
        return error_reply(401, "token", "an Authorization header with a token of this start is needed")
    has_token(request)
    if role == "command" and found != "command":
        return error_reply(403, "view_only", "this token may only look")
    if lease and not server.lease.held_by(request.headers.get("x-client")):
        return error_reply(409, "lease", "another page holds the controls; take them over first")
    return None


_WORDS_ALONE: Final[dict[type[Exception], tuple[int, str]]] = {
    DaemonUnreachable: (502, "unreachable"),
    UnitError: (422, "quantity"),
    RunFileError: (422, "run"),
    RunError: (422, "run"),
}
_REFUSALS: Final[tuple[type[Exception], ...]] = (BadRequest, RequestRefused, ConfigError, *_WORDS_ALONE)


def _refusal(error: Exception) -> Response:
    """What refuses a request, as JSON."""
    if isinstance(error, BadRequest):
        return error_reply(error.status, error.code, error.message, problems=error.problems)
    if isinstance(error, RequestRefused):
        choice = {"choice": choice_for_page(error.choice)} if error.choice else {}
        return error_reply(error.status, error.code, error.message, problems=error.problems, **choice)
    if isinstance(error, ConfigError):
        return error_reply(422, "config", str(error), problems=[asdict(problem) for problem in error.problems])
    status, code = next(said for kind, said in _WORDS_ALONE.items() if isinstance(error, kind))
    return error_reply(status, code, str(error))


def _endpoint(server: ScopeServer, handler: Callable[[Request], Awaitable[Any]], role: Role, lease: bool) -> Any:
    """A route's endpoint: token first, then the lease, then the form; and every refusal as JSON."""

    async def endpoint(request: Request) -> Response:
        if (refusal := _turned_away(server, request, role, lease)) is not None:
            return refusal
        try:
            result = await handler(request)
        except StoppedUnanswered as stopped:
            result = {"state": stopped.state, "unanswered": str(stopped)}
        except ClientDisconnect:
            return error_reply(400, "gone", "the page went away")
        except _REFUSALS as error:
            return _refusal(error)
        if role == "command":
            server.hub.look_again()
        return result if isinstance(result, Response) else JsonReply(result)

    return endpoint
